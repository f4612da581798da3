"""Names of bodies in messages: the link's own, and for links of several shapes which of them."""

from __future__ import annotations

import pytest

from armid.robot import load_robot

URDF = """<robot name="two"><link name="base"/><joint name="j" type="continuous"><parent link="base"/>
<child link="right_l6"/><axis xyz="0 0 1"/></joint><link name="right_l6">
<collision><geometry><sphere radius="0.1"/></geometry></collision>
<collision><geometry><sphere radius="0.2"/></geometry></collision></link></robot>"""
MJCF = """<mujoco><worldbody><body name="right_l6"><joint name="j" axis="0 0 1"/>
<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>
<geom type="sphere" size="0.3" contype="0" conaffinity="0"/><geom type="sphere" size="0.1"/>
<geom type="sphere" size="0.2"/></body></worldbody></mujoco>"""
DH = """name = "two"
convention = "modified"
[[joint]]
name = "right_l6"
position = [-2, 2]
capsule = [{ from = [0, 0, 0], to = [0, 0, 1], radius = 0.1 }, { from = [0, 0, 1], to = [0, 1, 1], radius = 0.1 }]
"""


@pytest.mark.parametrize(("name", "text"), [("a.urdf", URDF), ("a.xml", MJCF), ("a.toml", DH)])
def test_no_bare_number_in_brackets(name, text, tmp_path):
    """A geom that is only seen is not counted among those that touch."""
    path = tmp_path / name
    path.write_text(text)
    found = [shape.name for shape in load_robot(path).shapes]
    assert len(found) == 2 and found[1] == f"{found[0]} shape 2"
    assert name == "a.toml" or found[0] == "right_l6"
