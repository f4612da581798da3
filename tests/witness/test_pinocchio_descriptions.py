"""Readers of URDF and MJCF against Pinocchio's own parsers: joints, inertias, torques and base parameters."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from armid.export.catalogue import EXPORTERS
from armid.export.types import Content
from armid.robot import builtin_arms, load_robot
from exports import MJCF, URDF
from pinocchio_descriptions import compare

pytestmark = pytest.mark.witness

ARMS = Path(__file__).parents[1] / "contract" / "arms"


def numbers(values) -> str:
    return " ".join(repr(float(v)) for v in np.atleast_1d(values))


def orientation(rng: np.random.Generator) -> str:
    """One of the forms that MJCF knows, often none; axes and quaternions of any length."""
    form = rng.choice(["", "quat", "xyaxes", "zaxis", "euler", "axisangle"])
    count = {"": 0, "quat": 4, "xyaxes": 6, "zaxis": 3, "euler": 3, "axisangle": 4}[form]
    return f' {form}="{numbers(rng.uniform(0.2, 1.5, count) * rng.choice([-1, 1], count))}"' if form else ""


def primitive(rng: np.random.Generator) -> str:
    """Solid geom, by density or by mass; some between two points."""
    kind = rng.choice(["sphere", "capsule", "cylinder", "box", "ellipsoid"])
    weight = rng.choice(["", f' mass="{rng.uniform(0.2, 3.0)!r}"', f' density="{rng.uniform(200.0, 3000.0)!r}"'])
    sizes = rng.uniform(0.02, 0.2, {"sphere": 1, "capsule": 2, "cylinder": 2, "box": 3, "ellipsoid": 3}[kind])
    if kind in ("capsule", "cylinder") and rng.random() < 0.4:
        return f'<geom type="{kind}" size="{float(sizes[0])!r}" fromto="{numbers(rng.normal(size=6))}"{weight}/>'
    place = f' pos="{numbers(rng.normal(scale=0.1, size=3))}"{orientation(rng)}'
    return f'<geom type="{kind}" size="{numbers(sizes)}"{place}{weight}/>'


def mass(rng: np.random.Generator) -> str:
    """Inertial with moments, or with a full matrix, or geoms, or nothing."""
    form = rng.choice(["moments", "matrix", "geoms", "none"], p=[0.4, 0.2, 0.3, 0.1])
    if form == "geoms":
        return "".join(primitive(rng) for _ in range(rng.integers(1, 4)))
    size = rng.uniform(0.05, 0.4, 3)
    moments = size @ size - size**2
    body = f'<inertial mass="{rng.uniform(0.2, 5.0)!r}" pos="{numbers(rng.normal(scale=0.2, size=3))}"'
    if form == "moments":
        return f'{body}{orientation(rng)} diaginertia="{numbers(moments)}"/>'
    return f'{body} fullinertia="{numbers([*moments, *rng.uniform(-0.002, 0.002, 3)])}"/>' if form == "matrix" else ""


def random_mjcf(rng: np.random.Generator, n: int) -> str:
    """A tree of n bodies with none to three joints each, joints beside the body's origin, and reference positions."""
    bodies: list[list[int]] = [[] for _ in range(n)]
    for i in range(1, n):
        bodies[i - 1 if rng.random() < 0.7 else int(rng.integers(0, i))].append(i)

    def joint(i: int, k: int) -> str:
        kind = rng.choice(["hinge", "slide"])
        axis = np.eye(3)[rng.integers(3)] if rng.random() < 0.5 else rng.normal(size=3)
        place = f' pos="{numbers(rng.normal(scale=0.1, size=3))}"' if rng.random() < 0.5 else ""
        reference = f' ref="{rng.uniform(-0.5, 0.5)!r}"' if rng.random() < 0.3 else ""
        return f'<joint name="j{i}_{k}" type="{kind}" axis="{numbers(axis)}"{place}{reference}/>'

    def body(i: int) -> str:
        joints = "".join(
            joint(i, k) for k in range(int(rng.choice([0, 1, 2, 3], p=[0.2, 0.6, 0.15, 0.05])) or i == 0)
        )
        inside = joints + mass(rng) + "".join(body(k) for k in bodies[i])
        return f'<body name="b{i}" pos="{numbers(rng.uniform(-0.5, 0.5, 3))}"{orientation(rng)}>{inside}</body>'

    angle = rng.choice(["radian", "degree"])
    return f'<mujoco><compiler angle="{angle}" eulerseq="zxZ"/><worldbody>{body(0)}</worldbody></mujoco>'


@pytest.mark.parametrize("seed", range(80))
def test_random_mjcf(tmp_path, seed):
    rng = np.random.default_rng(seed)
    path = tmp_path / "random.xml"
    path.write_text(random_mjcf(rng, int(rng.integers(1, 11))))
    found = compare(path, seed=seed)
    assert found.holds, found


@pytest.mark.parametrize("name", ["arm.urdf", "arm.mjcf"])
def test_descriptions_written_by_hand(name):
    found = compare(ARMS / name)
    assert found.holds and found.base is not None, found


@pytest.mark.parametrize(("text", "suffix"), [(URDF, ".urdf"), (MJCF, ".xml")])
def test_odd_descriptions(tmp_path, text, suffix):
    path = tmp_path / f"odd{suffix}"
    path.write_text(text)
    found = compare(path)
    assert found.holds, found


@pytest.mark.parametrize("arm", builtin_arms())
@pytest.mark.parametrize("form", ["urdf", "mjcf"])
def test_built_in_arms_as_files(tmp_path, arm, form):
    path = tmp_path / f"{arm}{EXPORTERS[form].SUFFIX}"
    path.write_bytes(EXPORTERS[form].write(Content(load_robot(arm), {})).data)
    found = compare(path)
    assert found.holds, found


def test_a_difference_would_be_seen(tmp_path, monkeypatch):
    """A reader that loses a digit of an inertia, or turns a joint, does not pass."""
    from armid.robot.urdf import tree

    path = tmp_path / "odd.urdf"
    path.write_text(URDF)
    right = tree.inertial_of
    monkeypatch.setattr(tree, "inertial_of", lambda link, source: _changed(right(link, source)))
    assert compare(path).inertia > 1e-10


def _changed(vector):
    return None if vector is None else vector * (1.0 + 1e-9 * np.arange(10))
