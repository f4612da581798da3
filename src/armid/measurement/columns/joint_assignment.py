"""Assignment of the channels of a recording to the joints of a robot."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from armid.checked_array import Array
from armid.errors import Finding, RecordingError, did_you_mean
from armid.maths.median import median
from armid.measurement.columns.joint_name_comparison import comparison
from armid.measurement.log_format import LogFormat
from armid.measurement.recording import Recording
from armid.robot.robot import Held, Robot

MOVES = {"rad": 0.01, "m": 1e-3}
"""Range of the positions of a locked joint above which it counts as moving, by unit [rad or m]; noise and the play of
a brake cause less."""

ELSEWHERE = {"rad": 0.05, "m": 5e-3}
"""Distance of a locked joint from its stated position above which gravity torques change noticeably, by unit [rad or
m]."""

LISTED = 20
"""Largest number of channel names in a finding, because a humanoid robot can have fifty channels."""


def in_joint_order(
    recording: Recording, log_format: LogFormat, robot: Robot
) -> tuple[Recording, tuple[Finding, ...]]:
    """Selects the channels of the robot's joints, in the order of the robot; other channels are named in findings.

    Raises:
        RecordingError: Joints and channels do not match.
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
        command=ordered(recording.command),
        valid=recording.valid[:, order],
        joint_names=robot.joint_names,
        columns={name: _reordered(columns, order, recording.n, name) for name, columns in recording.columns.items()},
    )
    return kept, findings


def _reordered(columns: tuple[str, ...], order: list[int], channels: int, quantity: str) -> tuple[str, ...]:
    """Columns of a quantity in the order of the joints; columns of time and matrices are returned unchanged."""
    by_joint = quantity != "time" and len(columns) == channels
    return tuple(columns[k] for k in order) if by_joint else columns


def _targets(recording: Recording, log_format: LogFormat, robot: Robot) -> list[str]:
    """Name of the joint of each channel, empty for a channel that is not used.

    The joint may be a joint of the robot, a locked joint or a joint of another arm.
    """
    given = log_format.joint_map
    channels = recording.channels
    unknown = [name for name in given if name not in channels]
    if unknown:
        raise RecordingError(
            f"{recording.source}: the key `joints` names channels that the file does not have: {', '.join(unknown)}.",
            possible=", ".join(channels),
            remedy=did_you_mean(unknown[0], channels) or "use the names of the channels in the file.",
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
            + "assign the channels with joints = { name in the recording = robot joint } (an empty name if the "
            "channel is not used), and lock the joints that were not recorded.",
        )
    return targets


def by_number(recording: Recording, robot: Robot) -> tuple[str, ...]:
    """Joints to which unnamed channels are assigned by their number, in order.

    They are the joints of the robot or, if there is a channel for every joint of its description, all these joints.

    Raises:
        RecordingError: The number of channels is neither that of the robot's joints nor that of all joints.
    """
    described = robot.described_joints
    if recording.n == robot.n:
        return robot.joint_names
    if recording.n == len(described):
        return described
    held = f", and the locked joints {', '.join(each.name for each in robot.held)}" if robot.held else ""
    raise RecordingError(
        f"{recording.source} has {recording.n} channels; {robot.name} has {robot.n} joints: "
        f"{', '.join(robot.joint_names)}{held}.",
        remedy="select the joints that were recorded (--tip or --only), or lock the joints that were not recorded "
        '(--lock). If the file also has other channels, write the joint of each channel, joints = ["…", …], '
        "and an empty name for each channel that is not used.",
    )


def _others(recording: Recording, log_format: LogFormat, robot: Robot, targets: list[str]) -> tuple[Finding, ...]:
    """Findings about channels that do not belong to a moving joint of the robot."""
    held = {each.name: each for each in robot.held}
    found = [_of_held(recording.q[:, k], held[name], log_format) for k, name in enumerate(targets) if name in held]
    extra = [
        name
        for name, target in zip(recording.channels, targets, strict=True)
        if target and target not in held and target not in robot.joint_names
    ]
    if extra:
        more = f" and {len(extra) - LISTED} more" if len(extra) > LISTED else ""
        evidence = (
            f"The channels {', '.join(extra[:LISTED])}{more} are left out, because they are not joints of "
            f"{robot.name}."
        )
        found.append(Finding("joints-extra", "info", "", evidence))
    return tuple(finding for finding in found if finding is not None)


def _of_held(q: Array, held: Held, log_format: LogFormat) -> Finding | None:
    """Finding about a locked joint that moves in the recording or is not at its stated position; otherwise `None`."""
    q = q[np.isfinite(q)]
    if not q.size or log_format.transmission is not None:
        return None
    q = np.radians(q) if log_format.units == "deg" and held.unit == "rad" else q
    low, high, middle = float(q.min()), float(q.max()), float(median(q))
    if high - low > MOVES[held.unit]:
        evidence = (
            f"The joint is locked at {held.position:g} {held.unit}, but in the log it moves from {low:.4g} to "
            f"{high:.4g}."
        )
        return Finding(
            "locked-joint",
            "warning",
            held.name,
            evidence,
            "keep the joint at rest while recording, or do not lock it.",
        )
    if abs(middle - held.position) > ELSEWHERE[held.unit]:
        evidence = f"The joint is locked at {held.position:g} {held.unit}, but in the log it is at {middle:.4g}."
        place = f"{held.name} = {middle:.4g}"
        remedy = (
            f"correct the position of the locked joint: --lock {place.replace(' ', '')}, or lock = {{ {place} }} in "
            "[robot] of the study."
        )
        return Finding("locked-joint", "warning", held.name, evidence, remedy)
    return None
