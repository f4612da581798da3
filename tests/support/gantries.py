"""Description of a gantry of two axes."""

from __future__ import annotations

from pathlib import Path

from armid.robot import Robot, load_robot

GANTRY = """<robot name="gantry"><link name="rail"/>
<link name="bridge"><inertial><mass value="40"/>
  <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="slide"><inertial><mass value="12"/>
  <inertia ixx="0.2" iyy="0.2" izz="0.2" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="x" type="{kind}"><parent link="rail"/><child link="bridge"/><axis xyz="{axis}"/>
  <limit lower="-{first}" upper="{first}" velocity="1.5" effort="300"/></joint>
<joint name="y" type="prismatic"><parent link="bridge"/><child link="slide"/><axis xyz="0 1 0"/>
  <limit lower="-{second}" upper="{second}" velocity="1.5" effort="120"/></joint>
</robot>"""
"""Two axes that do not feel each other: in either order a model explains the torque equally well."""


def gantry(
    folder: Path, kind: str = "prismatic", axis: str = "1 0 0", *, first: float = 1.0, second: float = 0.3
) -> Robot:
    """A gantry whose axes reach to both sides of zero by some length [m]."""
    path = folder / "gantry.urdf"
    path.write_text(GANTRY.format(kind=kind, axis=axis, first=first, second=second))
    return load_robot(path)
