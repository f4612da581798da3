"""Hysteresis states along a run at the full sampling rate, and the mask of the rows in which they are unknown.

The initial states of a run are unknown. Until the motion determines the states, the columns that depend on them are
wrong, and a filter transfers this error to neighbouring rows. These rows are used neither for the estimate nor for
the validation.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from armid.errors import ArmidError, Finding
from armid.information.joint_rests import filter_reach, resting_rows, rests
from armid.measurement.low_pass_band import Band
from armid.measurement.observations import Observations, ObservedRun
from armid.model.dynamics_model import DynamicsModel

NOTABLE = 0.2
"""Share of the rows of a joint with unknown hysteresis states, above which a finding is reported: one second of
five."""


def with_hysteresis_states(model: DynamicsModel, run: ObservedRun, band: Band) -> ObservedRun:
    """Adds the hysteresis states of a model to a run, if the model has any and the run has none yet.

    Args:
        model: Arm and torque terms.
        run: Contiguous run at the full sampling rate.
        band: Filter of the columns.

    Returns:
        Run whose motion contains the states. For each joint, the rows that unknown states influence are masked.

    Raises:
        ArmidError: The samples of the run are not consecutive.
    """
    if not model.nodes or run.motion.memory is not None:
        return run
    if not run.consecutive:
        raise ArmidError(
            f"The term {model.nodes[0].term!r} depends on the earlier motion, but the samples of recording "
            f"{run.recording + 1} are not consecutive.",
            remedy=f"remove {model.nodes[0].term!r} from the model, or leave out this recording.",
        )
    motion, known = model.remembered(run.motion)
    mask = run.mask & ~_unknown(run, band, _known_joints(model, known)) & ~_after_rests(model, run, band)
    return replace(run, motion=motion, mask=mask)


def with_sliding_states(model: DynamicsModel, run: ObservedRun) -> ObservedRun:
    """Adds hysteresis states to samples without history, as if every joint had slid for long in its direction.

    Samples that are not consecutive do not contain the earlier motion. In motion, most samples are far from a
    reversal, where all play elements slip and the torque of hysteresis is that of Coulomb friction. At zero velocity
    this torque is set to zero.

    Args:
        model: Arm and torque terms with hysteresis.
        run: Samples that need not be consecutive.
    """
    q, dq = run.motion.q, run.motion.dq
    states = np.zeros((run.motion.samples, len(model.nodes)))
    for k, node in enumerate(model.nodes):
        position, velocity = (sum(weight * x[:, j] for j, weight in node.coordinate) for x in (q, dq))
        states[:, k] = position - node.memory.width * np.sign(velocity)
    return replace(run, motion=run.motion.with_memory(states))


def without_creep(observations: Observations) -> Observations:
    """Observations in which the rows of a joint that rests while others move are masked.

    Rows in which all joints rest stay in use.
    """
    runs: list[ObservedRun] = []
    for run in observations.runs:
        resting = resting_rows(run, observations.band)
        runs.append(replace(run, mask=run.mask & (~resting | resting.all(axis=1, keepdims=True))))
    return replace(observations, runs=tuple(runs))


def require_consecutive(model: DynamicsModel, given: Observations, rows: NDArray[np.int64]) -> None:
    """Raises an error if no row of a joint remains because its hysteresis states are unknown in all rows.

    Args:
        model: Arm and torque terms.
        given: Observations before rows with unknown states were masked.
        rows: Number of remaining rows of each joint, shape (n,).

    Raises:
        ArmidError: For a joint, no row remains.
    """
    had = np.sum([run.mask.any(axis=0) for run in given.runs], axis=0) > 0
    lost = np.flatnonzero(had & (rows == 0))
    if model.nodes and len(lost):
        names = ", ".join(model.robot.joint_names[j] for j in lost)
        widest = max(n.memory.width for n in model.nodes if any(j in lost for j, _ in n.coordinate))
        raise ArmidError(
            f"No row of {names} remains: the state of {model.nodes[0].term!r} is known only after a motion of more "
            f"than {2.0 * widest:g} rad or m and the settling time of the filter, but no run contains such a motion "
            "of these joints.",
            remedy="choose smaller widths, restrict the term to joints that move further, or record for longer.",
        )


def memory_findings(model: DynamicsModel, observations: Observations) -> tuple[Finding, ...]:
    """Findings about joints whose hysteresis states are unknown in many rows of a run, one for each joint and run."""
    findings: list[Finding] = []
    for run in observations.runs if model.nodes else ():
        known = with_hysteresis_states(model, run, observations.band).mask.sum(axis=0)
        rows = run.mask.sum(axis=0)
        findings += [
            Finding(
                "memory-unknown",
                "warning" if known[j] == 0 else "info",
                model.robot.joint_names[j],
                f"In {rows[j] - known[j]} of {rows[j]} rows of a run of recording {run.recording + 1}, the motion "
                f"has not yet determined the state of {model.nodes[0].term!r}.",
                "These rows are not used for this joint.",
            )
            for j in np.flatnonzero(rows - known > NOTABLE * rows)
        ]
    return tuple(findings)


def _known_joints(model: DynamicsModel, known: NDArray[np.int64]) -> NDArray[np.int64]:
    """Index of the first sample from which all states that act on a joint are known, for each joint, shape (n,).

    `known` contains this index for each state.
    """
    since = np.zeros(model.n, dtype=np.int64)
    for node, first in zip(model.nodes, known, strict=True):
        for j, _ in node.coordinate:
            since[j] = max(since[j], first)
    return since


def _unknown(run: ObservedRun, band: Band, since: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Mask of the rows that the filter mixes with samples of unknown state, shape (M, n).

    The states of joint j are known from sample `since[j]`.
    """
    reach = filter_reach(run, band)
    rows = run.rows[:, None]
    reached = (rows < since + reach) & (since > 0)
    if reach and band.edges == "periodic":
        # The run is periodic: its end comes before its beginning.
        reached |= (rows >= run.motion.samples - reach) & (since > 0)
    return reached


def _after_rests(model: DynamicsModel, run: ObservedRun, band: Band) -> NDArray[np.bool_]:
    """Mask of the rows from a joint's rest until the motion has determined the states again, shape (M, n).

    It includes the rows that these samples influence through the filter. If the motion does not determine the states
    again, the mask extends to the end of the run.
    """
    samples, reach = run.motion.samples, filter_reach(run, band)
    unknown = np.zeros((samples + 1, model.n), dtype=np.int64)
    resting = rests(run)
    for node in model.nodes:
        coordinate = np.sum([weight * run.motion.q[:, j] for j, weight in node.coordinate], axis=0)
        for j, _ in node.coordinate:
            for begin, end in resting[j]:
                later = coordinate[end - 1 :]
                moved = np.maximum.accumulate(later) - np.minimum.accumulate(later) > 2.0 * node.memory.width
                known = end - 1 + int(np.argmax(moved)) if moved.any() else samples
                for of, _ in node.coordinate:
                    unknown[max(begin - reach, 0), of] += 1
                    unknown[min(known + reach, samples), of] -= 1
    return (np.cumsum(unknown, axis=0) > 0)[run.rows]
