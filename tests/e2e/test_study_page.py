"""The study on the page that explains it is one: every key is known, and every key that is known is there."""

from __future__ import annotations

import dataclasses
import re
import tomllib
from pathlib import Path

from armid.estimation.estimators import PhysicallyConsistent
from armid.measurement.log_format import LogFormat
from armid.measurement.processing.options import ProcessingOptions
from armid.study.config import EstimationChoice, RecordingChoice, RobotChoice, build_estimator, parse_study

PAGE = Path(__file__).parents[2] / "docs" / "study.md"


def test_the_study_on_the_page_is_understood_and_complete():
    text, *_ = re.findall(r"```toml\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    study = parse_study(tomllib.loads(text))
    assert len(study.recordings) == 2
    whole = re.sub(r"^# (?=\w+ = )", "", text, flags=re.MULTILINE)
    written = set(re.findall(r"^(\w+) = ", whole, re.MULTILINE))
    for kind in (RobotChoice, RecordingChoice, LogFormat, ProcessingOptions, EstimationChoice):
        assert {field.name for field in dataclasses.fields(kind)} - {"reading", "options"} <= written


def test_options_of_a_method_on_the_page_are_understood_and_complete():
    _, text = re.findall(r"```toml\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    robot, recording = {"description": "panda"}, [{"path": "a.csv"}]
    choice = parse_study({"robot": robot, "recording": recording, **tomllib.loads(text)}).estimation
    assert build_estimator(choice).name == choice.method == "physical"
    assert set(choice.options["physical"]) == {field.name for field in dataclasses.fields(PhysicallyConsistent)}
