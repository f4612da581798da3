"""The README's Python works as it stands, in a folder that holds what it says."""

from __future__ import annotations

import re
import runpy
from pathlib import Path

import numpy as np
import pytest

from armid import DynamicsModel, Excitation, load_robot
from armid.lab.inverse_dynamics_recording import Sensors, record
from armid.model.terms import Coulomb, RigidBody, Viscous

README = Path(__file__).parents[2] / "README.md"

JOINT = """
  <joint name="{name}" type="revolute">
    <parent link="{parent}"/><child link="{child}"/><origin xyz="0 0 0.3" rpy="{roll} 0 0"/><axis xyz="0 0 1"/>
    <limit lower="-3" upper="3" velocity="3" effort="100"/>
  </joint>
  <link name="{child}"><inertial><origin xyz="0.05 0.02 0.1"/><mass value="3"/>
    <inertia ixx="0.05" iyy="0.04" izz="0.02" ixy="0.001" ixz="0" iyz="0"/></inertial></link>
"""


def write_arm(folder: Path) -> None:
    links = ["base", "a", "b", "c"]
    joints = [
        JOINT.format(name=f"joint{k + 1}", parent=links[k], child=links[k + 1], roll=roll)
        for k, roll in enumerate((0.0, 1.5707963267948966, -1.5707963267948966))
    ]
    (folder / "arm.urdf").write_text(f'<robot name="arm"><link name="base"/>{"".join(joints)}</robot>')


def test_the_python_of_the_readme_identifies_an_arm(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    write_arm(tmp_path)
    robot = load_robot(tmp_path / "arm.urdf")
    model = DynamicsModel(robot, (RigidBody(), Viscous(), Coulomb(width=0.02)))
    nominal = model.nominal_parameters()
    assert nominal is not None
    friction = {"FV": 2.0, "FS": 1.5}
    truth = [friction.get(p.symbol, value) for p, value in zip(model.parameters, nominal, strict=True)]
    rng = np.random.default_rng(3)
    motion = Excitation(0.6, rng.normal(0, 0.5, (3, 5)), rng.normal(0, 0.5, (3, 5)), np.zeros(3))
    recording, _, _ = record(model, np.array(truth), motion, Sensors(1e-6, 0.05, 200.0), rng, repetitions=3)
    assert recording.time is not None and recording.effort is not None
    table = np.column_stack([recording.time, recording.q, recording.effort])
    header = "t,q1,q2,q3,tau1,tau2,tau3"
    np.savetxt(tmp_path / "run.csv", table, delimiter=",", header=header, comments="", fmt="%.12g")

    (code,) = re.findall(r"```python\n(.*?)```", README.read_text(encoding="utf-8"), re.DOTALL)
    (tmp_path / "example.py").write_text(code)
    monkeypatch.chdir(tmp_path)
    assert len([line for line in code.splitlines() if line]) <= 5
    fit = runpy.run_path("example.py")["fit"]
    assert "95 % interval" in capsys.readouterr().out
    found = dict(zip(fit.names, fit.values, strict=True))
    for symbol, value in friction.items():  # the noise of 0.05 N·m moves friction by a hundredth of it
        assert all(abs(found[f"{symbol}_{j}"] - value) < 0.05 * value for j in (1, 2, 3))
