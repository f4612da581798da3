"""Outlines of meshes: they hold them, are kept between runs, and are made anew where what is kept is gone."""

from __future__ import annotations

import io
import os
import threading
import time
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from armid.cli import console
from armid.excitation.collision import cache, coal, mesh_hulls
from armid.excitation.collision.closest_approach import closest_approaches
from armid.excitation.collision.collision_model import collision_of
from armid.excitation.collision.hull_distances import parts_of
from armid.excitation.collision.mesh_hulls import capsules_of, outline_of
from armid.excitation.limits.joint_limits import limits_of
from armid.robot import load_robot
from armid.robot.kinematics import forward_kinematics
from armid.robot.shapes import Shape

pytestmark = pytest.mark.collision


@pytest.fixture(autouse=True)
def _folder(tmp_path, monkeypatch):
    """A cache folder of the test's own, and nothing known from before."""
    monkeypatch.setenv("ARMID_CACHE", str(tmp_path / "cache"))
    mesh_hulls._outline.cache_clear()


@pytest.fixture
def read(monkeypatch):
    """Paths of the meshes that were read."""
    told: list[str] = []
    with coal.telling_of_meshes(told.append):
        yield told


def egg(path, longest=0.1, bump=0.0):
    """A body of 2700 corners, whose hull has nearly as many; a bump outside, or a dent."""
    u, v = np.meshgrid(np.linspace(0.0, np.pi, 46), 2.0 * np.pi * np.arange(60) / 60, indexing="ij")
    wide = 1.0 + bump * (np.sin(3.0 * v) * np.sin(u) ** 2)
    points = np.stack([0.025 * wide * np.sin(u) * np.cos(v), 0.035 * np.sin(u) * np.sin(v), longest * np.cos(u)], -1)
    index = np.arange(points.shape[0] * 60).reshape(-1, 60) + 1
    right, down = np.roll(index, -1, axis=1), index[1:]
    corners = "".join(f"v {x!r} {y!r} {z!r}\n" for x, y, z in points.reshape(-1, 3).tolist())
    faces = [*zip(index[:-1].ravel(), down.ravel(), right[:-1].ravel(), strict=True)]
    faces += zip(right[:-1].ravel(), down.ravel(), right[1:].ravel(), strict=True)
    path.write_text(corners + "".join(f"f {a} {b} {c}\n" for a, b, c in faces))
    return Shape("egg", 0, "mesh", np.ones(3), np.eye(4), str(path))


def entries():
    """Entries in the cache folder."""
    folder = Path(os.environ["ARMID_CACHE"])
    return sorted(path.name for path in folder.glob("*")) if folder.is_dir() else []


def afresh(shape):
    """The outline as another process has it, which shares files only."""
    mesh_hulls._outline.cache_clear()
    coal._mesh.cache_clear()
    coal._faces.cache_clear()
    return outline_of(shape)


def same(one, other):
    """Tell whether two outlines are equal number by number."""
    arrays = [mesh_hulls._written(each) for each in (one, other)]
    return arrays[0].keys() == arrays[1].keys() and all(
        np.array_equal(arrays[0][key], arrays[1][key]) for key in arrays[0]
    )


@pytest.mark.parametrize("bump", [0.0, 0.2, -0.3])
def test_a_light_hull_holds_the_mesh_and_reaches_half_a_millimetre_beyond_it(tmp_path, bump):
    shape = egg(tmp_path / "egg.obj", bump=bump)
    corners, _ = coal.mesh_faces(shape)
    outline = outline_of(shape)
    solids = [part.solid() for part in outline.parts]
    inside = np.min([coal.apart(solid, corners) for solid in solids], axis=0)
    assert inside.max() <= mesh_hulls.SOLVER
    assert all(len(part.corners) < 700 and 0.0 < part.beyond <= mesh_hulls.LIGHT for part in outline.parts)
    if len(solids) == 1:  # the hull of the whole mesh
        directions = np.random.default_rng(0).normal(size=(200, 3))
        directions /= np.linalg.norm(directions, axis=1)[:, None]
        part = outline.parts[0]
        reach = (part.corners @ directions.T).max(axis=0) + part.beyond - (corners @ directions.T).max(axis=0)
        assert reach.min() >= 0.0
        assert reach.max() <= mesh_hulls.LIGHT


def test_distances_to_a_light_hull_are_those_of_the_mesh_less_what_it_reaches_beyond(tmp_path):
    """Coal takes what a hull reaches beyond its corners off the distance, apart and overlapping, of every kind."""
    shape = egg(tmp_path / "egg.obj")
    others = [
        Shape("", 0, kind, np.array(size), np.eye(4))
        for kind, size in (
            ("sphere", [0.04, 0.0, 0.0]), ("capsule", [0.03, 0.1, 0.0]), ("box", [0.1, 0.05, 0.07]),
            ("cylinder", [0.03, 0.1, 0.0]), ("half-space", [0.0, 0.0, 0.0]),
        )
    ]  # fmt: skip
    rng = np.random.default_rng(1)
    turned = np.linalg.qr(rng.normal(size=(40, 2, 3, 3)))[0]
    turned *= np.sign(np.linalg.det(turned))[..., None, None]
    places = rng.uniform(-0.25, 0.25, (40, 2, 3))
    shapes = [shape, *(Shape("", 1, o.kind, o.size, o.placement) for o in others), egg(tmp_path / "other.obj")]
    shapes[-1] = Shape("", 1, "mesh", np.ones(3), np.eye(4), shapes[-1].path)
    pairs = np.array([[0, k] for k in range(1, len(shapes))])
    light = coal.distances(shapes, pairs, (turned, places), parts_of)
    found, first, second, normal = coal.nearest(shapes, pairs, (turned, places), parts_of)
    assert np.allclose(found, light)
    assert (light < 0.0).any() and (light > 0.0).any()
    assert np.allclose(((first - second) * normal).sum(axis=-1), found, atol=1e-4)
    true = coal.distances(shapes, pairs, (turned, places))
    clear = true > 1e-3  # triangles of bodies that overlap have no depth
    assert clear.any(axis=0).all()
    less = (true - light)[clear]
    assert less.min() > -1e-4
    assert less.max() < 2.0 * mesh_hulls.LIGHT + 1e-3  # the prism around a cylinder is half a percent wider


def test_what_is_kept_equals_what_is_made(tmp_path, read):
    shape = egg(tmp_path / "egg.obj", bump=0.2)
    made = outline_of(shape)
    assert len(entries()) == 1 and len(read) == 1
    assert same(afresh(shape), made)
    assert len(read) == 1
    copy = egg(tmp_path / "copy.obj", bump=0.2)
    assert same(afresh(copy), made) and len(read) == 1 and len(entries()) == 1


def test_a_mesh_that_changed_is_another_one(tmp_path, read):
    path = tmp_path / "egg.obj"
    before = outline_of(egg(path))
    after = outline_of(egg(path, longest=0.2))
    assert len(entries()) == 2 and len(read) == 2
    assert capsules_of(egg(path, longest=0.2))[0].size[1] > before.capsules[0].size[1] + 0.05
    mirrored = egg(path, longest=0.2)
    mirrored = Shape(mirrored.name, 0, "mesh", np.array([1.0, -2.0, 1.0]), mirrored.placement, mirrored.path)
    assert not same(outline_of(mirrored), after)
    assert len(entries()) == 3


@pytest.mark.parametrize("broken", [b"", b"PK\x03\x04 not an archive", "half", "other"])
def test_an_entry_that_cannot_be_read_is_made_again(tmp_path, read, broken):
    shape = egg(tmp_path / "egg.obj")
    made = outline_of(shape)
    entry = Path(os.environ["ARMID_CACHE"]) / entries()[0]
    whole = entry.read_bytes()
    if broken == "other":
        cache.write_entry(entry.stem, {"sizes": np.zeros((1, 3))})
    else:
        entry.write_bytes(whole[: len(whole) // 2] if broken == "half" else broken)
    assert same(afresh(shape), made)
    assert len(read) == 2
    assert same(afresh(shape), made)
    assert len(read) == 2 and len(entries()) == 1


def test_a_folder_that_cannot_be_written_is_no_error(tmp_path, monkeypatch, read):
    shape = egg(tmp_path / "egg.obj")
    made = outline_of(shape)
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("ARMID_CACHE", str(tmp_path / "file" / "below"))
    assert same(afresh(shape), made) and len(read) == 2

    def refuse(*_, **__):
        raise PermissionError

    monkeypatch.setenv("ARMID_CACHE", str(tmp_path / "full"))
    monkeypatch.setattr(os, "replace", refuse)
    assert same(afresh(shape), made) and len(read) == 3
    assert entries() == []


def test_several_writers_leave_one_whole_entry(tmp_path):
    shape = egg(tmp_path / "egg.obj")
    arrays = mesh_hulls._written(outline_of(shape))
    name = entries()[0].removesuffix(".npz")
    seen: list[bool] = []

    def work():
        for _ in range(20):
            cache.write_entry(name, arrays)
            found = cache.read_entry(name)
            seen.append(found is not None and found.keys() == arrays.keys())

    threads = [threading.Thread(target=work) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(seen) == 80 and all(seen)
    assert entries() == [f"{name}.npz"]


def test_entries_that_were_not_used_for_longest_go(monkeypatch, tmp_path):
    arrays = {"x": np.zeros(1000)}
    cache.write_entry("first", arrays)
    size = (tmp_path / "cache" / "first.npz").stat().st_size
    monkeypatch.setattr(cache, "LARGEST", int(3.5 * size))
    for age, name in ((300, "first"), (200, "second"), (100, "third")):
        cache.write_entry(name, arrays)
        os.utime(tmp_path / "cache" / f"{name}.npz", (time.time() - age,) * 2)
    assert cache.read_entry("first") is not None  # used just now
    half = tmp_path / "cache" / ".half-made.npz"
    half.write_bytes(b"")
    os.utime(half, (time.time() - 2 * cache.LEFT_BEHIND,) * 2)
    cache.write_entry("fourth", arrays)
    assert {path.name for path in (tmp_path / "cache").iterdir()} == {"first.npz", "third.npz", "fourth.npz"}
    monkeypatch.setattr(cache, "LARGEST", 0)
    cache.write_entry("fifth", arrays)  # what was made last stays, however large it is
    assert {path.name for path in (tmp_path / "cache").iterdir()} == {"fifth.npz"}


def test_the_folder_is_the_users(monkeypatch, tmp_path):
    assert cache.cache_folder() == tmp_path / "cache"
    monkeypatch.delenv("ARMID_CACHE")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "xdg"))
    assert cache.cache_folder() == tmp_path / "xdg" / "armid"
    monkeypatch.delenv("XDG_CACHE_HOME")
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    assert cache.cache_folder() == tmp_path / "home" / ".cache" / "armid"


@pytest.mark.parametrize(("watched", "patience"), [(True, 0.0), (True, 60.0), (False, 0.0)])
def test_reading_meshes_is_told_where_it_takes_long_and_somebody_watches(tmp_path, monkeypatch, watched, patience):
    text = io.StringIO()
    monkeypatch.setattr(
        console, "error_console", lambda: Console(file=text, force_terminal=watched, width=100, highlight=False)
    )
    monkeypatch.setattr(console, "MESH_MESSAGE_INTERVAL", patience)
    with console.print_missing_meshes():
        afresh(egg(tmp_path / "egg.obj"))
    assert ("0 read, now egg.obj" in text.getvalue()) == (watched and not patience)


def test_the_last_word_is_no_less_than_what_a_plan_was_certified_with(tmp_path):
    """A thinned hull may reach beyond the capsule around its mesh; the body does not."""
    egg(tmp_path / "egg.obj")
    body = '<collision><geometry><mesh filename="egg.obj"/></geometry></collision>'
    slide = '<limit lower="-1" upper="1" velocity="1" effort="10"/>'
    (tmp_path / "eggs.urdf").write_text(
        f'<robot name="eggs"><link name="base">{body}</link><link name="between"/><link name="other">{body}</link>'
        f'<joint name="across" type="prismatic"><parent link="base"/><child link="between"/><axis xyz="0 1 0"/>'
        f'{slide}</joint><joint name="along" type="prismatic"><parent link="between"/><child link="other"/>'
        f'<axis xyz="1 0 0"/>{slide}</joint></robot>'
    )
    robot = load_robot(tmp_path / "eggs.urdf")
    collision = collision_of(robot, limits_of(robot, acceleration=1.0), np.array([0.3, 0.0]))
    q = np.column_stack([np.linspace(0.3, 0.1, 30), np.zeros(30)])
    poses = forward_kinematics(robot, q)
    certified = collision.every.bodies.distances(poses).min()
    by_hulls = coal.distances(collision.shapes, collision.pairs, poses, parts_of).min()
    assert by_hulls < certified - 1e-4
    assert closest_approaches(collision, robot, np.arange(30.0), q)[0].distance >= certified
