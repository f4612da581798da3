"""Words of the doctor on sound logs of light arms that stick, in closed loop with coarse encoders."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from armid.doctor.check_input import LogEvidence
from armid.doctor.checks.dynamics.gravity_direction import explain as explain_gravity
from armid.doctor.fitted_log import LogState
from armid.excitation.fourier import Excitation
from armid.lab.known_arms import truth_of
from armid.lab.options import Arm, LabOptions
from armid.lab.sensors import Sensing, SensorChannel
from armid.lab.simulation import simulate
from armid.measurement.log_format import LogFormat
from armid.measurement.recording import Recording
from armid.robot import Robot, load_robot
from armid.study.diagnosis import diagnose_recording

LINK = """<link name="{child}"><inertial><origin xyz="0 0 0.05"/><mass value="{mass}"/>
  <inertia ixx="2e-4" iyy="2e-4" izz="2e-5" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="{name}" type="continuous"><parent link="{parent}"/><child link="{child}"/>
  <origin xyz="0 0 0.1"/><axis xyz="0 1 0"/></joint>"""


def pendulum(folder: Path, mass: float) -> Robot:
    """Two links of some mass [kg] with the friction of heavy ones."""
    first = LINK.format(name="first", parent="stand", child="upper", mass=mass)
    second = LINK.format(name="second", parent="upper", child="lower", mass=mass)
    path = folder / "pendulum.urdf"
    path.write_text(f'<robot name="pendulum"><link name="stand"/>{first}{second}</robot>')
    return load_robot(path)


def sticking(robot: Robot, size: float, seed: int) -> Recording:
    """Log of a motion of some size [rad] with friction that rises near rest and encoders of 4096 counts."""
    a, b = size * np.random.default_rng(seed).normal(size=(2, 2, 5))
    position, effort = SensorChannel(resolution=2.0 * np.pi / 4096), SensorChannel(noise=0.03)
    sensing = Sensing(rate=250.0, position=position, effort=effort)
    options = LabOptions(repetitions=2, arm=Arm(effects=("stribeck",)), sensing=sensing)
    return simulate(truth_of(robot), Excitation(2 * np.pi / 10.0, a, b, np.zeros(2)), options, seed=seed).recording


def state_of(robot: Robot, log: Recording) -> LogState:
    """Fit of a model to a log."""
    state = LogEvidence(robot, log, LogFormat(), log).state
    assert state is not None
    return state


@pytest.mark.parametrize("size", [0.2, 0.4])
def test_stiction_is_no_other_order(tmp_path: Path, size: float):
    """Stiction is most of the residual, and the wrong order fitted it better by chance."""
    robot = pendulum(tmp_path, 0.1)
    log = sticking(robot, size, 2)
    assert not [f for f in diagnose_recording(robot, log, LogFormat()) if f.severity == "error"]


def test_stiction_is_no_error_where_its_residual_is_smallest_upside_down(tmp_path: Path):
    """On all rows of this log, gravity in the opposite direction leaves a residual that is 2 % smaller."""
    robot = pendulum(tmp_path, 0.1)
    log = sticking(robot, 0.2, 5)
    assert not [f for f in diagnose_recording(robot, log, LogFormat()) if f.severity == "error"]


@pytest.mark.parametrize(
    ("size", "seeds"),
    [
        (0.2, range(3)),
        pytest.param(0.2, range(3, 12), marks=pytest.mark.long),
        pytest.param(0.4, range(12), marks=pytest.mark.long),
    ],
)
def test_stiction_is_no_other_gravity(tmp_path: Path, size: float, seeds: range):
    """Stiction left a residual that is up to 2 % smaller with gravity along another axis."""
    robot = pendulum(tmp_path, 0.1)
    assert [seed for seed in seeds if explain_gravity(state_of(robot, sticking(robot, size, seed)))] == []


@pytest.mark.parametrize("seed", [0, 2, 3])
@pytest.mark.parametrize("gravity", [(0.0, 0.0, 9.81), (9.81, 0.0, 0.0)])
def test_stiction_hides_no_gravity(tmp_path: Path, seed: int, gravity: tuple[float, float, float]):
    """Away from reversals, the directions differ by 10 % and more, but on all rows by 0.4 % at most."""
    robot = pendulum(tmp_path, 2.0)
    found = explain_gravity(state_of(robot.with_gravity(gravity), sticking(robot, 0.4, seed)))
    assert found is not None and found.severity == "error"
    np.testing.assert_allclose(found.after.model.robot.gravity, robot.gravity, atol=1e-9)  # along an axis, so exact


def test_stiction_is_no_certain_delay(tmp_path: Path):
    """It looks like a delay of all torque, but not of weight and inertia."""
    robot = pendulum(tmp_path, 0.1)
    found = [f for f in diagnose_recording(robot, sticking(robot, 0.2, 6), LogFormat()) if f.code == "channel-delay"]
    assert all(f.severity == "warning" for f in found)


def test_stiction_hides_no_exchange(tmp_path: Path):
    """Away from reversals, the two orders differ clearly, however large the residual at reversals is."""
    robot = pendulum(tmp_path, 2.0)
    log = sticking(robot, 0.2, 2)
    assert log.effort is not None
    mixed = replace(log, q=log.q[:, ::-1], effort=log.effort[:, ::-1])
    told = [f for f in diagnose_recording(robot, mixed, LogFormat()) if f.code == "joint-order"]
    assert [f.severity for f in told] == ["error"]
