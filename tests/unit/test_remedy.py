"""Remedies: text and the settings in it."""

from __future__ import annotations

import copy
from dataclasses import dataclass

import pytest

from armid.dataclass_files import load, save
from armid.errors import Finding
from armid.measurement.remedy_builders import lines
from armid.remedy import Remedy, setting

CASES = [
    (lines("Hz", rate=50.0), "rate = 50.0  # Hz"),
    (lines(table="robot", gravity=[0.0, 0.0, 9.81]), "gravity = [0.0, 0.0, 9.81]  # in [robot]"),
    (lines("or more", "estimation", weight=2.0), "weight = 2.0  # in [estimation]: or more"),
    (lines(columns={"time": ""}, rate=50.0), 'columns = { time = "" }\nrate = 50.0'),
    (
        Remedy("use ", setting("method", "ols"), " and look at the residual."),
        'use method = "ols" and look at the residual.',
    ),
    (Remedy("record it again."), "record it again."),
]


@pytest.mark.parametrize(("remedy", "text"), CASES)
def test_a_remedy_is_its_text_and_a_stored_one_reads_back(remedy: Remedy, text: str):
    assert remedy == text
    for again in (Remedy.read(text), copy.deepcopy(remedy)):
        assert again == text and (again.keys, again.note, again.table) == (remedy.keys, remedy.note, remedy.table)
        assert "".join(p if isinstance(p, str) else p.text for p in again.parts) in text.replace("\n", "")


def test_several_remedies_are_one_sentence_with_the_settings_of_all():
    joined = Remedy.joined([lines("Hz", rate=50.0), "record it again"])
    assert joined == "rate = 50.0  # Hz; record it again" and joined.keys == {}
    assert setting("rate", 50.0) in joined.parts
    assert Remedy.joined([lines(rate=50.0)]).keys == {"rate": 50.0}


@dataclass(frozen=True)
class Told:
    findings: tuple[Finding, ...]


def test_remedies_of_stored_findings_are_values(tmp_path):
    told = Told((Finding("clock-missing", "error", "", "no clock", lines("Hz", rate=50.0)),))
    (found,) = load(Told, save(told, tmp_path / "told.npz")).findings
    assert isinstance(found.remedy, Remedy) and found.remedy.keys == {"rate": 50.0} and (found,) == told.findings
