"""Expressions of xacro: what the language has is evaluated, everything that could run a program is refused."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from armid.errors import RobotError
from armid.robot import load_robot
from armid.robot.urdf.xacro_expression import evaluate

pytest.importorskip("xacro")

NAMES = {"x": 3.0, "names": ["a", "b"], "table": {"mass": 2.0, "type": "arm"}, "pi": math.pi, "str": str, "_p": 1}

ARM = """<robot name="arm" xmlns:xacro="http://www.ros.org/wiki/xacro">
  <xacro:property name="mass" value="{value}"/>
  {more}
  <link name="base"/>
  <link name="upper"><inertial><mass value="${{mass}}"/><origin xyz="0 0 0.1"/>
    <inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="joint" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 0 1"/>
    <limit lower="-1" upper="1" velocity="1" effort="10"/></joint>
</robot>
"""


def write(folder: Path, value: str, more: str = "") -> Path:
    path = folder / "arm.xacro"
    path.write_text(
        ARM.format(value=value.replace("&", "&amp;").replace('"', "&quot;").replace("<", "&lt;"), more=more)
    )
    return path


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("2*x + 1", 7.0),
        ("-x if x > 2 and not x == 5 else 0", -3.0),
        ("2**0.5", math.sqrt(2.0)),
        ("table['mass'] * pi", 2.0 * math.pi),
        ("table.get('mass')", 2.0),
        ("table['type']", "arm"),
        ("_p + 1", 2),
        ("' '.join([str(2 * i) for i in range(3)])", "0 2 4"),
        ("'%03d' % 7", "007"),
        ("'a_b'.split('_')[1]", "b"),
        ("'a' + names[0].upper()", "aA"),
        ("7 % 4 + (1 << 3)", 11),
        ("'b' in names", True),
    ],
)
def test_the_language_is_evaluated(text: str, value: object):
    assert evaluate(text, dict(NAMES)) == value


ATTACKS = [
    "__import__('os').system('touch exploded')",
    "().__class__.__base__.__subclasses__()",
    "[c for c in ().__class__.__mro__]",
    "(lambda: [].__class__)()",
    "'{0.__class__}'.format(x)",
    "'{0.__class__.__init__.__globals__}'.format_map(table)",
    "str.format('{0.__class__}', x)",
    "getattr(x, '_' + '_class__')",
    "python.vars(python.type(1))",
    "python.type('X', (), {'a': 1})",
    "[f for f in [python.vars]][0](xacro)",
    "list(map(python.vars, [xacro]))",
    "open('exploded', 'w')",
    "eval('1')",
    "exec('import os')",
    "(y := 5)",
    "f'{x.real!r}'",
    "(i for i in [1])",
    "{i: i for i in [1]}",
    "table.update({'mass': 1})",
    "xacro.load_yaml.__globals__['os'].system('touch exploded')",
    "load_yaml.__globals__",
    "math.factorial(100000000)",
    "10**10**10",
    "2**100000",
    "1 << 10**10",
    "'a' * 10**9",
    "[0] * 10**9",
    "'%999999999d' % 1",
    "'%*d' % (999999999, 1)",
    "'a'.ljust(10**9)",
    "'a'.zfill(10**9)",
    "[0 for i in range(10**9)]",
    "[0 for i in python.range(10**9)]",
    "[0 for i in names for j in names for k in names]",
    "1" * 20_000,
]
"""Expressions that run a program, look into objects, or need all memory or time."""


@pytest.mark.parametrize("text", ATTACKS, ids=range(len(ATTACKS)))
@pytest.mark.parametrize("form", ["${%s}", "$(eval %s)"])
def test_a_description_runs_no_program(text: str, form: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(RobotError) as caught:
        load_robot(write(tmp_path, form % text))
    assert caught.value.remedy
    assert sorted(path.name for path in tmp_path.iterdir()) == ["arm.xacro"]


@pytest.mark.parametrize("place", ["if", "default", "yaml"])
def test_every_place_of_an_expression_is_guarded(place: str, tmp_path: Path):
    attack = "().__class__.__base__.__subclasses__()"
    (tmp_path / "values.yaml").write_text(f'mass: !degrees "{attack}"\n')
    more = {
        "if": f'<xacro:if value="${{{attack}}}"/>',
        "default": f'<xacro:macro name="m" params="a:=${{{attack}}}"><l n="${{a}}"/></xacro:macro><xacro:m/>',
        "yaml": '<xacro:property name="v" value="${xacro.load_yaml(\'values.yaml\')}"/><l n="${v[\'mass\']}"/>',
    }[place]
    with pytest.raises(RobotError, match="not allowed"):
        load_robot(write(tmp_path, "1", more))


def test_yaml_runs_no_program(tmp_path: Path):
    (tmp_path / "values.yaml").write_text(f"a: !!python/object/apply:os.system ['touch {tmp_path}/exploded']\n")
    more = '<xacro:property name="v" value="${xacro.load_yaml(\'values.yaml\')}"/><l n="${v}"/>'
    with pytest.raises(RobotError):
        load_robot(write(tmp_path, "1", more))
    assert not (tmp_path / "exploded").exists()


def test_macros_that_double_are_refused(tmp_path: Path):
    """2^40 links in forty lines."""
    macros = "".join(f'<xacro:macro name="m{i}"><xacro:m{i + 1}/><xacro:m{i + 1}/></xacro:macro>' for i in range(40))
    more = f'{macros}<xacro:macro name="m40"><a/></xacro:macro><xacro:m0/>'
    with pytest.raises(RobotError, match="More than 5000 macros"):
        load_robot(write(tmp_path, "1", more))


def test_values_are_used(tmp_path: Path):
    (tmp_path / "values.yaml").write_text("link: {mass: 4.0}\n")
    robot = load_robot(write(tmp_path, "${xacro.load_yaml('values.yaml')['link'].mass / 2}"))
    vector = robot.inertial_vector
    assert vector is not None and vector[-1, 0] == 2.0
