"""Side from which the preview shows the arm first."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from armid.report.preview.scene import open_side
from armid.robot import load_robot
from armid.robot.kinematics import forward_kinematics

TRUNK = """<robot name="trunk"><link name="base"><visual><origin xyz="0 0 0.5"/><geometry><box size="0.2 0.2 1"/>
</geometry></visual></link>
<joint name="shoulder" type="continuous"><parent link="base"/><child link="arm"/><origin xyz="{place}"/>
<axis xyz="1 0 0"/></joint><link name="arm"/>
<joint name="elbow" type="continuous"><parent link="arm"/><child link="hand"/><origin xyz="0.4 0 0"/>
<axis xyz="0 1 0"/></joint><link name="hand"/></robot>"""


@pytest.mark.parametrize(
    ("place", "side"), [("0 -0.2 0.9", [0.0, -1.0, 0.0]), ("0.3 0 0.9", [1.0, 0.0, 0.0]), ("0 0.01 1", None)]
)
def test_an_arm_beside_a_trunk_is_seen_from_its_own_side(place: str, side: list[float] | None, tmp_path: Path):
    path = tmp_path / "trunk.urdf"
    path.write_text(TRUNK.format(place=place))
    robot = load_robot(path)
    _, origins = forward_kinematics(robot, np.zeros((1, robot.n)))
    found = open_side(robot, origins)
    assert found is None if side is None else found == pytest.approx(side)
