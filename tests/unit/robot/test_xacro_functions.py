"""Functions of xacro that are replaced while armid expands a description."""

from __future__ import annotations

import pytest

from armid.errors import RobotError
from armid.robot import load_robot

xacro = pytest.importorskip("xacro")
substitution_args = pytest.importorskip("xacro.substitution_args")

GOOD = """<robot name="arm" xmlns:xacro="http://www.ros.org/wiki/xacro">
  <xacro:property name="length" value="${0.1 + 0.2}"/>
  <link name="base"/>
  <link name="link"/>
  <joint name="joint" type="revolute">
    <parent link="base"/><child link="link"/><origin xyz="0 0 ${length}"/><axis xyz="0 0 1"/>
    <limit lower="-1" upper="1" effort="10" velocity="1"/>
  </joint>
</robot>
"""


def functions():
    names = ("safe_eval", "handle_macro_call", "abs_filename_spec", "parse")
    return [*(getattr(xacro, name) for name in names), vars(substitution_args)["_eval"]]


@pytest.mark.parametrize("text", [GOOD, GOOD.replace("0.1 + 0.2", "open('secret')")], ids=["sound", "refused"])
def test_a_program_that_uses_xacro_itself_gets_its_functions_back(tmp_path, text):
    before, path = functions(), tmp_path / "arm.xacro"
    path.write_text(text)
    if text == GOOD:
        assert load_robot(path).n == 1
    else:
        with pytest.raises(RobotError):
            load_robot(path)
    assert functions() == before
