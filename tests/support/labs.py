"""A small arm, recordings of it and files of these, for the tests of studies and of the command line."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest

from armid.checked_array import Array
from armid.excitation.fourier import Excitation
from armid.lab.inverse_dynamics_recording import Sensors, record
from armid.measurement.recording import Recording
from armid.model.dynamics_model import DynamicsModel
from armid.model.terms import Coulomb, RigidBody, RotorInertia, Viscous
from armid.robot import Robot, load_robot

RATE, PERIOD = 100.0, 8.0

SENSORS = Sensors(position=1e-6, torque=0.02, rate=RATE)

LINK = """
  <link name="link_{i}"><inertial><origin xyz="0.02 {y} 0.15"/><mass value="{m}"/>
    <inertia ixx="0.05" iyy="0.04" izz="0.03" ixy="0.001" ixz="0" iyz="0.002"/></inertial></link>
  <joint name="joint_{i}" type="revolute"><parent link="{parent}"/><child link="link_{i}"/>
    <origin xyz="{x} 0 0.2"/><axis xyz="{axis}"/><limit lower="-3" upper="3" velocity="4" effort="80"/></joint>"""

URDF = (
    '<robot name="small">\n  <link name="base"/>'
    + LINK.format(i=1, parent="base", x=0, y=0.0, m=3, axis="0 0 1")
    + LINK.format(i=2, parent="link_1", x=0, y=0.03, m=2, axis="0 1 0")
    + LINK.format(i=3, parent="link_2", x=0.3, y=-0.01, m=1, axis="0 1 0")
    + "\n</robot>\n"
)
"""Three turning joints, gravity along -z."""

FRICTION = {"FV": (1.5, 2.0, 0.5), "FS": (0.8, 1.2, 0.4)}


def write_arm(folder: Path) -> Path:
    path = folder / "small.urdf"
    path.write_text(URDF)
    return path


@cache
def small_model() -> DynamicsModel:
    """The small arm with viscous and smooth Coulomb friction."""
    import tempfile

    with tempfile.TemporaryDirectory() as folder:
        robot: Robot = load_robot(write_arm(Path(folder)))
    return DynamicsModel(robot, (RigidBody(), Viscous(), Coulomb(width=0.02)))


def small_truth() -> Array:
    """Standard parameters: the description's, and friction."""
    model = small_model()
    theta = model.nominal_parameters()
    assert theta is not None
    theta = theta.copy()
    for k, parameter in enumerate(model.parameters):
        if parameter.symbol in FRICTION:
            theta[k] = FRICTION[parameter.symbol][parameter.number - 1]
    return theta


@cache
def small_model_with_rotors() -> DynamicsModel:
    """The small arm with the friction of `small_model` and rotor inertia."""
    return DynamicsModel(small_model().robot, (*small_model().terms, RotorInertia()))


@cache
def small_truth_with_rotors() -> Array:
    """Standard parameters: the description's, and the same friction and rotor for every joint."""
    model = small_model_with_rotors()
    theta = model.nominal_parameters()
    assert theta is not None
    theta = theta.copy()
    theta[model.law_columns] = np.resize([1.5, 0.8, 0.05], len(model.law_columns))
    theta.flags.writeable = False  # the same array for all tests
    return theta


def small_plan(seed: int) -> Excitation:
    """One motion of a kind; it closes after 8 s."""
    a, b = np.random.default_rng(seed).normal(0.0, 0.35, (2, 3, 5))
    return Excitation(2 * np.pi / PERIOD, a, b, np.zeros(3), "small")


def small_recording(seed: int, repetitions: int = 2, sensors: Sensors = SENSORS) -> Recording:
    """A recording of a motion of its own, with noise."""
    rng = np.random.default_rng(1000 + seed)
    return record(small_model(), small_truth(), small_plan(seed), sensors, rng, repetitions=repetitions)[0]


def write_recording(recording: Recording, path: Path, *, clock: bool = True) -> Path:
    """As CSV, NPZ or Parquet, by the suffix; joints are numbered from 1."""
    assert recording.time is not None and recording.effort is not None
    columns = {"t": recording.time} if clock else {}
    for name, values in (("q", recording.q), ("tau", recording.effort)):
        columns |= {f"{name}{j + 1}": values[:, j] for j in range(recording.n)}
    if path.suffix == ".npz":
        np.savez(path, **columns)  # pyright: ignore[reportArgumentType]
    elif path.suffix == ".parquet":
        import pyarrow as pa
        import pyarrow.parquet as pq

        pq.write_table(pa.table(columns), path)
    else:
        table = np.column_stack(list(columns.values()))
        np.savetxt(path, table, delimiter=",", header=",".join(columns), comments="", fmt="%.17g")
    return path


def write_recordings(folder: Path) -> tuple[Path, Path]:
    """A recording to train and one of another motion, as CSV, beside the arm."""
    write_arm(folder)
    return tuple(write_recording(small_recording(k), folder / f"run{k}.csv") for k in (1, 2))  # pyright: ignore


STUDY = """
[robot]
description = "small.urdf"

[[recording]]
path = "run1.csv"

[[recording]]
path = "run2.csv"
role = "validate"
"""
"""The plainest study of the small arm."""

KNOWN_FRICTION = """
[robot]
description = "small.urdf"
[model]
terms = ["rigid-body", "viscous", "coulomb"]
coulomb = {{ width = 0.02 }}
[[recording]]
path = "{log}"
"""
"""A study of one log with the friction that the small arm has; its end is the log's table."""


RUN_FILES = {
    "study.json",
    "robot.npz",
    "model.json",
    "information.npz",
    "estimate.npz",
    "estimate.json",
    "validation.json",
}
"""Files of a run without a page."""


def write_study(folder: Path, text: str = STUDY) -> Path:
    path = folder / "study.toml"
    path.write_text(text)
    return path


def small_folder(factory: pytest.TempPathFactory) -> Path:
    """A new folder with the small arm, its two recordings and their study."""
    folder = factory.mktemp("small")
    write_recordings(folder)
    write_study(folder)
    return folder
