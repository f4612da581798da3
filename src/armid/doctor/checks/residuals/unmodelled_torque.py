"""Check for a torque of one joint that the doctor's model lacks: a function of its angle, its path or its velocity.

A fit shows such a torque only as a larger residual. The residual of each joint is therefore compared with laws that
the model does not have, and the law that explains most of it is told.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace
from itertools import permutations
from typing import Any

import numpy as np

from armid import kernel
from armid.checked_array import Array
from armid.doctor.check_definition import LogCheck
from armid.doctor.check_input import Explanation, LogEvidence
from armid.doctor.checks.dynamics.rotor_inertia_missing import term_names
from armid.doctor.fitted_log import LogState
from armid.doctor.quick_fit import QuickRows, solve
from armid.doctor.remedy_trial import try_remedy
from armid.doctor.residuals import common_causes, large_residual, spring_over_two_joints
from armid.doctor.residuals.added_columns import AddedColumns
from armid.doctor.residuals.local_laws import local_laws
from armid.doctor.residuals.missing_law import ANGLE, FRICTION, MissingLaw
from armid.errors import Finding
from armid.measurement.observations import ObservedRun
from armid.measurement.remedy_builders import lines

EXPLAINED = 0.7
"""Smallest decrease of the squared residuals by a law, relative to the squared residual of the joint. On 16
recordings of eight arms it is at most 0.61; a law of 0.6 times the standard deviation of the torque gives 0.7 to
1.2."""

EXPLAINED_LOCALLY = 0.75
"""The limit that is used instead of `EXPLAINED` for friction at one angle, and for a gain that swings with the angle.
In recordings of eight arms, whole and in halves, these explain up to 0.62 and 0.34."""

EXPLAINED_BY_DIRECTION, EXPLAINED_BY_POSITION = 0.95, 0.9
"""The limits that are used instead of `EXPLAINED` for friction that depends on the direction, and for a spring. On
recorded arms, friction and weights of the links that the model describes badly explain up to 0.93 and 0.8."""

FELT, FELT_OF_HYSTERESIS = 0.03, 0.1
"""Smallest residual of the joint without the law, relative to the standard deviation of its torque; for hysteresis it
is larger, because a joint that sticks in closed loop has up to 0.043 that looks like hysteresis."""

HELDOUT = 0.3
"""Smallest decrease of the logarithm of the error of the joint on left-out motion by the law."""

SHARE = 0.1
"""Smallest standard deviation of the torque of the law, relative to that of the torque of the joint."""

WIDTHS = (0.05, 0.1, 0.2)
"""Deflections [rad or m] of the hysteresis elements that are tried. Static friction of a joint that sticks looks like
smaller ones."""

WAVES = np.arange(6.0, 40.5, 0.5)
"""Numbers of waves of the torque in a turn of the joint that are tried. Fewer waves look like gravity and errors of
the geometry: on recorded arms, four waves explain up to 0.7 of the residual."""

HINT = 0.3
"""Share of the squared residual that a wave must explain so that its law is tried."""

TURNS = 1.5
"""Smallest number of waves within the range of the joint; fewer waves do not show that the torque repeats."""


NOISY = "channel-noisy"
"""Code of the findings on waves in time."""


def check(evidence: LogEvidence) -> list[Finding]:
    """Reports springs over two joints, waves, and each joint whose residual follows a law that the model lacks.

    If the study has terms that the doctor's model lacks, springs and laws are not reported, because what these terms
    explain would look like them; what was preferred to another fault is reported.
    """
    by_angle, names = evidence.explained(ANGLE), evidence.robot.joint_names
    pairs = {", ".join(pair): pair for pair in permutations(names, 2)}
    springs = [each for each in by_angle if each.channel in pairs]
    others = [each for each in by_angle if each.channel not in pairs]
    others += [each for code in (FRICTION, NOISY) for each in evidence.explained(code)]
    if evidence.corrected is not None and _has_further_terms(evidence, evidence.corrected):
        return others
    known = {each.channel for each in others} | {name for each in springs for name in pairs[each.channel]}
    single = _of_single_joints(evidence, known)
    known |= {each.channel for each in single}
    return [*springs, *others, *single, *_of_large_residuals(evidence, known)]


def explain(state: LogState) -> Explanation | None:
    """Explains the misfit by a spring over two joints, or by one cause in all torques; `None` if there is none."""
    found = [each for each in (spring_over_two_joints.explain(ANGLE, state), common_causes.explain(state)) if each]
    return max(found, key=lambda each: each.gain, default=None)


def _of_single_joints(evidence: LogEvidence, known: Collection[str]) -> list[Finding]:
    """Reports each joint whose residual follows a law that the model does not have, except joints that are known."""
    state = evidence.corrected
    if state is None:
        return []
    if state.log.band.is_open or not all(run.consecutive for run in state.log.runs):
        return []
    added = AddedColumns(state)
    best: dict[int, tuple[float, MissingLaw]] = {}
    for law in (*_plain(state), *_hystereses(state), *_ripples(state), *local_laws(state)):
        if evidence.robot.joint_names[law.joint] in known:
            continue
        decrease = added.decrease_together(law.joint, law.columns)
        if decrease > max(best.get(law.joint, (0.0, law))[0], _least(law)):
            best[law.joint] = decrease, law
    found = [_finding(evidence, state, law, decrease) for decrease, law in best.values()]
    return [finding for finding in found if finding is not None]


def _of_large_residuals(evidence: LogEvidence, known: Collection[str]) -> list[Finding]:
    """Reports joints whose residual is larger than what models of sound arms leave, except joints that are known."""
    state = evidence.corrected
    if state is None or state.log.band.is_open or not all(run.consecutive for run in state.log.runs):
        return []
    return large_residual.findings(state, np.array([name in known for name in evidence.robot.joint_names]))


def _has_further_terms(evidence: LogEvidence, state: LogState) -> bool:
    """True if the study has torque terms that the doctor's model lacks."""
    known = {term.name for term in state.model.terms}
    return evidence.model is not None and any(term.name not in known for term in evidence.model.terms)


def _least(law: MissingLaw) -> float:
    """Smallest decrease of the squared residuals for which a law is reported."""
    if law.cause:
        return EXPLAINED_LOCALLY
    return {"asymmetric-viscous": EXPLAINED_BY_DIRECTION, "": EXPLAINED_BY_POSITION}.get(law.term, EXPLAINED)


def _plain(state: LogState) -> list[MissingLaw]:
    """Laws of the velocity or of the position of each joint, without parameters."""
    drag = state.at_rows(lambda run: run.motion.dq * np.abs(run.motion.dq))
    direction = state.at_rows(lambda run: np.abs(run.motion.dq))
    angle = state.at_rows(lambda run: run.motion.q)
    laws: list[MissingLaw] = []
    for j in range(state.rows.n):
        square = {"exponent": 2.0}
        laws += [
            MissingLaw(j, FRICTION, "the square of its velocity", drag[None, :, j], "power-viscous", square),
            MissingLaw(j, FRICTION, "the direction of its velocity", direction[None, :, j], "asymmetric-viscous", {}),
            MissingLaw(j, ANGLE, "its position, as that of a spring does", angle[None, :, j], "", {}),
        ]
    return laws


def _hystereses(state: LogState) -> list[MissingLaw]:
    """Laws of the path since a reversal of each joint."""
    every = np.arange(state.rows.n, dtype=np.int32)
    laws: list[MissingLaw] = []
    for width in WIDTHS:
        widths = np.full(state.rows.n, width)
        path = state.at_rows(lambda run, widths=widths: run.motion.q - kernel.play(run.motion.q, every, widths)[0])
        for j, joint in enumerate(state.model.robot.joints):
            text = f"its path over {width:g} {joint.unit} since a reversal"
            laws.append(MissingLaw(j, FRICTION, text, path[None, :, j], "hysteresis", {"widths": [width]}))
    return laws


def _ripples(state: LogState) -> list[MissingLaw]:
    """Laws that are periodic in the angle of a joint, with the number of waves that explains most of the residual."""
    laws: list[MissingLaw] = []
    for j, joint in enumerate(state.model.robot.joints):
        wave = None if joint.is_prismatic else _strongest_wave(state, j)
        if wave is None:
            continue

        def columns(run: ObservedRun, j: int = j, wave: float = wave) -> Array:
            phase = wave * run.motion.q[:, j]
            return np.stack([np.sin(phase), np.cos(phase)], axis=1)

        text = f"its angle, with {wave:g} waves in a turn"
        laws.append(MissingLaw(j, ANGLE, text, state.at_rows(columns).T, "ripple", {"harmonics": [wave]}))
    return laws


def _strongest_wave(state: LogState, j: int) -> float | None:
    """Number of waves in a turn that explains most of the residual of joint j; `None` if none explains enough."""
    q, residual = state.rows.motion.q[:, j], state.fit.residual[:, j]
    tried = WAVES[WAVES * np.ptp(q) > 2.0 * np.pi * TURNS]
    power = float(residual @ residual) * int(state.rows.mask[:, j].sum())
    if not len(tried) or power <= 0.0:
        return None
    share = 2.0 * np.abs(np.exp(1j * np.outer(tried, q)) @ residual) ** 2 / power
    best = int(np.argmax(share))
    return float(tried[best]) if share[best] > HINT else None


def _finding(evidence: LogEvidence, state: LogState, law: MissingLaw, decrease: float) -> Finding | None:
    """Finding about a law; `None` if the law is small, or does not lower the error on left-out motion."""
    j, after = law.joint, _with_law(state.rows, law)
    fit = solve(after)
    torque = fit.values[-len(law.columns) :] @ law.columns
    included = state.rows.mask[:, j]
    whole = max(float(np.std(state.rows.torque[included, j])), np.finfo(float).tiny)
    share = float(np.std(torque[included])) / whole
    trial = try_remedy(state.rows, after)
    felt = FELT_OF_HYSTERESIS if law.term == "hysteresis" else FELT
    if state.fit.sigma[j] < felt * whole or share < SHARE or (trial.before - trial.after) * state.rows.n < HELDOUT:
        return None
    name = evidence.robot.joint_names[j]
    unit = evidence.robot.joints[j].effort_unit
    text = (
        f"The torque of {name} contains a part that depends on {law.text}, and that the model lacks: "
        f"{np.std(torque[included]):.3g} {unit} (standard deviation), {share:.0%} of the torque. With it, the "
        f"residual of the joint is {fit.sigma[j]:.3g} instead of {state.fit.sigma[j]:.3g} {unit}. {trial}"
    )
    return Finding(law.code, "warning", name, text, _remedy(evidence, law))


def _with_law(rows: QuickRows, law: MissingLaw) -> QuickRows:
    """Rows with the columns of a law as further parameters of its joint."""
    j, k = law.joint, len(law.columns)
    columns, parameters = list(rows.columns), list(rows.parameters)
    columns[j] = np.concatenate([columns[j], law.columns])
    parameters[j] = np.concatenate([parameters[j], np.arange(rows.count, rows.count + k, dtype=np.int32)])
    return replace(rows, columns=tuple(columns), parameters=tuple(parameters), count=rows.count + k)


def _remedy(evidence: LogEvidence, law: MissingLaw) -> str:
    """Lines of a study with the term of the law; by hand if no term has it."""
    if law.cause:
        return law.cause
    if not law.term:
        return "find out the cause (spring, counterweight, cable or hose) and remove it, or subtract its torque"
    settings: dict[str, Any] = {"terms": [*term_names(evidence), law.term]}
    if law.options:
        settings[law.term] = dict(law.options)
    return lines("", "model", **settings).marked()


CHECK = LogCheck(
    look=check,
    scope="format",
    effects={
        FRICTION: "The friction that the model lacks biases the other parameters, and predictions are wrong by this "
        "torque.",
        ANGLE: "The torque that the model lacks is attributed to the weight of the links.",
        NOISY: "What the wave adds to the torque biases the parameters, and more so at its frequency.",
        large_residual.CODE: "What the model lacks biases all parameters of these joints, and of the links that they "
        "carry.",
    },
    explain=explain,
    follows=("channel-dead", "velocity-mismatch", "motor-side", "torque-unit", "degrees"),
)
