"""Clean inputs of arms without torque: a description with servos, and recordings of commands in each form."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

JOINTS = ("joint_1", "joint_2", "joint_3")

STUDY = """
[robot]
description = "servo.xml"
[[recording]]
path = "servo.csv"
units = "rad"
[servo]
stiffness = [17.0, 17.0, 17.0]
stiffness_deviation = 0.1
damping = 0.2
delay = 0.01
link_deviation = 0.1
"""

SRDF = """<?xml version="1.0"?>
<robot name="small">
  <group name="arm"><chain base_link="base" tip_link="link_3"/></group>
  <disable_collisions link1="link_1" link2="link_2" reason="Adjacent"/>
  <disable_collisions link1="link_2" link2="link_3" reason="Never"/>
</robot>
"""

SECONDS = 5.0
"""Length of the recording, enough for a first estimate and short enough for hundreds of runs."""

Table = tuple[np.ndarray, np.ndarray, np.ndarray]
"""Time (N,), positions (N, 3) and commands (N, 3)."""


def write_servo_inputs(folder: Path) -> None:
    """Writes a description with servos, an SRDF, a study, and one recording in each form; takes a few seconds."""
    from armid.export.servos.mjcf_actuators import servo_mjcf
    from servo_labs import any_parameters, recorded, servo_model, small_arm

    rng, model = np.random.default_rng(5), servo_model(small_arm())
    truth = any_parameters(model, rng)
    (folder / "servo.xml").write_bytes(servo_mjcf(model, truth))
    run = recorded(model, truth, rng, SECONDS + 0.5)
    table = run.time, np.asarray(run.q), run.held(run.time)
    (folder / "servo.toml").write_text(STUDY)
    (folder / "small.srdf").write_text(SRDF)
    _write_csv(folder / "servo.csv", table)
    other = recorded(model, truth, rng, SECONDS)
    _write_csv(folder / "servo-other.csv", (other.time, np.asarray(other.q), other.held(other.time)))
    _write_lerobot(folder / "lerobot", table)
    _write_aloha(folder / "episode.hdf5", table)
    _write_sage(folder / "sage", table)
    _write_controller_bag(folder / "bag", table)


def _write_csv(path: Path, table: Table) -> None:
    time, q, command = table
    header = ",".join(["t", *(f"{name}{k}" for name in ("q", "command") for k in (1, 2, 3))])
    rows = "\n".join(",".join(map(repr, row)) for row in np.column_stack([time, q, command]).tolist())
    path.write_text(f"{header}\n{rows}\n")


def _write_lerobot(folder: Path, table: Table) -> None:
    import pyarrow as pa
    import pyarrow.parquet as pq

    time, q, command = table
    (folder / "meta").mkdir(parents=True)
    (folder / "data" / "chunk-000").mkdir(parents=True)
    of_motors = {"dtype": "float32", "shape": [3], "names": [f"{name}.pos" for name in JOINTS]}
    plain = {"dtype": "float32", "shape": [1], "names": None}
    features = {"observation.state": of_motors, "action": of_motors, "timestamp": plain, "episode_index": plain}
    record = {"codebase_version": "v3.0", "robot_type": "arm", "fps": 50, "features": features}
    (folder / "meta" / "info.json").write_text(json.dumps(record))
    lists = {"observation.state": q.tolist(), "action": command.tolist()}
    count = np.zeros(len(time), dtype=np.int64)
    pq.write_table(
        pa.table({**lists, "timestamp": time, "episode_index": count}),
        folder / "data" / "chunk-000" / "file-000.parquet",
    )


def _write_aloha(path: Path, table: Table) -> None:
    import h5py

    _, q, command = table
    with h5py.File(path, "w") as file:
        file["observations/qpos"], file["action"] = q, command
        file["observations/qvel"] = np.gradient(q, 0.02, axis=0)


def _write_sage(folder: Path, table: Table) -> None:
    time, q, command = table
    folder.mkdir()
    speed = np.gradient(q, time, axis=0)

    def cells(*values: np.ndarray) -> str:
        return ",".join(f'"{each.tolist()}"' for each in values)

    stamps = (1e6 * time).tolist()
    states = [f"STATE_MOTOR,{t!r},{cells(row, v, abs(v))}" for t, row, v in zip(stamps, q, speed, strict=True)]
    given = [f"CONTROL,{t!r},{cells(row)}" for t, row in zip(stamps, command, strict=True)]
    for name, header, rows in (
        ("state_motor.csv", "type,timestamp,positions,velocities,torques", states),
        ("control.csv", "type,timestamp,positions", given),
        ("event.csv", "type,timestamp,event", [f"EVENT,{stamps[5]!r},CONTROL_MODE_ENABLE"]),
    ):
        (folder / name).write_text("\n".join([header, *rows]) + "\n")
    (folder / "joint_list.txt").write_text("\n".join(JOINTS) + "\n")


def _write_controller_bag(folder: Path, table: Table) -> None:
    """Writes a bag folder with states of a controller: positions and references."""
    from armid.measurement.readers.bag import CONTROLLER
    from recordings import ros_types, write_bag_folder

    kinds = ros_types().types
    none, begin = np.zeros(0), 1_600_000_000_000_000_000
    length = kinds["builtin_interfaces/msg/Duration"](sec=0, nanosec=0)

    def point(values: np.ndarray):
        kind = kinds["trajectory_msgs/msg/JointTrajectoryPoint"]
        return kind(
            positions=np.ascontiguousarray(values), velocities=none, accelerations=none, effort=none,
            time_from_start=length,
        )  # fmt: skip

    several = kinds["trajectory_msgs/msg/MultiDOFJointTrajectoryPoint"](
        transforms=[], velocities=[], accelerations=[], time_from_start=length
    )
    messages = []
    for t, q, command in zip(*table, strict=True):
        at = begin + int(1e9 * t)
        stamp = kinds["builtin_interfaces/msg/Time"](sec=at // 10**9, nanosec=at % 10**9)
        state = kinds[CONTROLLER](
            header=kinds["std_msgs/msg/Header"](stamp=stamp, frame_id=""),
            joint_names=list(JOINTS),
            reference=point(command), feedback=point(q), error=point(none), output=point(none),
            multi_dof_joint_names=[],
            **{f"multi_dof_{name}": several for name in ("reference", "feedback", "error", "output")},
        )  # fmt: skip
        messages.append((at, state))
    write_bag_folder(folder, messages, topic="/controller/state", kind=CONTROLLER)
