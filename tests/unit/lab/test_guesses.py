"""Guesses for mistyped names: the one that was meant, and none where nothing is like it."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from armid import load_robot
from armid.errors import ArmidError, did_you_mean
from armid.excitation.thesis_plans import builtin_plan
from armid.lab.controller import Controller
from armid.lab.known_arms import truth_of, with_effects
from armid.lab.options import parse_options
from armid.study.config import EstimationChoice, ModelChoice, build_model, parse_study

TYPOS: dict[str, tuple[Callable[[], object], str]] = {
    "method": (lambda: EstimationChoice("phyiscal"), "physical"),
    "term": (lambda: build_model(load_robot("panda"), ModelChoice(("rigid-body", "viscuos"))), "viscous"),
    "key of a study": (lambda: parse_study({"robot": {"description": "panda", "gravty": [0, 0, 1]}}), "gravity"),
    "table of a study": (lambda: parse_study({"robbot": {}}), "robot"),
    "key of a lab": (lambda: parse_options({"sensing": {"rat": 100.0}}), "rate"),
    "plan": (lambda: builtin_plan("thesis-b1"), "thesis-a1"),
    "effect": (lambda: with_effects(truth_of(load_robot("panda")), ["stribek"]), "stribeck"),
    "controller": (lambda: Controller(kind="pdgravity"), "pd-gravity"),
    "arm": (lambda: load_robot("pandda"), "panda"),
    "joint": (lambda: load_robot("iiwa14-r820").joint_index("A11"), "A1"),
}


@pytest.mark.parametrize("what", TYPOS)
def test_a_mistyped_name_is_guessed(what: str):
    make, meant = TYPOS[what]
    with pytest.raises(ArmidError) as caught:
        make()
    assert f"did you mean {meant!r}?" in caught.value.remedy
    assert meant in caught.value.possible


def test_case_does_not_matter_and_nonsense_is_not_guessed():
    assert did_you_mean("FV_1", ["fv_1"]) == did_you_mean("fv_1", ["fv_1"]) == "did you mean 'fv_1'?"
    assert did_you_mean("quaternion", ["viscous", "coulomb"]) == ""
