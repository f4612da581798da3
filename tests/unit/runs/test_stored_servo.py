"""A stored result of `armid servo` whose record contradicts itself is refused with the name of the file."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from armid.cli.main import main
from armid.errors import ArmidError
from armid.export.servos.mjcf_actuators import servo_mjcf
from armid.runs.servos.stored_servo import load_servo
from servo_labs import any_parameters, recorded, servo_model, small_arm


@pytest.fixture(scope="module")
def stored(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("servo")
    rng, model = np.random.default_rng(5), servo_model(small_arm())
    truth = any_parameters(model, rng)
    (folder / "arm.xml").write_bytes(servo_mjcf(model, truth))
    run = recorded(model, truth, rng, 4.0)
    columns = ",".join(["t", *(f"{name}{k}" for name in ("q", "command") for k in (1, 2, 3))])
    table = np.column_stack([run.time, run.q, run.held(run.time)])
    np.savetxt(folder / "log.csv", table, delimiter=",", header=columns, comments="", fmt="%.17g")
    options = ["--columns", "effort=", "--units", "rad", "--no-report", "--out", "stored"]
    with pytest.MonkeyPatch.context() as patch, pytest.raises(SystemExit) as ended:
        patch.chdir(folder)
        main(["servo", "arm.xml", "log.csv", *options])
    assert not ended.value.code
    return folder / "stored"


def set_to(name: str, change: Callable[[Any], object]) -> Callable[[dict[str, Any]], object]:
    return lambda record: record.__setitem__(name, change(record[name]))


FAULTS: dict[str, Callable[[dict[str, Any]], object]] = {
    "no step": set_to("longest_step", lambda _: "nan"),
    "a step of a nanosecond": set_to("longest_step", lambda _: 1e-9),
    "a step of a second": set_to("longest_step", lambda _: 1.0),
    "no friction": set_to("parameters", lambda old: {**old, "friction": []}),
    "servos of two joints": set_to(
        "parameters", lambda old: {key: value if key == "friction" else value[:2] for key, value in old.items()}
    ),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_contradictions_are_refused(fault: str, stored: Path, tmp_path: Path):
    folder = tmp_path / "copied"
    shutil.copytree(stored, folder)
    load_servo(folder)
    record = json.loads((folder / "servo.json").read_text())
    FAULTS[fault](record)
    (folder / "servo.json").write_text(json.dumps(record))
    with pytest.raises(ArmidError, match=r"servo\.json cannot be read as a"):
        load_servo(folder)
