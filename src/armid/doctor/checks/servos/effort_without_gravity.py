"""Check for efforts without weight: those beside a controller's model of gravity, or external torques."""

from __future__ import annotations

import numpy as np

from armid import kernel
from armid.checked_array import Array
from armid.doctor.check_definition import LogCheck
from armid.doctor.check_input import LogEvidence
from armid.errors import Finding
from armid.maths.signals.zero_phase_filters import butterworth, zero_phase

CUTOFF = 3.0
"""Cut-off of the low-pass filter of torques and columns [Hz]."""

WIDTH = 0.02
"""Velocity over which the sign of dry friction changes [rad/s or m/s]."""

LOADED = 0.3
"""Share of the largest change of a weight among the joints from which a joint counts."""

VISIBLE = 0.7
"""Size of the described weight of a joint, over its effort without friction, from which it would be seen."""

LEAST = 0.3
"""Share of the effort without friction that weights of any direction explain if there is any."""

SHORTEST = 5.0
"""Shortest log that is checked [s]."""

ROWS = 20.0
"""Rows that are used in a second, over the cut-off: filtered signals hardly change from one row to the next."""


def check(evidence: LogEvidence) -> list[Finding]:
    """Reports efforts in which no weight of any link or direction is seen, although the arm has moved its weight."""
    recording = evidence.recording
    bodies = evidence.robot.inertial_vector
    if recording is None or recording.effort is None or recording.consecutive is False or bodies is None:
        return []
    finite = recording.valid & np.isfinite(recording.q) & np.isfinite(recording.effort)
    rows = np.asarray(finite.all(axis=1), dtype=np.bool_)
    first, last = (int(np.argmax(rows)), len(rows) - int(np.argmax(rows[::-1]))) if rows.any() else (0, 0)
    seconds = (last - first) / evidence.rate
    if not rows[first:last].all() or seconds < SHORTEST or evidence.rate < 2.5 * CUTOFF:
        return []
    every = max(1, int(evidence.rate / (ROWS * CUTOFF)))
    shares = _shares(evidence, bodies, slice(first, last), every, seconds)
    if shares is None:
        return []
    weights, seen, joints = shares
    if not joints or (seen > LEAST).any():
        return []
    names = ", ".join(evidence.robot.joint_names[j] for j in joints)
    what = (
        f"The described weight changes by {', '.join(f'{x:.3g}' for x in weights)} N·m RMS during the motion, but "
        f"the efforts of {names} contain no weight of any link, in any direction of gravity."
    )
    remedy = (
        "log the whole torque of the drives: a controller often logs its feedback alone, or the torque beside its "
        "model of gravity; add this model to the log otherwise."
    )
    return [Finding("effort-without-gravity", "error", "effort", what, remedy)]


def _shares(
    evidence: LogEvidence, bodies: Array, rows: slice, every: int, seconds: float
) -> tuple[Array, Array, list[int]] | None:
    """Weight, explained share of the effort and index of each joint whose weight would be seen."""
    recording, tree = evidence.recording, evidence.robot.tree
    assert recording is not None and recording.effort is not None
    rate = evidence.rate
    sections = butterworth(2, CUTOFF, rate)

    def low_pass(x: Array) -> Array:
        return zero_phase(sections, x)

    q = low_pass(recording.q[rows])
    dq = np.gradient(q, 1.0 / rate, axis=0)
    ddq = np.gradient(dq, 1.0 / rate, axis=0)
    effort = low_pass(recording.effort[rows])
    dry = low_pass(np.tanh(dq / WIDTH))
    at = slice(round(0.5 * rate), len(q) - round(0.5 * rate), every)
    q, dq, ddq, effort, dry = (np.ascontiguousarray(x[at]) for x in (q, dq, ddq, effort, dry))
    still = np.zeros_like(q)
    own = kernel.gravity_torque(tree, bodies, q)
    moved = kernel.inverse_dynamics(tree, bodies, q, dq, ddq) - own
    directions = [
        kernel.inverse_dynamics(evidence.robot.with_gravity(axis).tree, bodies, q, still, still)
        for axis in 9.81 * np.eye(3)
    ]
    every_weight = np.concatenate(directions, axis=1)
    loaded = np.std(own, axis=0)
    if not loaded.max(initial=0.0) > 0.0:
        return None
    independent = max(2.0 * CUTOFF * seconds, 3.0 * every_weight.shape[1])
    weights: list[float] = []
    seen: list[float] = []
    joints: list[int] = []
    for j in np.flatnonzero(loaded > LOADED * loaded.max()):
        plain = np.column_stack([np.ones(len(q)), dq[:, j], dry[:, j], ddq[:, j], moved[:, j]])
        y, weight = _without(plain, effort[:, j : j + 1]), _without(plain, own[:, j : j + 1])
        if np.std(weight) < VISIBLE * np.std(y) or not np.std(y) > 0.0:
            continue
        rest = _without(_without(plain, every_weight), y)
        chance = (independent - 1.0) / (independent - every_weight.shape[1] - 1.0)
        seen.append(1.0 - chance * float(np.sum(rest**2) / np.sum(y**2)))
        weights.append(float(loaded[j]))
        joints.append(int(j))
    return np.array(weights), np.array(seen), joints


def _without(columns: Array, values: Array) -> Array:
    """Values (N, k) without what columns (N, c) explain."""
    size = np.linalg.norm(columns, axis=0)
    unit = columns[:, size > 0.0] / size[size > 0.0]
    return values - unit @ np.linalg.lstsq(unit, values, rcond=1e-8)[0]


CHECK = LogCheck(
    look=check,
    scope="recording",
    effects={
        "effort-without-gravity": "Masses and centres of mass are estimated as zero, or as negative.",
    },
    untested={"effort-without-gravity": "no line of a study puts the weight back"},
    hides=(
        "gravity-direction",
        "description-does-not-match",
        "position-offset",
        "torque-gain",
        "torque-sign",
        "residual-large",
        "rotor-inertia-missing",
        "excitation-weak",
    ),
    follows=("degrees", "effort-unsigned", "joint-order", "motor-side", "position-sign"),
)
