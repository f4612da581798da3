"""Assignment of the channels of a recording to the joints of a robot."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from armid.errors import Finding, RecordingError
from armid.maths.median import median
from armid.measurement.columns.joint_names import comparison
from armid.measurement.log_format import LogFormat
from armid.measurement.recording import Recording
from armid.robot.robot import Held, Robot
from armid.values import Array

MOVES = {"rad": 0.01, "m": 1e-3}
"""Position range above which a locked joint counts as moving: more than noise or the play of a brake."""

ELSEWHERE = {"rad": 0.05, "m": 5e-3}
"""Distance from the stated position of a locked joint that changes the gravity torques noticeably."""

LISTED = 20
"""Largest number of channel names in a finding; a humanoid publishes fifty."""


def in_joint_order(
    recording: Recording, log_format: LogFormat, robot: Robot
) -> tuple[Recording, tuple[Finding, ...]]:
    """Selects the channels of the robot's joints in its order, with findings about the other channels.

    Raises:
        RecordingError: Joints and channels that do not match.
    """
    targets = _targets(recording, log_format, robot)
    order = [targets.index(name) for name in robot.joint_names]
    findings = _others(recording, log_format, robot, targets)

    def ordered(values: Array | None) -> Array | None:
        return None if values is None else values[:, order]

    kept = replace(
        recording,
        q=recording.q[:, order],
        dq=ordered(recording.dq),
        ddq=ordered(recording.ddq),
        effort=ordered(recording.effort),
        valid=recording.valid[:, order],
        joint_names=robot.joint_names,
        columns={name: _reordered(columns, order, recording.n, name) for name, columns in recording.columns.items()},
    )
    return kept, findings


def _reordered(columns: tuple[str, ...], order: list[int], channels: int, quantity: str) -> tuple[str, ...]:
    """Columns of a quantity in the order of the joints; times and matrices as they are."""
    by_joint = quantity != "time" and len(columns) == channels
    return tuple(columns[k] for k in order) if by_joint else columns


def _targets(recording: Recording, log_format: LogFormat, robot: Robot) -> list[str]:
    """Owner of each channel: a joint of the robot, a locked joint, a joint of another arm, or none (empty)."""
    given = log_format.joint_map
    channels = recording.channels
    unknown = [name for name in given if name not in channels]
    if unknown:
        raise RecordingError(
            f"{recording.source}: joints names unknown channels: {', '.join(unknown)}.",
            possible=", ".join(channels),
        )
    if recording.joint_names or given:
        targets = [given.get(name, name if recording.joint_names else "?") for name in channels]
    else:
        targets = list(by_number(recording, robot))
    known = {*robot.joint_names, *(held.name for held in robot.held)}
    named = {*given.values(), "?"}
    missing = [name for name in robot.joint_names if name not in targets]
    extra = [channels[i] for i, name in enumerate(targets) if name and name not in known]
    wrong = [channels[i] for i, name in enumerate(targets) if name and name not in known and name in named]
    twice = sorted({name for name in targets if name in known and targets.count(name) > 1})
    if missing or wrong or twice:
        parts = [
            f"{what}: {', '.join(x)}" for what, x in (("missing", missing), ("extra", extra), ("twice", twice)) if x
        ]
        none = not set(robot.joint_names) & set(targets)
        compared = f" {comparison(channels, robot.joint_names, robot.name)}" if none else ""
        raise RecordingError(
            f"{recording.source} does not have the joints of {robot.name} ({'; '.join(parts)}).{compared}",
            possible=f"joints {', '.join(robot.joint_names)}; channels {', '.join(channels)}",
            remedy=("give the description of the recorded arm; or " if none else "")
            + "rename with joints = { file name = robot joint }, leave a channel out by an empty name, and lock "
            "joints that were not recorded.",
        )
    return targets


def by_number(recording: Recording, robot: Robot) -> tuple[str, ...]:
    """Joints of unnamed channels: those of the robot, or of its description where some are locked.

    Raises:
        RecordingError: The number of channels is neither.
    """
    described = robot.described_joints
    if recording.n == robot.n:
        return robot.joint_names
    if recording.n == len(described):
        return described
    held = f", and holds {', '.join(each.name for each in robot.held)} still" if robot.held else ""
    raise RecordingError(
        f"{recording.source} has {recording.n} channels; {robot.name} has {robot.n} joints: "
        f"{', '.join(robot.joint_names)}{held}.",
        remedy="name the part of the arm recorded (--tip or --only), lock the joints that were not (--lock), "
        'or name the joint of each channel: joints = ["…", …], '
        "with an empty name for a channel to leave out.",
    )


def _others(recording: Recording, log_format: LogFormat, robot: Robot, targets: list[str]) -> tuple[Finding, ...]:
    """Findings about channels that belong to no joint of the robot."""
    held = {each.name: each for each in robot.held}
    found = [_of_held(recording.q[:, k], held[name], log_format) for k, name in enumerate(targets) if name in held]
    extra = [
        name
        for name, target in zip(recording.channels, targets, strict=True)
        if target and target not in held and target not in robot.joint_names
    ]
    if extra:
        more = f" and {len(extra) - LISTED} more" if len(extra) > LISTED else ""
        evidence = f"{', '.join(extra[:LISTED])}{more}: not joints of {robot.name}, left out."
        found.append(Finding("joints-extra", "info", "", evidence))
    return tuple(finding for finding in found if finding is not None)


def _of_held(q: Array, held: Held, log_format: LogFormat) -> Finding | None:
    """Findings about a locked joint: it moves, or it is at another position than stated."""
    q = q[np.isfinite(q)]
    if not q.size or log_format.transmission is not None:
        return None
    q = np.radians(q) if log_format.units == "deg" and held.unit == "rad" else q
    low, high, middle = float(q.min()), float(q.max()), float(median(q))
    if high - low > MOVES[held.unit]:
        evidence = (
            f"The joint is held still at {held.position:g} {held.unit}; the log has it from {low:.4g} to {high:.4g}."
        )
        return Finding("locked-joint", "warning", held.name, evidence, "record it at rest, or leave it free.")
    if abs(middle - held.position) > ELSEWHERE[held.unit]:
        evidence = f"The joint is held still at {held.position:g} {held.unit}; the log has it at {middle:.4g}."
        place = f"{held.name} = {middle:.4g}"
        remedy = f"correct where it is held: --lock {place.replace(' ', '')}, or locked = {{ {place} }}."
        return Finding("locked-joint", "warning", held.name, evidence, remedy)
    return None
