"""Load data for controllers, read back by readers that were written from the vendors' pages."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from armid.errors import OutputError
from armid.estimation.update.payload import LOAD_NAMES
from armid.export.load.catalogue import CONTROLLERS
from armid.export.load.flange_load import FlangeLoad, read_load
from armid.export.load.principal_axes import principal_axes
from armid.export.load.write import write_load, written_record
from armid.maths.rotations import axis_rotation, homogeneous, rpy_rotation
from armid.runs.payload import PRINTED
from controller_files import (
    Array,
    read_abb,
    read_doosan,
    read_fanuc,
    read_franka_cpp,
    read_franka_json,
    read_kuka,
    read_ur,
    read_xarm,
    ten,
)

BODIES = 200
DOUBLE = 1e-12  # seventeen digits, and what sums of a few products lose
SINGLE = 1.1e-8  # half a unit of the ninth digit of two factors
TURNED = 5e-8  # nine digits of an angle in degrees or of a quaternion, as a rotation of the principal axes

FULL = {
    "ur": (read_ur, DOUBLE),
    "franka": (read_franka_json, DOUBLE),
    "franka, libfranka": (read_franka_cpp, DOUBLE),
    "kuka": (read_kuka, TURNED),
    "abb": (read_abb, TURNED),
}
PART = {"fanuc": read_fanuc, "xarm": read_xarm, "doosan": read_doosan}


def cloud(seed: int) -> tuple[Array, Array]:
    """Masses (6,) and points (6, 3) of a body, which therefore exists; sizes from a millimetre to half a metre."""
    rng = np.random.default_rng(seed)
    size = 10.0 ** rng.uniform(-3.0, -0.3)
    return rng.uniform(0.05, 3.0, 6), rng.normal(0.0, size, (6, 3)) + rng.normal(0.0, 0.1, 3)


def body(masses: Array, points: Array) -> tuple[float, Array, Array]:
    """Mass, centre and inertia about it, by sums over points."""
    mass = float(masses.sum())
    com = masses @ points / mass
    arms = points - com
    about = sum(m * (r @ r * np.eye(3) - np.outer(r, r)) for m, r in zip(masses, arms, strict=True))
    return mass, com, np.asarray(about)


def load_of(values: Array, covariance: Array | None = None) -> FlangeLoad:
    known = np.zeros((10, 10)) if covariance is None else covariance
    half = 1.96 * np.sqrt(known[0, 0])
    mass = np.array([values[0] - half, values[0] + half])
    return FlangeLoad("arm", "runs/arm", "tool0", values, values, known, 1.96, np.zeros(10, dtype=bool), mass, ())


def files_of(load: FlangeLoad, controller: str) -> dict[str, str]:
    return dict(CONTROLLERS[controller.split(",")[0]].write(load).files)


def scale_of(values: Array) -> Array:
    """Sizes of mass, first moments and inertias of a body."""
    return np.repeat([values[0], np.linalg.norm(values[1:4]) + values[0] * 1e-3, values[[4, 6, 9]].max()], [1, 3, 6])


@pytest.mark.parametrize("controller", FULL)
def test_ten_parameters_are_read_back(controller: str):
    reader, tolerance = FULL[controller]
    for seed in range(BODIES):
        values = ten(*body(*cloud(seed)))
        error = np.abs(reader(files_of(load_of(values), controller)) - values) / scale_of(values)
        assert error[:4].max() <= min(tolerance, SINGLE) and error[4:].max() <= tolerance, seed


@pytest.mark.parametrize("controller", PART)
def test_what_the_controller_takes_is_read_back(controller: str):
    for seed in range(BODIES):
        mass, com, about = body(*cloud(seed))
        expected = np.array([mass, *com, *about.diagonal()])
        found = PART[controller](files_of(load_of(ten(mass, com, about)), controller))
        expected = expected[: len(found)]
        # a difference of a parallel-axis term loses digits of small inertias far from the flange
        lost = 1e-15 * np.array([mass, 1, 1, 1, *[mass * (com @ com) * 1e2] * 3])[: len(found)]
        assert (np.abs(found - expected) <= SINGLE * np.abs(expected) + lost).all(), seed


SHAPES = {
    "sphere": [1.0, 1.0, 1.0],
    "disc": [1.0, 1.0, 2.0],
    "thin rod": [1.0, 1.0, 0.0],
    "plate": [1.0, 2.0, 3.0],
    "nearly a sphere": [1.0, 1.0 + 1e-10, 1.0 + 3e-13],
    "point": [0.0, 0.0, 0.0],
}


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("controller", ["kuka", "abb"])
def test_equal_moments(controller: str, shape: str):
    rng = np.random.default_rng(3)
    reader, _ = FULL[controller]
    for turn in [np.eye(3), *(axis_rotation(a / np.linalg.norm(a), 2.0) for a in rng.normal(size=(20, 3)))]:
        values = ten(2.0, np.array([0.01, -0.02, 0.05]), 0.02 * turn @ np.diag(SHAPES[shape]) @ turn.T)
        error = np.abs(reader(files_of(load_of(values), controller)) - values)
        assert error.max() <= TURNED * 0.06


def test_axes_are_near_those_of_the_flange():
    found = principal_axes(np.diag([3.0, 1.0, 2.0]))
    np.testing.assert_array_equal(found.axes, np.eye(3))
    np.testing.assert_array_equal(found.moments, [3.0, 1.0, 2.0])
    turned = axis_rotation(np.array([0.0, 0.0, 1.0]), 0.3)
    np.testing.assert_allclose(principal_axes(turned @ np.diag([3.0, 1.0, 2.0]) @ turned.T).axes, turned, atol=1e-12)


@pytest.mark.parametrize("controller", CONTROLLERS)
def test_intervals_hold_the_numbers_of_drawn_loads(controller: str):
    """Small errors of the ten parameters: 95 % of the drawn loads have a number within its interval."""
    rng = np.random.default_rng(5)
    values = ten(
        2.0,
        np.array([0.02, -0.03, 0.08]),
        np.array([[0.02, 0.002, 0.001], [0.002, 0.03, -0.003], [0.001, -0.003, 0.012]]),
    )
    root = 1e-4 * rng.normal(size=(10, 10)) * scale_of(values)[:, None]
    covariance = root @ root.T
    stated = CONTROLLERS[controller].write(load_of(values, covariance)).numbers
    draws = 400
    held = np.zeros(len(stated))
    for _ in range(draws):
        numbers = CONTROLLERS[controller].write(load_of(values + root @ rng.normal(size=10))).numbers
        held += [s.interval[0] <= n.value <= s.interval[1] for s, n in zip(stated, numbers, strict=True)]
    assert [n.name for n in stated] and (np.abs(held / draws - 0.95) <= 0.045).all()  # four deviations of the count


def test_axes_of_equal_moments_have_no_interval():
    load = load_of(ten(2.0, np.zeros(3), 0.02 * np.eye(3)), 1e-8 * np.eye(10))
    text = CONTROLLERS["kuka"].write(load)
    angles = {n.name: n for n in text.numbers if n.name in "ABC"}
    assert all(n.value == 0.0 and np.isnan(n.interval).all() for n in angles.values())
    assert "A = 0 deg, not determined" in text.files["load_kuka.dat"]


@pytest.mark.parametrize("controller", CONTROLLERS)
def test_a_file_says_what_it_is(controller: str, tmp_path: Path):
    load = replace(load_of(ten(*body(*cloud(1))), 1e-6 * np.eye(10)), unclear=("ZZ prior-dominated",))
    (written,) = write_load(load, controller, tmp_path)
    text = next(path for path in written.files if path.suffix != ".json").read_text()
    assert "was not tried on a robot" in text and "tool0" in text and "runs/arm" in text
    assert "ZZ prior-dominated" in text
    low, high = load.mass_interval
    assert f"interval {low:.6g} to {high:.6g} kg" in text
    record = json.loads(json.dumps(written_record([written]), default=np.ndarray.tolist))[controller]
    assert record["numbers"][0]["interval95"] == [low, high]
    assert all(Path(path).is_file() for path in record["files"])


def test_bounds_of_the_vendor():
    values = ten(500.0, np.zeros(3), np.diag([100.0, 133.5, 100.0]))
    with pytest.raises(OutputError, match="at most 133 kg"):
        CONTROLLERS["ur"].write(load_of(values))
    assert CONTROLLERS["franka"].write(load_of(values)).files


def test_large_products_that_are_left_out_are_told():
    turn = rpy_rotation([0.0, 0.5, 0.0])
    turned = ten(2.0, np.zeros(3), turn @ np.diag([0.01, 0.02, 0.025]) @ turn.T)
    straight = ten(2.0, np.zeros(3), np.diag([0.01, 0.02, 0.025]))
    assert [f.code for f in CONTROLLERS["fanuc"].write(load_of(turned)).findings] == ["products-not-written"]
    assert not CONTROLLERS["fanuc"].write(load_of(straight)).findings


def test_other_files_are_kept(tmp_path: Path):
    load = load_of(ten(*body(*cloud(1))))
    other = tmp_path / "load_ur.script"
    other.write_text("def mine():\nend\n")
    with pytest.raises(OutputError, match="would be overwritten"):
        write_load(load, ["kuka", "ur"], tmp_path)
    assert other.read_text().startswith("def mine") and not (tmp_path / "load_kuka.dat").exists()
    other.unlink()
    assert len(write_load(load, "ur,kuka, ur", tmp_path)) == 2
    assert len(write_load(load, ["ur", "franka"], tmp_path)) == 2  # its own files are replaced
    with pytest.raises(OutputError, match="did you mean 'kuka'"):
        write_load(load, "kuca", tmp_path)


# the stored payload and the flange ---------------------------------------------------------------------------------


def stored(masses: Array, points: Array, path: Path, **changes: Any) -> Path:
    """The file of a payload that consists of points, given in the tip frame."""
    values = ten(*body(masses, points))
    parameters = [
        {"name": LOAD_NAMES[k], "value": values[k], "unconstrained": values[k], "status": "identified"}
        for k in PRINTED
    ]
    record = {
        "run": "runs/arm",
        "robot": "arm",
        "link": "wrist",
        "frame": "tool0",
        "tip": {"name": "tool0", "link": "wrist", "placement": np.eye(4).tolist()},
        "parameters": parameters,
        "mass": {"interval95": [values[0] - 0.1, values[0] + 0.1]},
        "covariance": {"matrix": (1e-8 * np.eye(10)).tolist(), "quantile": 2.0},
        "verdict": "not judged",
        "warnings": [],
    } | changes
    path.write_text(json.dumps(record))
    return path


def test_the_flange_is_another_frame(tmp_path: Path):
    """The same points, seen from the flange."""
    masses, points = cloud(7)
    rpy, xyz = [0.3, -1.2, 2.0], np.array([0.01, -0.05, 0.2])
    path = stored(masses, points, tmp_path / "payload.json")
    load = read_load(path, ",".join(map(str, [*xyz, *rpy])))
    seen = (points - xyz) @ rpy_rotation(rpy)
    expected = ten(*body(masses, seen))
    np.testing.assert_allclose(load.values, expected, atol=1e-12)
    np.testing.assert_allclose(read_ur(files_of(load, "ur")), expected, atol=1e-12)
    assert load.mass_interval.tolist() == [masses.sum() - 0.1, masses.sum() + 0.1]


def test_a_load_in_the_frame_of_the_link_is_moved_to_the_tip(tmp_path: Path):
    masses, points = cloud(8)
    R, p = rpy_rotation([0.3, -1.2, 2.0]), np.array([0.01, -0.05, 0.2])
    tip = {"name": "tool0", "link": "wrist", "placement": homogeneous(R, p).tolist()}
    load = read_load(stored(masses, points, tmp_path / "payload.json", frame="wrist", tip=tip))
    np.testing.assert_allclose(load.values, ten(*body(masses, (points - p) @ R)), atol=1e-12)
    assert "tool0" in load.flange


def test_parameters_that_are_not_determined_stay_so_in_other_axes(tmp_path: Path):
    masses, points = cloud(9)
    path = stored(masses, points, tmp_path / "payload.json")
    record = json.loads(path.read_text())
    record["parameters"][3]["status"] = "not identifiable"  # MZ
    path.write_text(json.dumps(record))
    upright, turned = read_load(path), read_load(path, "0,0,0,0.4,0,0")
    assert np.isnan(upright.com_intervals[2]).all() and np.isfinite(upright.com_intervals[:2]).all()
    assert np.isnan(turned.com_intervals[1:]).all() and np.isfinite(turned.com_intervals[0]).all()
    assert (
        "CoGz" in files_of(upright, "ur")["load_ur.script"]
        and "not determined" in files_of(upright, "ur")["load_ur.script"]
    )


def test_loads_that_are_not_written(tmp_path: Path):
    masses, points = cloud(2)
    path = tmp_path / "payload.json"
    with pytest.raises(OutputError, match="on the link forearm"):
        read_load(stored(masses, points, path, link="forearm"))
    with pytest.raises(OutputError, match="have errors"):
        read_load(stored(masses, points, path, verdict="fail"))
    warning = {"code": "load-not-real", "evidence": "It is far.", "remedy": "look"}
    with pytest.raises(OutputError, match="load-not-real: It is far"):
        read_load(stored(masses, points, path, warnings=[warning]))
    with pytest.raises(OutputError, match="No real body"):
        read_load(stored(np.array([1.0, -1.5, 1.0]), points[:3], path))
    with pytest.raises(OutputError, match="six numbers"):
        read_load(stored(masses, points, path), "0,0,1")
    for change in (
        {"mass": {"interval95": []}},
        {"covariance": {"matrix": np.eye(9).tolist(), "quantile": 2.0}},
        {"frame": "wrist", "tip": {"name": "tool0", "link": "wrist", "placement": [0.0, 0.0, 0.0, 1.0]}},
    ):
        with pytest.raises(OutputError, match=r"payload\.json cannot be read .*shape"):
            read_load(stored(masses, points, path, **change))
    path.write_text('{"mass": 3}')
    with pytest.raises(OutputError, match="cannot be read as a payload of this version of armid"):
        read_load(path)
    with pytest.raises(OutputError, match="cannot be read as a payload"):
        read_load(tmp_path / "none")
