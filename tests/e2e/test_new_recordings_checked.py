"""Commands that extend a run by new recordings check these as the doctor does, and compare them with the run."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from armid.checked_array import Array
from armid.lab.inverse_dynamics_recording import record
from armid.maths.inertia import com_inertia_to_vector
from armid.measurement.recording import Recording
from armid.runs.new_recordings import check_new_recordings, read_new_recordings
from armid.runs.run import load_run, save_run
from armid.study.config import load_study
from armid.study.identify import identify
from command_line import Armid, command_line
from labs import (
    FRICTION,
    KNOWN_FRICTION,
    SENSORS,
    small_model_with_rotors,
    small_plan,
    small_truth_with_rotors,
    write_arm,
    write_recording,
    write_study,
)

ROTOR = (0.5, 0.4, 0.2)
"""Rotor inertia of the joints, a good part of the inertia of the links that they move [kg·m²]."""

HEAVY = com_inertia_to_vector(6.0, np.array([0.05, 0.02, 0.1]), np.diag([0.03, 0.04, 0.02]))
"""Load as heavy as the whole arm."""

EXTENDING = (("recalibrate", "--all", "--out", "new"), ("recalibrate", "--out", "new"), ("payload",), ("track",))
"""Commands that extend a run, with their options."""


def recorded(seed: int, *, load: Array | None = None, friction: float = 1.0, rotor: bool = False) -> Recording:
    """The small arm, with a load on its last link, so many times its friction, and rotors."""
    model, theta = small_model_with_rotors(), small_truth_with_rotors().copy()
    if load is not None:
        theta[model.inertial_columns.reshape(-1, 10)[-1]] += load
    for k, parameter in enumerate(model.parameters):
        if parameter.symbol in FRICTION:
            theta[k] = friction * FRICTION[parameter.symbol][parameter.number - 1]
        elif parameter.symbol == "IA":
            theta[k] = rotor * ROTOR[parameter.number - 1]
    return record(model, theta, small_plan(seed), SENSORS, np.random.default_rng(seed), repetitions=2)[0]


def changed(recording: Recording, factor: Array) -> Recording:
    """The recording with its efforts multiplied by factors."""
    assert recording.effort is not None
    return replace(recording, effort=recording.effort * factor)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run from torque sensors, sound recordings that were made after it, and recordings with faults."""
    folder = tmp_path_factory.mktemp("new_recordings")
    write_arm(folder)
    write_recording(recorded(1), folder / "sensors.npz")
    write_study(folder, KNOWN_FRICTION.format(log="sensors.npz"))
    write_recording(recorded(2, friction=2.0), folder / "sound.npz")
    write_recording(recorded(3, load=HEAVY, friction=0.5), folder / "heavy.npz")
    write_recording(changed(recorded(4, load=HEAVY), np.array([1.0, 1.0, -1.0])), folder / "sign.npz")
    write_recording(changed(recorded(5, load=HEAVY), np.full(3, 0.01)), folder / "motors.npz")
    write_recording(recorded(6, load=HEAVY, friction=2.0, rotor=True), folder / "rotors.npz")
    write_recording(recorded(7, load=HEAVY, friction=2.0, rotor=True), folder / "rotors_again.npz")
    save_run(identify(load_study(folder / "study.toml")), folder / "run")
    return folder


@pytest.fixture
def armid(capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, folder: Path) -> Armid:
    """Runs the command line in this process, with nobody watching."""
    return command_line(capfd, monkeypatch, folder)


@pytest.mark.parametrize("command", EXTENDING, ids=" ".join)
@pytest.mark.parametrize(
    ("recording", "code", "remedy"),
    [
        ("sign.npz", "torque-sign", "--reading 'torque_sign = [1, 1, -1]'"),
        ("motors.npz", "motor-side", "--reading 'drive_gain = ["),
        ("rotors.npz", "rotor-inertia-missing", 'terms = ["rigid-body", "viscous", "coulomb", "rotor-inertia"]'),
    ],
)
def test_a_fault_of_a_new_recording_fails(
    armid: Armid, command: tuple[str, ...], recording: str, code: str, remedy: str
):
    status, out, err = armid(command[0], "run", recording, *command[1:])
    assert f"error {code}" in err and remedy in err
    assert status == 1 and "fail" in out and f"errors in the recordings ({code})" in out
    status, out, _ = armid(command[0], "run", recording, *command[1:], "--json")
    told = json.loads(out)
    assert status == 1 and told.get("validation", told)["verdict"] == "fail"
    assert code in [each["code"] for each in told["warnings"]]


@pytest.mark.parametrize("command", EXTENDING, ids=" ".join)
@pytest.mark.parametrize("recording", ["sound.npz", "heavy.npz"])
def test_a_load_or_other_friction_is_no_fault(armid: Armid, command: tuple[str, ...], recording: str):
    status, out, err = armid(command[0], "run", recording, *command[1:])
    assert status == 0 and not re.search("^error", err, re.MULTILINE) and "errors in the recordings" not in out


def test_the_page_of_a_recalibrated_run_names_the_fault(armid: Armid, tmp_path: Path):
    assert armid("recalibrate", "run", "rotors.npz", "--all", "--out", tmp_path / "new")[0] == 1
    validation = json.loads((tmp_path / "new" / "validation.json").read_text())
    assert validation["verdict"] == "fail"
    assert armid("report", tmp_path / "new", "--out", tmp_path / "page.html")[0] == 0
    page = (tmp_path / "page.html").read_text()
    assert "rotor-inertia-missing" in page and "has no rotor inertia" in page


def test_a_run_that_failed_for_rotors_does_not_excuse_them(armid: Armid, tmp_path: Path):
    assert armid("recalibrate", "run", "rotors.npz", "--all", "--out", tmp_path / "new")[0] == 1
    status, _, err = armid("recalibrate", tmp_path / "new", "rotors_again.npz", "--all", "--out", tmp_path / "again")
    assert status == 1 and "error rotor-inertia-missing" in err


def test_rotors_are_not_offered_as_another_tool(armid: Armid, tmp_path: Path):
    _, _, err = armid("recalibrate", "run", "rotors.npz", "--out", tmp_path / "new")
    err = " ".join(err.split())
    assert "more-has-changed" in err and "first correct rotor-inertia-missing" in err and "--tool or --all" not in err


def test_a_fault_of_a_validation_recording_fails(armid: Armid, tmp_path: Path):
    command = ("recalibrate", "run", "sound.npz", "--validate", "sign.npz", "--out", tmp_path / "new")
    status, out, err = armid(*command)
    assert status == 1 and "errors in the recordings (torque-sign)" in out and "error torque-sign" in err


def test_a_failed_run_is_no_reference_for_the_scale_of_a_torque(folder: Path):
    """Its links may be far from the arm; a sound recording has no other unit because of them."""
    run = load_run(folder / "run")
    fit = run.estimate.fit
    wrong = replace(run, estimate=replace(run.estimate, fit=replace(fit, values=10.0 * fit.values, standard=None)))
    recording, read = read_new_recordings(run, (str(folder / "sound.npz"),), {})
    for verdict, expected in (("pass", True), ("fail", False)):
        found = check_new_recordings(replace(wrong, verdict=verdict), recording, read)
        assert any(each.severity == "error" for each in found) == expected
    heavy, read = read_new_recordings(run, (str(folder / "heavy.npz"),), {})
    assert not any(
        each.severity == "error" for each in check_new_recordings(replace(wrong, verdict="fail"), heavy, read)
    )
