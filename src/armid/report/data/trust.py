"""Assessment of a run from its numbers: reliable results, doubtful results and next steps."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from armid.report.data.findings import evidence_words, remedy_words, serious
from armid.report.data.joint_names import MAX_NAMES, by_joint, label_of
from armid.report.data.number_format import share, short
from armid.report.data.page_data import PageData, velocity_unit
from armid.report.data.residual_dependence import LARGE_SHARE, residual_shares
from armid.report.section import effort_unit
from armid.study.plausibility.one_sided_filter import CODE as ONE_SIDED

GOOD_SHARE = 0.1
"""Largest relative RMS of a well predicted joint, as in Figure 4.3 of the thesis."""

POOR_COVERAGE = 0.85
"""Coverage (share of rows inside the 95 % prediction interval) below which the interval counts as too narrow."""

MANY_BLOCKS = 20
"""Number of blocks above which the scatter between blocks has a relative error of at most a sixth, so that more
blocks would hardly change the scatter."""

MAX_ERROR_RATIO = 2.0
"""Ratio of the torque error in validation to the torque error in training above which more motions are
recommended."""

STANDSTILL_SHARE = 0.01
"""Share of the RMS speed of a joint below which the joint counts as standing still, because noise determines the sign
of the velocity."""

SLOW_SHARE = 0.3
"""Smallest speed that a joint must reach, as a share of its velocity limit; slower motion hardly shows viscous
friction."""

STICKING = (
    "Record a motion with higher accelerations and less time at low speed, or use a stiffer controller: the residual "
    "after reversals of {joints} is caused by sticking, during which static friction can have any value up to its "
    "bound; neither friction with hysteresis nor more of the same data reduces it."
)
"""Remedy for joints that stick and start again, which looks like hysteresis in the residual."""


@dataclass(frozen=True, slots=True)
class TrustJudgement:
    """Assessment of a run, as sentences.

    Attributes:
        trusted: Reliable results.
        doubted: Doubtful results.
        wanted: Recordings or changes to make next.
    """

    trusted: tuple[str, ...]
    doubted: tuple[str, ...]
    wanted: tuple[str, ...]


def judge_trust(page_data: PageData) -> TrustJudgement:
    """Assesses a run; the most important sentences come first."""
    trusted: list[str] = []
    doubted: list[str] = []
    wanted: list[str] = []
    for assess in (_torque, _errors, _bodies, _intervals, _parameters, _warnings, _motion, _laws):
        good, bad, next_ = assess(page_data)
        trusted += good
        doubted += bad
        wanted += next_
    return TrustJudgement(tuple(trusted), tuple(doubted), tuple(dict.fromkeys(wanted)))


CHECK_ERROR = (
    "Look for the cause of the torque error of {joints}: compare measured and predicted torque and the residuals in "
    "this report, check that the load and the torque sensors were the same in training and validation, and run "
    "`armid doctor` on the recordings."
)
"""Advice if the torque error in validation is large."""

Sentences = tuple[list[str], list[str], list[str]]


def _torque(page_data: PageData) -> Sentences:
    """Sentences about the torque error in validation: of all joints together, and of each joint."""
    if not page_data.validation.recordings:
        left_out = page_data.validation.left_out
        words = "The model was not checked on held-out motion."
        if left_out is not None:
            low, high = (float(np.linalg.norm(x)) for x in (left_out.expected.low, left_out.expected.high))
            words = (
                f"The model was checked on left-out {left_out.kind} of the training data only. On another recording "
                f"with such a motion, an RMS error of {short(low)} to {short(high)} {effort_unit(page_data)} is "
                "expected (90 % interval, root of the sum of squares over the joints)."
            )
        return (
            [],
            [words],
            ['Use another motion for validation: --validate RECORDING, or role = "validate" in the study.'],
        )
    held_out, unit = page_data.validation_rms(), effort_unit(page_data)
    total, training = (float(np.linalg.norm(x[np.isfinite(x)])) for x in (held_out, page_data.training_rms()))
    prior = page_data.validation_column(lambda score: score.prior_rms)
    known = np.isfinite(prior) & np.isfinite(held_out)
    words = f"Torque error in validation: {short(total)} {unit} RMS, root of the sum of squares over the joints"
    if known.any():
        ratio = float(np.linalg.norm(held_out[known]) / np.linalg.norm(prior[known]))
        words += f"; {share(ratio)} of the error of the CAD/URDF model"
    failed = [f"{c.name}: {short(c.value)} > {short(c.bound)}" for c in page_data.validation.checks if not c.ok]
    good, bad, next_ = ([], [f"{words}."], []) if failed else ([f"{words}."], [], [])
    bad += [f"Check failed: {each}." for each in failed]
    relative = page_data.validation_column(lambda score: score.relative)
    fine = [j for j, x in enumerate(relative) if x <= GOOD_SHARE]
    if fine:
        good.append(
            f"RMS error of at most {share(GOOD_SHARE)} of the standard deviation of the torque on "
            f"{_joints(page_data, fine)}."
        )
    poor = [j for j, x in enumerate(relative) if x > GOOD_SHARE]
    if poor:
        joints = _listed(f"{label_of(page_data.joints, j)} ({share(float(relative[j]))})" for j in poor)
        bad.append(f"RMS error above {share(GOOD_SHARE)} of the standard deviation of the torque on {joints}.")
    if poor or failed:
        next_.append(CHECK_ERROR.format(joints=_joints(page_data, poor) if poor else "every joint"))
    if total > MAX_ERROR_RATIO * training:
        moving, stands = _moving(page_data)
        if moving <= MAX_ERROR_RATIO * training:
            bad.append(
                f"Most of the validation error is in the {share(stands)} of the rows in which joints stand "
                "still: at standstill, static friction can have any value up to its bound. While the joints "
                f"move, the error is {short(moving)} {unit} RMS."
            )
        else:
            bad.append(f"The validation error is {short(total / training, 2)} times the training error.")
            next_.append(
                "Record more and different training motions: the model predicts held-out motions worse than "
                "training motions."
            )
    return good, bad, next_


def _moving(page_data: PageData) -> tuple[float, float]:
    """RMS validation error of all joints together without rows at standstill, and share of rows at standstill."""
    held_out = page_data.of_role("validate")
    if not held_out:
        return np.inf, 0.0
    error, speed = (
        np.concatenate(x) for x in zip(*((e.measured - e.predicted, e.dq) for e in held_out), strict=True)
    )
    counts = np.isfinite(error)
    stands = counts & (np.abs(speed) < STANDSTILL_SHARE * np.sqrt(np.mean(speed**2, axis=0)))
    moves = counts & ~stands
    square = np.where(moves, error, 0.0) ** 2
    rms = np.sqrt(square.sum(axis=0) / np.maximum(moves.sum(axis=0), 1))
    return float(np.linalg.norm(rms)), float(stands.sum() / max(counts.sum(), 1))


def _intervals(page_data: PageData) -> Sentences:
    """Sentences about the coverage of the 95 % prediction intervals of the torque."""
    coverage = page_data.validation_column(lambda score: score.coverage95)
    poor = [j for j, x in enumerate(coverage) if x < POOR_COVERAGE]
    if not np.isfinite(coverage).any():
        return [], [], []
    if not poor:
        return (
            [
                "The 95 % prediction intervals of the torque contain "
                f"{share(float(np.nanmean(coverage)))} of the held-out rows."
            ],
            [],
            [],
        )
    joints = _listed(f"{label_of(page_data.joints, j)} ({share(float(coverage[j]))})" for j in poor)
    fit = page_data.run.estimate.fit
    few = fit.covariance_kind == "block" and fit.report.parts < MANY_BLOCKS
    return (
        [],
        [
            "The 95 % prediction intervals of the torque are too narrow (they contain too few held-out rows) on "
            f"{joints}; the intervals of parameters may be too narrow, too."
        ],
        [
            "Repeat the motion, or record longer: intervals are computed from the scatter between only "
            f"{fit.report.parts} blocks of rows."
            if few
            else "Try another friction law, or add terms that the model lacks: intervals include the noise of the "
            "training motion, but the error in validation is larger; more recordings of the same motion do "
            "not change this."
        ],
    )


def intervals_hold(page_data: PageData) -> bool:
    """False if the verdict is `fail`, or if the prediction intervals of a joint contain too few held-out rows.

    The intervals of the parameters are then not presented as reliable, because they assume the same noise and model
    as the prediction intervals.
    """
    coverage = page_data.validation_column(lambda score: score.coverage95)
    with np.errstate(invalid="ignore"):
        return page_data.validation.verdict != "fail" and not bool((coverage < POOR_COVERAGE).any())


def _parameters(page_data: PageData) -> Sentences:
    """Sentences about parameters whose interval excludes zero, contains zero, or has an impossible sign."""
    estimate = page_data.run.estimate
    names = estimate.fit.names
    low, high = estimate.intervals.T
    significant = (low > 0.0) | (high < 0.0)
    good = [f"{int(significant.sum())} of {len(names)} parameters have 95 % intervals that do not include zero."]
    if not intervals_hold(page_data):
        good = []
    insignificant = [name for name, yes in zip(names, significant, strict=True) if not yes]
    bad = (
        [
            f"{len(insignificant)} parameters cannot be distinguished from zero: "
            f"{by_joint(insignificant, page_data.joints)}."
        ]
        if insignificant
        else []
    )
    nonnegative = {p.name for p in page_data.run.model.parameters if p.nonnegative}
    negative = [name for name, top in zip(names, high, strict=True) if name in nonnegative and top < 0.0]
    next_: list[str] = []
    if negative and not any(each.code == "not-physical" for each in estimate.findings):
        bad.append(
            "These parameters and their whole intervals are negative, which is physically impossible: "
            f"{by_joint(negative, page_data.joints)}."
        )
    rotors = [name for name in insignificant + negative if name.symbol == "IA"]
    if rotors:
        next_.append(
            "Record fast reversals of single joints while the other joints rest, to separate "
            f"{by_joint(rotors, page_data.joints)} from link inertias."
        )
    return good, bad, next_


def outside_intervals(page_data: PageData) -> bool:
    """True if the nearest consistent parameters lie outside the interval of at least one parameter."""
    if page_data.verdict is None or page_data.verdict.certificate.feasible:
        return False
    fit = page_data.run.estimate.fit
    widths = np.ptp(fit.intervals, axis=1)
    half: dict[str, float] = {name.of_all: 0.5 * width for name, width in zip(fit.names, widths, strict=True)}
    return any(abs(each.change) > half[each.name] for each in page_data.verdict.certificate.blame)


def forbids_simulation(page_data: PageData) -> bool:
    """True if the parameters must not be used in a simulation or an export, because no real body can have them.

    The mass matrix is then not positive definite in some pose, or the nearest consistent parameters lie outside the
    95 % intervals.
    """
    verdict = page_data.verdict
    return verdict is not None and (verdict.pose.min_eigenvalue <= 0.0 or outside_intervals(page_data))


def _bodies(page_data: PageData) -> Sentences:
    """Sentences about the physical consistency of the parameters."""
    if page_data.verdict is None:
        return [], [], []
    certificate, smallest = page_data.verdict.certificate, page_data.verdict.pose.min_eigenvalue
    bad: list[str] = []
    if smallest <= 0.0:
        bad.append(
            "The mass matrix is not positive definite in every pose; do not use the parameters in a simulation."
        )
    if certificate.feasible:
        return ["The parameters are physically consistent: a real body can have them."], bad, []
    away = f"{short(certificate.distance)} ({share(certificate.relative_distance)}) away"
    if outside_intervals(page_data):
        bad.append(
            f"Not physically consistent: the nearest consistent values lie {away}, outside the 95 % intervals. Do "
            "not use the parameters in a simulation or an export."
        )
    else:
        bad.append(
            f"Not exactly physically consistent: the nearest consistent values lie {away}, within the 95 % intervals."
        )
    return [], bad, []


def _errors(page_data: PageData) -> Sentences:
    """Sentences about findings that are errors."""
    return _findings_of(page_data, "error")


def _warnings(page_data: PageData) -> Sentences:
    """Sentences about findings that are warnings."""
    return _findings_of(page_data, "warning")


def _findings_of(page_data: PageData, severity: str) -> Sentences:
    findings = serious(page_data.run.estimate.findings, severity)
    bad = list(dict.fromkeys(map(evidence_words, findings)))
    return [], bad, [remedy_words(each) for each in findings if each.remedy]


def _motion(page_data: PageData) -> Sentences:
    """Advice to record faster motion of joints that were too slow to identify their viscous friction."""
    train, fit = page_data.of_role("train"), page_data.run.estimate.fit
    relative: dict[str, bool] = dict(zip(fit.names, fit.poorly_identified, strict=True))
    slow: list[str] = []
    for j, joint in enumerate(page_data.joints):
        fastest = max((float(np.abs(each.dq[:, j]).max()) for each in train), default=np.inf)
        if fastest < SLOW_SHARE * joint.velocity_limit < np.inf and relative.get(f"FV_{j + 1}", False):
            slow.append(
                f"{label_of(page_data.joints, j)} ({short(fastest, 2)} of "
                f"{short(joint.velocity_limit, 2)} {velocity_unit(joint)})"
            )
    return [], [], [f"Record faster motion, to identify viscous friction: {_listed(slow)}."] if slow else []


def _laws(page_data: PageData) -> Sentences:
    """Advice to use other friction laws for joints whose residual depends on position or reversals."""
    if any(finding.code == ONE_SIDED for finding in page_data.run.estimate.findings):
        return [], [], []  # the filter makes residuals that depend on reversals, which friction would only hide
    dependent: dict[str, list[int]] = {"position": [], "reversals": []}
    for j in range(len(page_data.joints)):
        shares = residual_shares(page_data.drawn, page_data.run.processing, j)
        for what, value in (("position", shares.position), ("reversals", shares.reversal)):
            if value > LARGE_SHARE:
                dependent[what].append(j)
    sticking = [j for j in dependent["reversals"] if _sticks(page_data, j)]
    dependent["reversals"] = [j for j in dependent["reversals"] if j not in sticking]
    better = {"position": "Use a richer friction law", "reversals": "Use a friction law with hysteresis"}
    next_ = [STICKING.format(joints=_joints(page_data, sticking))] if sticking else []
    next_ += [
        f"{better[what]} instead of more data: the residual of {_joints(page_data, joints)} depends on {what}."
        for what, joints in dependent.items()
        if joints
    ]
    return [], [], next_


def _sticks(page_data: PageData, j: int) -> bool:
    """True if joint `j` mostly stands still, or if rows at standstill are masked for `j`, but not for all joints."""
    channels = {each.channel for each in page_data.run.estimate.findings if each.code == "sticking"}
    if page_data.joints[j].name in channels:
        return True
    rows = [np.isfinite(each.measured) for each in page_data.drawn] if channels else []
    return any(bool((mask.any(axis=1) & ~mask[:, j]).any()) for mask in rows)


def _joints(page_data: PageData, which: Sequence[int]) -> str:
    if len(which) == len(page_data.joints):
        return "every joint"
    return _listed(label_of(page_data.joints, j) for j in which)


def _listed(names: Iterable[str]) -> str:
    """Text that lists the first `MAX_NAMES` names and states the number of the others."""
    all_names = list(names)
    rest = f" and {len(all_names) - MAX_NAMES} more" if len(all_names) > MAX_NAMES + 1 else ""
    return ", ".join(all_names[:MAX_NAMES] if rest else all_names) + rest
