"""Files of a designed motion of commands: table, LeRobot actions, ROS 2 trajectory, and the record of the design."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from armid.errors import ArmidError, MissingExtraError, OutputError, did_you_mean
from armid.excitation.command_motion import CommandMotion
from armid.excitation.formats import ros2
from armid.excitation.formats.sampled_motion import SampledMotion
from armid.measurement.writers.lerobot import Episode, lerobot_files
from armid.model.motion import Motion
from armid.robot.robot import Robot
from armid.servo.motion_design.search import CommandDesign
from armid.servo.parameters import ServoModel
from armid.study.plans.plan_reading import PLAN_FILE
from armid.study.storage.atomic_folder import whole_folder
from armid.study.storage.records import to_json

TABLE, TRAJECTORY, LEROBOT = "commands.csv", f"commands{ros2.SUFFIX}", "lerobot"
"""Names of the files of a motion of commands; the last one is a folder."""

Limits = Mapping[tuple[str, str], float | tuple[float, float]]


def limited_robot(robot: Robot, limits: Limits) -> Robot:
    """Arm with other limits of position, velocity and effort.

    Args:
        robot: The arm.
        limits: Limits by joint, or `*`, and kind: position, velocity or effort.

    Raises:
        ArmidError: There is no such joint or kind, or a value is impossible.
    """
    joints = list(robot.joints)
    fields = {"position": "position_limits", "velocity": "velocity_limit", "effort": "effort_limit"}
    for (name, kind), value in limits.items():
        if name != "*" and name not in robot.joint_names:
            raise ArmidError(
                f"--limit {name}.{kind}: {robot.name} has no joint {name!r}.",
                possible=", ".join(robot.joint_names),
                remedy=did_you_mean(name, robot.joint_names),
            )
        pair = isinstance(value, tuple)
        right = kind in fields and pair == (kind == "position")
        if not right or (value[0] >= value[1] if isinstance(value, tuple) else not value > 0.0):
            raise ArmidError(
                f"--limit {name}.{kind} has no meaning for a motion of commands with the value {value}.",
                possible="JOINT.position=LOW:HIGH, JOINT.velocity=V, JOINT.effort=T",
                remedy="correct the limit, or leave it out.",
            )
        for k, joint in enumerate(joints):
            if name in ("*", joint.name):
                joints[k] = replace(joint, **{fields[kind]: value})
    return replace(robot, joints=tuple(joints))


def command_plan_record(design: CommandDesign, model: ServoModel) -> dict[str, Any]:
    """Content of the file `plan.json` of a motion of commands."""
    joints = model.robot.joint_names
    deviations: dict[str, dict[str, float]] = {}
    for (field, k), value in design.deviations.items():
        law = model.laws[k] if field == "friction" else None
        kind, joint = (field, k) if law is None else (law.symbol, law.joint)
        deviations.setdefault(kind, {})[joints[joint]] = value
    return {
        "robot": model.robot.name,
        "joints": joints,
        "rate": design.commands.rate,
        "duration": design.commands.seconds,
        "criterion": design.value,
        "expected_deviations": deviations,
        "torque_share": design.torque_share,
        "positions": design.positions,
        "trials": design.trials,
    }


def save_command_plan(design: CommandDesign, model: ServoModel, folder: Path | str) -> tuple[str, ...]:
    """Writes the folder of a motion of commands, completely or not at all; returns the names of the files.

    Formats that cannot represent the motion are left out: LeRobot data sets have angles and whole rates.
    """
    robot, commands = model.robot, design.commands
    files: dict[str, bytes] = {
        TABLE: commands.csv().encode(),
        TRAJECTORY: ros2.write(_track(robot, commands)),
        PLAN_FILE: (to_json(command_plan_record(design, model)) + "\n").encode(),
    }
    if not any(joint.is_prismatic for joint in robot.joints):
        try:
            parts = lerobot_files([Episode(commands.command)], robot.joint_names, commands.rate, robot.name)
        except (OutputError, MissingExtraError):
            parts = {}
        files |= {f"{LEROBOT}/{name}": content for name, content in parts.items()}
    with whole_folder(folder, PLAN_FILE, "plan") as draft:
        for name, content in files.items():
            (draft / name).parent.mkdir(parents=True, exist_ok=True)
            (draft / name).write_bytes(content)
    return tuple(dict.fromkeys(name.split("/")[0] for name in files))


def _track(robot: Robot, commands: CommandMotion) -> SampledMotion:
    """Motion with velocities and accelerations, as a controller of trajectories reads it."""
    dq = np.gradient(commands.command, 1.0 / commands.rate, axis=0)
    ddq = np.gradient(dq, 1.0 / commands.rate, axis=0)
    motion = Motion(commands.time, commands.command, dq, ddq)
    return SampledMotion(robot.name, robot.joint_names, tuple(j.is_prismatic for j in robot.joints), motion)
