"""Memory along a run: the states of a model's memory nodes at full rate, and the rows before they are known.

A run begins with unknown states, whatever was before it. Until the motion alone decides them, the columns that read
them are a guess, and a filter carries that guess further; such rows do not count, neither to estimate nor to judge.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from armid.errors import ArmidError, Finding
from armid.maths.signals import edge_samples, low_pass
from armid.measurement.band import Band
from armid.measurement.observations import Observations, ObservedRun
from armid.model.dynamics import DynamicsModel

__all__ = ["memory_findings", "require_consecutive", "with_hysteresis_states"]

NOTABLE = 0.2
"""Share of a joint's rows whose loss to an unknown memory is worth a finding; a second of five."""


def with_hysteresis_states(model: DynamicsModel, run: ObservedRun, band: Band) -> ObservedRun:
    """A run with what a model remembers along it; the same run where it remembers nothing, or has it already.

    Args:
        model: Arm and torque terms.
        run: One contiguous run at full rate.
        band: Filter that columns will pass.

    Returns:
        The run, its motion with states; rows of a joint that its unknown states reach are masked.

    Raises:
        ArmidError: The run's samples do not follow each other in time.
    """
    if not model.nodes or run.motion.memory is not None:
        return run
    if not run.consecutive:
        raise ArmidError(
            f"The term {model.nodes[0].term!r} needs to know what happened before, but the samples of recording "
            f"{run.recording + 1} do not follow each other in time.",
            remedy=f"leave {model.nodes[0].term!r} out, or leave this recording out.",
        )
    motion, known = model.remembered(run.motion)
    mask = run.mask & ~_unknown(run, band, _known_joints(model, known))
    return replace(run, motion=motion, mask=mask)


def require_consecutive(model: DynamicsModel, given: Observations, rows: NDArray[np.int64]) -> None:
    """Refuse a model whose memory leaves no row of a joint that has rows.

    Args:
        model: Arm and torque terms.
        given: Observations as they were before anything was remembered.
        rows: Rows that were left of each joint, shape (n,).

    Raises:
        ArmidError: There is such a joint.
    """
    had = np.sum([run.mask.any(axis=0) for run in given.runs], axis=0) > 0
    lost = np.flatnonzero(had & (rows == 0))
    if model.nodes and len(lost):
        names = ", ".join(model.robot.joint_names[j] for j in lost)
        widest = max(n.memory.width for n in model.nodes if any(j in lost for j, _ in n.coordinate))
        raise ArmidError(
            f"No row of {names} is left: the motion never sweeps the {2.0 * widest:g} rad or m, and the time of the "
            f"filter after that, from which on the memory of {model.nodes[0].term!r} is known.",
            remedy="choose smaller widths, restrict the term to joints that move more, or record longer.",
        )


def memory_findings(model: DynamicsModel, observations: Observations) -> tuple[Finding, ...]:
    """Joints and runs of which many rows do not count because the memory is not known yet."""
    findings: list[Finding] = []
    for run in observations.runs if model.nodes else ():
        left = with_hysteresis_states(model, run, observations.band).mask.sum(axis=0)
        had = run.mask.sum(axis=0)
        findings += [
            Finding(
                "memory-unknown",
                "warning" if left[j] == 0 else "info",
                model.robot.joint_names[j],
                f"{had[j] - left[j]} of {had[j]} rows of a run of recording {run.recording + 1} come before the "
                f"motion has decided what {model.nodes[0].term!r} remembers.",
                "They do not count for this joint.",
            )
            for j in np.flatnonzero(had - left > NOTABLE * had)
        ]
    return tuple(findings)


def _known_joints(model: DynamicsModel, known: NDArray[np.int64]) -> NDArray[np.int64]:
    """First sample at which all states that act on each joint are known, shape (n,)."""
    since = np.zeros(model.n, dtype=np.int64)
    for node, first in zip(model.nodes, known, strict=True):
        for j, _ in node.coordinate:
            since[j] = max(since[j], first)
    return since


def _unknown(run: ObservedRun, band: Band, since: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Rows that samples before `since`, of each joint, reach through the filter, shape (M, n)."""
    filter = None if not band.columns else low_pass(band.family, band.order, band.cutoff, run.rate)
    reach = 0 if filter is None else edge_samples(filter)
    rows = run.rows[:, None]
    reached = (rows < since + reach) & (since > 0)
    if filter is not None and band.edges == "periodic":
        # The run goes round: its end stands before its beginning.
        reached |= (rows >= run.motion.samples - reach) & (since > 0)
    return reached
