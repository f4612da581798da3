"""MuJoCo moves the written arm as the identified one moves, under the same commands."""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from armid.export.servos.edited_mjcf import edited_mjcf, reason_without_shapes
from armid.export.servos.mjcf_actuators import servo_mjcf
from armid.export.servos.mujoco_rollout import SAME, compare_roll_outs
from armid.export.types import DescriptionSource
from armid.robot import load_robot
from armid.robot.readers import mjcf
from armid.servo.parameters import described_parameters
from servo_labs import any_parameters, recorded, servo_model, small_arm

DESCRIPTION = """<mujoco model="shown">
  <!-- the arm of a maker -->
  <compiler angle="radian"/>
  <default><position kp="50" ctrlrange="-1 1"/><joint damping="1" armature="0.1"/></default>
  <option timestep="0.01"/>
  <worldbody>
    <geom type="plane" size="1 1 0.1"/>
    <body name="turret" pos="0 0 0.05">
      <joint name="pan" axis="0 0 1" range="-0.2 0.2"/>
      <inertial pos="0 0 0.02" mass="0.2" diaginertia="2e-4 2e-4 2e-4"/>
      <geom type="cylinder" size="0.03 0.03"/>
      <body name="arm" pos="0 0 0.06">
        <joint name="lift" axis="0 1 0"/>
        <inertial pos="0.1 0 0" mass="0.15" diaginertia="2e-4 4e-4 4e-4"/>
        <geom type="capsule" size="0.02" fromto="0 0 0 0.2 0 0"/>
      </body>
    </body>
  </worldbody>
  <actuator>
    <position name="motor of pan" joint="pan"/>
    <motor name="second of pan" joint="pan"/>
  </actuator>
</mujoco>
"""
"""Arm with shapes, defaults that differ from MuJoCo's, limits, and a joint with two actuators and one with none."""


@pytest.fixture
def moved():
    """Model, parameters and a run of the small arm; two of its servos are limited."""
    model, rng = servo_model(small_arm()), np.random.default_rng(3)
    parameters = replace(any_parameters(model, rng), limit=np.array([2.0, np.inf, 1.5]))
    return model, parameters, recorded(model, parameters, rng, 10.0)


def compared(data: bytes, moved, tmp_path):
    model, parameters, run = moved
    path = tmp_path / "written.xml"
    path.write_bytes(data)
    found = compare_roll_outs(path, model, parameters, [run])
    assert found is not None
    return found


def test_closed_loop_of_the_written_file(moved, tmp_path):
    found = compared(servo_mjcf(*moved[:2]), moved, tmp_path)
    assert found.total < SAME
    assert found.seconds == pytest.approx(moved[2].seconds)


def test_a_wrong_file_is_seen(moved, tmp_path):
    """The comparison sees a stiffness that is wrong by 10 %."""
    model, parameters, _ = moved
    wrong = servo_mjcf(model, replace(parameters, stiffness=1.1 * parameters.stiffness))
    assert compared(wrong, moved, tmp_path).total > SAME


def test_a_servo_without_offset_is_a_position_actuator(moved, tmp_path):
    model, parameters, run = moved
    centred = replace(parameters, offset=np.array([0.0, 0.01, 0.0]), damping=np.full(3, 0.1))
    data = servo_mjcf(model, centred)
    assert [data.count(b"<" + tag) for tag in (b"position ", b"general ")] == [2, 1]
    assert compared(data, (model, centred, run), tmp_path).total < SAME


def test_the_file_can_be_read_again():
    model = servo_model(small_arm())
    parameters = replace(any_parameters(model, np.random.default_rng(3)), damping=np.array([0.1, 0.2, 0.0]))
    text = servo_mjcf(model, parameters).decode()
    again = servo_model(mjcf.read(text, source="the written file", locked={}, tip=None))
    found = described_parameters(again)
    assert found is not None
    assert np.allclose(found.inertial, parameters.inertial, rtol=1e-9)
    for name in ("friction", "stiffness", "damping", "rotor_inertia"):
        assert np.allclose(getattr(found, name), getattr(parameters, name), rtol=1e-12)


def test_a_description_with_shapes_keeps_them_and_moves_like_the_result(tmp_path, monkeypatch):
    path = tmp_path / "shown.xml"
    path.write_text(DESCRIPTION)
    model, rng = servo_model(load_robot(path)), np.random.default_rng(8)
    parameters = any_parameters(model, rng)
    source = DescriptionSource(str(path), "mjcf", DESCRIPTION.encode(), {})
    assert reason_without_shapes(source) == ""
    data, _ = edited_mjcf(source, model, parameters, tmp_path / "result")
    run = recorded(model, parameters, rng, 10.0)
    assert compared(data, (model, parameters, run), tmp_path).total < SAME
    written = mujoco.MjModel.from_xml_string(data.decode())
    assert (written.ngeom, written.nu) == (3, 2)
    assert b"<!-- the arm of a maker -->" in data
    assert {written.actuator(k).name for k in range(2)} == {"motor of pan", "lift"}
    assert not written.actuator_ctrllimited.any()


def test_shapes_are_left_out_where_their_files_are_missing(tmp_path):
    text = DESCRIPTION.replace("<worldbody>", '<asset><mesh name="m" file="gone.stl"/></asset><worldbody>')
    source = DescriptionSource(str(tmp_path / "shown.xml"), "mjcf", text.encode(), {})
    assert "gone.stl" in reason_without_shapes(source)
    assert "locked" in reason_without_shapes(replace(source, data=DESCRIPTION.encode(), locked={"pan": 0.0}))
