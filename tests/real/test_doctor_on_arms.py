"""The doctor on recorded arms: it finds unaided what is known of each, and calls nothing else an error."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import pytest

from armid import load_study
from armid.errors import Finding
from armid.study.diagnosis import diagnose

STUDIES = Path(__file__).parent / "studies"

pytestmark = pytest.mark.real

KNOWN: list[tuple[str, str, set[str]]] = [
    ("franka_panda_gaz", "exciting_first70", {"rows-repeated", "clock-jitter"}),
    ("kinova_gen3_raptor", "traj_1", {"description-rounded", "position-wrapped"}),
    ("kinova_gen3_raptor", "traj_3", {"description-rounded", "position-wrapped"}),
    ("kinova_gen3_raptor", "traj_5", {"description-rounded", "position-wrapped", "clock-gap"}),
    ("kuka_iiwa14_lasa", "samples_2000", set()),
    ("kuka_lbr_med7", "measurements.p", {"standstill"}),
    ("kuka_lbr_med7", "1_dgr", {"excitation-weak"}),
    ("kuka_lwr4plus", "measurements_1", set()),
    ("kuka_lwr4plus", "measurements_3", set()),
    ("staubli_tx40", "first70", set()),
    ("ur10_unisa", "ur10_exciting", set()),
    ("ur10e_innopolis", "20sec", {"clock-jitter"}),
    ("ur10e_innopolis", "30sec", {"clock-jitter"}),
    ("ur10e_innopolis", "40sec", {"clock-jitter"}),
    ("ur10e_innopolis", "12-50sec", {"clock-jitter"}),
    ("ur10e_innopolis", "14harm50sec", {"clock-jitter"}),
]
"""Every recording of each arm, and what must be found on it as its study reads it."""


@lru_cache(maxsize=16)
def findings(name: str, part: str, *left_out: str) -> tuple[Finding, ...]:
    study = load_study(STUDIES / f"{name}.toml")
    plain: dict[str, Any] = {"torque_sign": 1.0, "rate": None, "drive_gain": None, "drive_gain_deviation": None}
    choice = next(choice for choice in study.recordings if part in choice.path)
    reading = replace(choice.reading, **{key: plain[key] for key in left_out})
    choice = replace(choice, role="train", part=(0.0, 1.0), reading=reading)
    (found,) = diagnose(replace(study, recordings=(choice,)))
    return found.findings


@pytest.mark.parametrize(("name", "part", "known"), KNOWN)
def test_what_is_known_is_found_and_nothing_called_an_error(shared_data: Path, name: str, part: str, known: set[str]):
    found = findings(name, part)
    assert known <= {f.code for f in found}
    assert not [f for f in found if f.severity == "error"]
    assert not {f.code for f in found} & {"contact", "temperature-drift", "velocity-mismatch", "channel-dead"}


@pytest.mark.parametrize(
    ("name", "part"),
    [("kuka_iiwa14_lasa", "samples_2000"), ("kuka_lbr_med7", "measurements.p"), ("kinova_gen3_raptor", "traj_1")],
)
def test_the_opposite_torque_is_found_where_the_study_does_not_say_it(shared_data: Path, name: str, part: str):
    errors = [f for f in findings(name, part, "torque_sign") if f.severity == "error"]
    assert [(f.code, f.remedy) for f in errors] == [("torque-sign", "torque_sign = -1")]


def test_a_missing_clock_hides_nothing_behind_it(shared_data: Path):
    found = findings("kuka_iiwa14_lasa", "samples_2000", "rate", "torque_sign")
    assert {f.code for f in found if f.severity == "error"} == {"clock-missing", "torque-sign"}
    assert "50 Hz" in next(f.remedy for f in found if f.code == "clock-missing")


def test_currents_need_gains(shared_data: Path):
    found = findings("ur10e_innopolis", "30sec", "drive_gain", "drive_gain_deviation")
    assert {f.code for f in found if f.severity == "error"} == {"current-without-gain"}


def test_standing_still_is_information(shared_data: Path):
    (found,) = (f for f in findings("kuka_lbr_med7", "measurements.p") if f.code == "standstill")
    assert found.severity == "info" and "3.6 s" in found.evidence


def test_repeated_rows_are_counted(shared_data: Path):
    (found,) = (f for f in findings("franka_panda_gaz", "exciting_first70") if f.code == "rows-repeated")
    assert found.evidence.startswith("791 of")
