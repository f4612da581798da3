"""A stored fleet whose archives contradict themselves is refused with the name of the file."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from armid.dataclass_files import save
from armid.errors import ArmidError
from armid.hashes import sha256_of_file
from armid.robot import load_robot
from armid.runs.fleet.stored_fleet import load_fleet, save_fleet
from armid.study.fleet.fleet_file import load_fleet_file
from armid.study.fleet.identify_fleet import identify_fleet
from fleets import made_fleet, write_fleet

Arrays = dict[str, Any]


@pytest.fixture(scope="module")
def stored(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a fleet of two units."""
    place = tmp_path_factory.mktemp("fleet")
    fleet = identify_fleet(load_fleet_file(write_fleet(made_fleet(2, 1, repetitions=1), place)))
    return save_fleet(fleet, place / "stored")


def changed(folder: Path, change: Callable[[dict[str, Any], Arrays], object]) -> None:
    """Changes the header or the arrays of the estimate, and writes the digest that fits."""
    path = folder / "fleet.npz"
    with np.load(path) as archive:
        arrays = {name: archive[name] for name in archive.files}
    header = json.loads(bytes(arrays["value.json"]))
    change(header["value"], arrays)
    arrays["value.json"] = np.frombuffer(json.dumps(header).encode(), np.uint8)
    np.savez(path, **arrays)
    record = json.loads((folder / "fleet.json").read_text())
    record["sha256"]["fleet.npz"] = sha256_of_file(path)
    (folder / "fleet.json").write_text(json.dumps(record))


def with_array(*place: str, by: Callable[[Any], Any]) -> Callable[[dict[str, Any], Arrays], object]:
    """Change of one array of the estimate."""

    def change(value: dict[str, Any], arrays: Arrays) -> object:
        for name in place:
            value = value[name]
        return arrays.update({value["array"]: by(arrays[value["array"]])})

    return change


def of_one_row(x: Any) -> Any:
    return np.where(np.arange(len(x))[:, None] == 0, 2.0 * x, x)


FAULTS: dict[str, Callable[[dict[str, Any], Arrays], object]] = {
    "torque scales of two joints": with_array("scale", by=lambda x: x[:, :2]),
    "values of fewer parameters": with_array("values", by=lambda x: x[:, 1:]),
    "scores of fewer unknowns": with_array("score", by=lambda x: x[:, 1:]),
    "negative deviations": with_array("deviation", by=lambda x: -x),
    "no noise": with_array("prior", "noise", by=lambda x: 0.0 * x),
    "half a row for a sample": with_array("prior", "correlation", by=lambda x: 0.5 + 0.0 * x),
    "a negative scatter of scales": with_array("prior", "scale_deviation", by=lambda x: -x),
    "a negative covariance": with_array("prior", "covariance", by=lambda x: -x),
    "an asymmetric covariance": with_array("prior", "covariance", by=of_one_row),
    "a joint for too many unknowns": with_array("own", "joint", by=lambda x: np.append(x, 0)),
    "an unknown own parameter": lambda value, _: value["prior"]["own"].__setitem__(0, "FV_99"),
    "an own parameter too few": lambda value, _: value["prior"]["own"].pop(),
    "a unit too many": lambda value, _: value["units"].append("unit-99"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_contradictions_are_refused(fault: str, stored: Path, tmp_path: Path):
    folder = tmp_path / "copied"
    folder.mkdir()
    for name in ("fleet.json", "fleet.npz", "robot.npz"):
        (folder / name).write_bytes((stored / name).read_bytes())
    load_fleet(folder)
    changed(folder, FAULTS[fault])
    with pytest.raises(ArmidError, match=r"fleet\.npz cannot be read as a FleetEstimate .*"):
        load_fleet(folder)


def test_the_arm_of_another_fleet_is_refused(stored: Path, tmp_path: Path):
    folder = tmp_path / "copied"
    folder.mkdir()
    (folder / "fleet.npz").write_bytes((stored / "fleet.npz").read_bytes())
    robot = load_robot(stored.parent / "small.urdf", lock={"joint_3": 0.0})
    save(robot, folder / "robot.npz")
    record = json.loads((stored / "fleet.json").read_text())
    record["sha256"]["robot.npz"] = sha256_of_file(folder / "robot.npz")
    (folder / "fleet.json").write_text(json.dumps(record))
    with pytest.raises(ArmidError, match="2 joints and an estimate with 3"):
        load_fleet(folder)
