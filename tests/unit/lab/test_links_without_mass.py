"""Links of which the description gives no mass: what cannot be simulated, limited or designed with them."""

from __future__ import annotations

import numpy as np
import pytest
from typer.testing import CliRunner

from armid.cli.main import app
from armid.errors import LabError
from armid.excitation.fourier import save_plan
from armid.lab.known_arms import truth_of
from armid.lab.plant import write_mjcf
from armid.robot import load_robot
from armid.robot.missing_inertia import massless_joints
from labs import small_plan

ROW = '[[joint]]\nname = "J{}"\na = 0.3\nalpha = {}\nposition = [-2, 2]\nvelocity = 3\neffort = 40\n'
INERTIA = """[joint.inertial]
mass = 2.0
com = [0.1, 0, 0]
inertia = { xx = 0.01, xy = 0, xz = 0, yy = 0.02, yz = 0, zz = 0.02 }
"""


def table(tmp_path, *with_mass):
    path = tmp_path / "arm.toml"
    rows = [
        ROW.format(k, "'pi/2'" if k == 2 else 0) + (INERTIA if given else "") for k, given in enumerate(with_mass, 1)
    ]
    path.write_text('name = "arm"\nconvention = "modified"\n' + "".join(rows))
    return path


def test_joints_that_move_no_mass(tmp_path):
    assert massless_joints(load_robot(table(tmp_path, 1, 1, 0, 0))) == ("J3", "J4")
    assert massless_joints(load_robot(table(tmp_path, 0, 0, 1))) == ()


def test_they_are_not_simulated_and_the_key_to_add_is_said(tmp_path):
    with pytest.raises(LabError, match="J3, J4 of arm move no mass") as caught:
        truth_of(load_robot(table(tmp_path, 1, 1, 0, 0)))
    assert "[joint.inertial]" in caught.value.remedy
    with pytest.raises(LabError, match="needs inertial parameters") as caught:
        truth_of(load_robot(table(tmp_path, 0, 0)))
    assert "[joint.inertial]" in caught.value.remedy
    arm = load_robot(table(tmp_path, 0, 1))
    with pytest.raises(LabError, match="'link_1', which the joint J1 moves") as caught:
        write_mjcf(arm, truth_of(arm).inertial)
    assert "[joint.inertial]" in caught.value.remedy and "inverse-dynamics" in caught.value.possible


def test_the_command_line_has_one_message(tmp_path):
    """The matrix that could not be inverted was told by a trace through twenty functions."""
    path = table(tmp_path, 1, 1, 0)
    plan = save_plan(small_plan(0), tmp_path / "plan.json")
    for options in ([], ["--mode", "inverse-dynamics"]):
        result = CliRunner().invoke(app, ["simulate", str(path), str(plan), "--out", str(tmp_path / "lab"), *options])
        assert isinstance(result.exception, LabError) and "J3 of arm" in str(result.exception)
    assert not (tmp_path / "lab").exists()


def test_a_torque_that_cannot_be_known_is_no_torque_of_zero(tmp_path):
    path = table(tmp_path, 1, 1, 0)
    options = ["--budget", "0.2", "--workers", "0", "--duration", "5", "--harmonics", "3", "--no-report"]
    result = CliRunner().invoke(app, ["excite", str(path), *options, "--out", str(tmp_path / "plan")])
    assert result.exit_code == 0, result.output
    assert "torque-unknown" in result.stderr and "the links that J3 move have no mass" in " ".join(
        result.stderr.split()
    )


def test_an_mjcf_says_nothing_of_bodies_that_do_not_move(tmp_path):
    mesh = '<geom type="mesh" mesh="shell"/>'
    inertial = '<inertial pos="0 0 0.1" mass="1" diaginertia="0.1 0.1 0.1"/>'
    path = tmp_path / "arm.xml"
    path.write_text(
        '<mujoco><asset><mesh name="shell" file="shell.stl"/></asset><worldbody><body name="fixed_base">'
        f'{mesh}<body name="torso"><joint name="up" type="slide"/>{mesh}<body name="arm"><joint name="turn"/>'
        f'{inertial}<body name="cover">{mesh}</body></body></body></body></worldbody></mujoco>'
    )  # fmt: skip

    def unknown(**chosen):
        return [f.channel for f in load_robot(path, **chosen).findings if f.code == "inertial-missing"]

    assert unknown() == ["torso, cover"]
    assert unknown(only="turn") == ["cover"]
    assert np.isfinite(load_robot(path).inertial_vector).all()
