"""Judgement of a run: what can be trusted, what cannot, what to record or change next, made from its numbers."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from armid.report.data.findings import evidence_words, remedy_words, serious
from armid.report.data.joint_names import MOST_NAMES, by_joint, label_of
from armid.report.data.number_format import share, short
from armid.report.data.page_data import PageData, velocity_unit
from armid.report.data.residual_analysis import MUCH, residual_shares
from armid.report.section import effort_unit

__all__ = ["POOR_COVERAGE", "TrustJudgement", "judge_trust", "outside_intervals"]

GOOD_SHARE = 0.1
"""Relative RMS, over the torque's standard deviation, up to which a joint is called well predicted: the thesis's
lines of Figure 4.3."""

POOR_COVERAGE = 0.85
"""Share of rows inside a 95 % band below which the band is not believed."""

UNLIKE_TRAINING = 2.0
"""Error in validation over that in training, from which on more motions are asked for."""

RESTS = 0.01
"""Share of its usual speed below which a joint stands: there the sign of its velocity is the noise's."""

SLOW = 0.3
"""Share of its velocity limit below which a joint's viscous friction is hard to tell from the rest."""

STICKING = (
    "A motion that passes rest quickly (higher accelerations, less time at low speed) or a stiffer controller: what "
    "is left after reversals of {joints} comes with sticking, where dry friction takes any value up to its bound; "
    "neither friction with memory nor more of the same data removes it."
)
"""What to do where a joint sticks and starts again, which looks like memory in what is left."""


@dataclass(frozen=True, slots=True)
class TrustJudgement:
    """The verdict in words.

    Attributes:
        trusted: What can be relied on.
        doubted: What cannot.
        wanted: What to record or to change next.
    """

    trusted: tuple[str, ...]
    doubted: tuple[str, ...]
    wanted: tuple[str, ...]


def judge_trust(material: PageData) -> TrustJudgement:
    """Judge a run; what weighs most comes first."""
    trusted: list[str] = []
    doubted: list[str] = []
    wanted: list[str] = []
    for look in (_torque, _errors, _bodies, _bands, _parameters, _warnings, _motion, _laws):
        good, bad, next_ = look(material)
        trusted += good
        doubted += bad
        wanted += next_
    return TrustJudgement(tuple(trusted), tuple(doubted), tuple(dict.fromkeys(wanted)))


Words = tuple[list[str], list[str], list[str]]


def _torque(material: PageData) -> Words:
    """Error on validation motion, all joints together and each."""
    if not material.validation["recordings"]:
        return (
            [],
            ["Nothing here was checked on held-out motion."],
            ['Another motion, kept for validation: --validate RECORDING, or role = "validate" in the study.'],
        )
    held_out, unit = material.validation_rms(), effort_unit(material)
    total, training = (float(np.linalg.norm(x[np.isfinite(x)])) for x in (held_out, material.training_rms()))
    prior = material.validation_column("prior_rms")
    known = np.isfinite(prior) & np.isfinite(held_out)
    words = f"Torque in validation: {short(total)} {unit} RMS, root of the sum over joints"
    if known.any():
        left = float(np.linalg.norm(held_out[known]) / np.linalg.norm(prior[known]))
        words += f"; {share(left)} of the error of the CAD/URDF model"
    failed = [
        f"{c['name']}: {short(c['value'])} > {short(c['bound'])}"
        for c in material.validation["checks"]
        if not c["ok"]
    ]
    good, bad, next_ = ([], [f"{words}."], []) if failed else ([f"{words}."], [], [])
    bad += [f"Check failed: {each}." for each in failed]
    relative = material.validation_column("relative")
    fine = [j for j, x in enumerate(relative) if x <= GOOD_SHARE]
    if fine:
        good.append(f"Relative RMS of at most {share(GOOD_SHARE)} on {_joints(material, fine)}.")
    poor = [j for j, x in enumerate(relative) if x > GOOD_SHARE]
    if poor:
        said = _listed(f"{label_of(material.joints, j)} ({share(float(relative[j]))})" for j in poor)
        bad.append(f"Relative RMS above {share(GOOD_SHARE)} on {said}.")
    if total > UNLIKE_TRAINING * training:
        moving, stands = _moving(material)
        if moving <= UNLIKE_TRAINING * training:
            bad.append(
                f"Most of the error in validation is where joints stand, {share(stands)} of the rows: dry "
                f"friction takes any value up to its bound there. Where they move it is {short(moving)} {unit} RMS."
            )
        else:
            bad.append(f"The error in validation is {short(total / training, 2)} times that in training.")
            next_.append(
                "More and other motions to train on: held-out ones are predicted worse than those of training."
            )
    return good, bad, next_


def _moving(material: PageData) -> tuple[float, float]:
    """Error in validation where joints move, all together, and the share of rows in which they stand."""
    held_out = material.of_role("validate")
    if not held_out:
        return np.inf, 0.0
    error, speed = (
        np.concatenate(x) for x in zip(*((e.measured - e.predicted, e.dq) for e in held_out), strict=True)
    )
    counts = np.isfinite(error)
    stands = counts & (np.abs(speed) < RESTS * np.sqrt(np.mean(speed**2, axis=0)))
    moves = counts & ~stands
    square = np.where(moves, error, 0.0) ** 2
    rms = np.sqrt(square.sum(axis=0) / np.maximum(moves.sum(axis=0), 1))
    return float(np.linalg.norm(rms)), float(stands.sum() / max(counts.sum(), 1))


def _bands(material: PageData) -> Words:
    """Tell whether the 95 % bands hold what they promise."""
    coverage = material.validation_column("coverage95")
    poor = [j for j, x in enumerate(coverage) if x < POOR_COVERAGE]
    if not np.isfinite(coverage).any():
        return [], [], []
    if not poor:
        return (
            [f"The 95 % bands of the torque: they hold {share(float(np.nanmean(coverage)))} of the held-out rows."],
            [],
            [],
        )
    said = _listed(f"{label_of(material.joints, j)} ({share(float(coverage[j]))})" for j in poor)
    return (
        [],
        [f"The 95 % bands of the torque are too narrow on {said}: so may be the intervals of its parameters."],
        ["The same motion repeated, or longer: intervals rest on the scatter between blocks, and here on few."],
    )


def _parameters(material: PageData) -> Words:
    """Tell which parameters are told from zero, and which cannot be what they are."""
    estimate = material.run.estimate
    names = estimate.fit.names
    low, high = estimate.intervals.T
    clear = (low > 0.0) | (high < 0.0)
    good = [f"{int(clear.sum())} of {len(names)} parameters: their 95 % intervals stay clear of zero."]
    unclear = [name for name, sure in zip(names, clear, strict=True) if not sure]
    bad = (
        [f"{len(unclear)} parameters cannot be told from zero: {by_joint(unclear, material.joints)}."]
        if unclear
        else []
    )
    never = {p.name for p in material.run.model.parameters if p.nonnegative}
    negative = [name for name, top in zip(names, high, strict=True) if name in never and top < 0.0]
    next_: list[str] = []
    if negative and not any(each.code == "not-physical" for each in estimate.findings):
        bad.append(f"Negative where physics forbids it, intervals included: {by_joint(negative, material.joints)}.")
    rotors = [name for name in unclear + negative if name.startswith("IA")]
    if rotors:
        next_.append(
            f"Quick turns of single joints while the others rest: {by_joint(rotors, material.joints)} mix with link "
            "inertias."
        )
    return good, bad, next_


def outside_intervals(material: PageData) -> bool:
    """Tell whether the nearest consistent parameters lie outside the intervals of some parameters."""
    if material.verdict is None or material.verdict.certificate.feasible:
        return False
    fit = material.run.estimate.fit
    half = dict(zip((name.split("[", 1)[0] for name in fit.names), 0.5 * np.ptp(fit.intervals, axis=1), strict=True))
    return any(abs(each.change) > half[each.name] for each in material.verdict.certificate.blame)


def _bodies(material: PageData) -> Words:
    """Physical consistency."""
    if material.verdict is None:
        return [], [], []
    certificate, smallest = material.verdict.certificate, material.verdict.pose.min_eigenvalue
    bad: list[str] = []
    if smallest <= 0.0:
        bad.append("The mass matrix is not positive definite in every pose: do not simulate with these values.")
    if certificate.feasible:
        return ["The parameters are physically consistent: a real body can have them."], bad, []
    away = f"{short(certificate.distance)} ({share(certificate.relative_distance)}) away"
    if outside_intervals(material):
        bad.append(
            f"Not physically consistent: the nearest such values lie {away}, outside the intervals. "
            "Do not simulate or export these."
        )
    else:
        bad.append(f"Not exactly physically consistent: the nearest such values lie {away}, within the intervals.")
    return [], bad, []


def _errors(material: PageData) -> Words:
    """Return what contradicts the recordings or the description."""
    return _noticed(material, "error")


def _warnings(material: PageData) -> Words:
    """Return what else was found."""
    return _noticed(material, "warning")


def _noticed(material: PageData, severity: str) -> Words:
    found = serious(material.run.estimate.findings, severity)
    bad = list(dict.fromkeys(map(evidence_words, found)))
    return [], bad, [remedy_words(each) for each in found if each.remedy]


def _motion(material: PageData) -> Words:
    """Joints that moved too slowly to show their viscous friction."""
    train, fit = material.of_role("train"), material.run.estimate.fit
    relative = dict(zip(fit.names, fit.poorly_identified, strict=True))
    slow: list[str] = []
    for j, joint in enumerate(material.joints):
        fastest = max((float(np.abs(each.dq[:, j]).max()) for each in train), default=np.inf)
        if fastest < SLOW * joint.velocity_limit < np.inf and relative.get(f"FV_{j + 1}", False):
            slow.append(
                f"{label_of(material.joints, j)} ({short(fastest, 2)} of "
                f"{short(joint.velocity_limit, 2)} {velocity_unit(joint)})"
            )
    return [], [], [f"Faster motion, to tell viscous friction: {_listed(slow)}."] if slow else []


def _laws(material: PageData) -> Words:
    """Structure in the residual that friction laws could take."""
    found: dict[str, list[int]] = {"position": [], "reversals": []}
    for j in range(len(material.joints)):
        remains = residual_shares(material.drawn, material.run.processing, j)
        for what, much in (("position", remains.position), ("reversals", remains.reversal)):
            if much > MUCH:
                found[what].append(j)
    sticks = [j for j in found["reversals"] if _sticks(material, j)]
    found["reversals"] = [j for j in found["reversals"] if j not in sticks]
    better = {"position": "A richer law of friction", "reversals": "A law of friction with memory"}
    next_ = [STICKING.format(joints=_joints(material, sticks))] if sticks else []
    next_ += [
        f"{better[what]} rather than more data: what is left follows {what} on {_joints(material, joints)}."
        for what, joints in found.items()
        if joints
    ]
    return [], [], next_


def _sticks(material: PageData, j: int) -> bool:
    """Tell whether a joint was found to stick: rows at standstill do not count for it where they do for others."""
    told = {each.channel for each in material.run.estimate.findings if each.code == "sticking"}
    rows = [np.isfinite(each.measured) for each in material.drawn] if told else []
    return any(bool((mask.any(axis=1) & ~mask[:, j]).any()) for mask in rows)


def _joints(material: PageData, which: Sequence[int]) -> str:
    if len(which) == len(material.joints):
        return "every joint"
    return _listed(label_of(material.joints, j) for j in which)


def _listed(names: Iterable[str]) -> str:
    """Names after one another, the first few."""
    every = list(names)
    more = f" and {len(every) - MOST_NAMES} more" if len(every) > MOST_NAMES + 1 else ""
    return ", ".join(every if not more else every[:MOST_NAMES]) + more
