"""Tables of the pages that list terms, methods, codes, functions and languages are those of the code."""

from __future__ import annotations

import dataclasses
import re
import tomllib
from pathlib import Path

import pytest

from armid.codegen.catalogue import LANGUAGES
from armid.codegen.functions import PROGRAMS
from armid.doctor import effects
from armid.estimation.catalogue import ESTIMATORS
from armid.input_boundary import LIMITS
from armid.measurement.log_format import LogFormat
from armid.measurement.processing.options import ProcessingOptions
from armid.model.dynamics_model import DynamicsModel
from armid.model.terms import TERMS
from armid.study.config import EstimationChoice, ModelChoice, RecordingChoice, RobotChoice
from labs import small_model

DOCS = Path(__file__).parents[2] / "docs"
STUDY, DOCTOR, CODE = ((DOCS / name).read_text(encoding="utf-8") for name in ("study.md", "doctor.md", "code.md"))
QUOTED = re.compile(r"`([^`]+)`")

NOT_WRITTEN = {"joints", "reading", "shapes", "automatic", "options"}
"""Fields that a page describes for all terms together, or that no study has."""


def rows(page: str, head: str) -> list[list[str]]:
    """Cells of each row of the table with a given head; a bar within a cell is escaped."""
    lines = page.split(f"\n{head}\n")[1].split("\n\n")[0].splitlines()[1:]
    return [[cell.strip() for cell in re.split(r"(?<!\\)\|", line.strip("|"))] for line in lines]


def fields_of(*kinds: type) -> set[str]:
    return {field.name for kind in kinds for field in dataclasses.fields(kind)} - NOT_WRITTEN


def keys_of_block(table: str) -> set[str]:
    """Keys of a table in the example of a study, those in comments included."""
    (example,) = re.findall(r"```toml\n(\[robot\]\ndescription.*?)```", STUDY, re.DOTALL)
    parts = re.split(r"^(?=\[)", example, flags=re.MULTILINE)
    text = "\n".join(part for part in parts if part.startswith(table))
    return set(re.findall(r"^(?:# )?(\w+) = ", text, re.MULTILINE))


# docs/study.md ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("table", "kinds"),
    [
        ("[robot]", (RobotChoice,)),
        ("[[recording]]", (RecordingChoice, LogFormat)),
        ("[processing]", (ProcessingOptions,)),
    ],
)
def test_the_example_of_a_study_shows_every_key(table: str, kinds: tuple[type, ...]):
    stated = keys_of_block(table)
    assert stated - {"joints"} == fields_of(*kinds)


def test_tables_of_models_and_methods_in_the_example_name_what_exists():
    assert keys_of_block("[model]") <= {*fields_of(ModelChoice), *TERMS}
    assert keys_of_block("[estimation]") - set(ESTIMATORS) == fields_of(EstimationChoice)


def test_the_table_of_terms():
    table = {QUOTED.findall(row[0])[0]: row for row in rows(STUDY, "| term | torque | parameters | options |")}
    assert list(table) != [] and set(table) == set(TERMS)
    for name, term in TERMS.items():
        options = {word for word in QUOTED.findall(table[name][3])}
        wanted = {field.name for field in dataclasses.fields(term)}
        assert options == (wanted if name == "coupling" else wanted - {"joints"}), name


@pytest.mark.parametrize("name", TERMS)
def test_the_parameters_in_the_table_of_terms(name: str):
    (row,) = [row for row in rows(STUDY, "| term | torque | parameters | options |") if row[0] == f"`{name}`"]
    stated = {re.sub(r"\d+$", "", symbol) for symbol in re.findall(r"(\w+?)_i", row[2])}
    robot = small_model().robot
    extra = {"coupling": {"joints": {robot.joint_names[0]: 1.0, robot.joint_names[1]: -1.0}}}
    extra["ripple"] = {"motor_harmonics": (1.0,), "gear_ratio": 50.0}
    model = DynamicsModel(robot, (TERMS[name](**extra.get(name, {})),))
    real = {re.sub(r"\d+$", "", parameter.name.symbol) for parameter in model.parameters}
    assert stated <= real and (stated == real or name == "rigid-body")


def test_the_table_of_methods():
    table = {
        QUOTED.findall(row[0])[0]: row[2]
        for row in rows(STUDY, "| method | objective | options, with their defaults |")
    }
    assert set(table) == set(ESTIMATORS)
    for name, method in ESTIMATORS.items():
        defaults = {field.name: field.default for field in dataclasses.fields(method)}
        stated = {key: value for key, value in re.findall(r"`(\w+)(?: = ([^`]+))?`", table[name])}
        if "see below" not in table[name]:
            assert stated.keys() == defaults.keys(), name
        for key, value in stated.items():
            assert not value or tomllib.loads(f"x = {value}")["x"] == defaults[key], (name, key)


def test_options_of_methods_that_stand_below_the_table():
    (block,) = re.findall(r"\[estimation\.physical\]\n(.*?)```", STUDY, re.DOTALL)
    assert set(tomllib.loads(block)) == fields_of(ESTIMATORS["physical"])
    paragraph = STUDY.split("`thesis-nlp` has its bounds as options")[1].split("\n\n")[0]
    stated = {key: value for key, value in re.findall(r"`(\w+) = ([^`]+)`", paragraph)}
    defaults = {field.name: field.default for field in dataclasses.fields(ESTIMATORS["thesis-nlp"])}
    assert stated.keys() == defaults.keys()
    for key, value in stated.items():
        assert str(tomllib.loads(f"x = {value}")["x"]) == str(_listed(defaults[key])), key


def _listed(value: object) -> object:
    """Tuples as the lists that TOML has."""
    return [_listed(each) for each in value] if isinstance(value, tuple) else value


# docs/doctor.md --------------------------------------------------------------------------------------------------


def test_the_table_of_codes():
    codes = [
        code for row in rows(DOCTOR, "| code | what is checked | visible where |") for code in QUOTED.findall(row[0])
    ]
    assert len(codes) == len(set(codes)) and set(codes) == set(effects())


# docs/code.md ----------------------------------------------------------------------------------------------------


def test_the_table_of_functions():
    functions = [name for row in rows(CODE, "| function | gives |") for name in QUOTED.findall(row[0])]
    assert sorted(functions) == sorted(PROGRAMS)


def test_the_tables_of_languages():
    names = [QUOTED.findall(row[0])[0] for row in rows(CODE, "| `--to` | files | notes |")]
    tested = [row[0].lower().replace("++", "pp") for row in rows(CODE, "| language | tested by |")]
    assert names == list(LANGUAGES) and tested == list(LANGUAGES)
    assert f"also {', '.join(list(LANGUAGES)[1:])}" in CODE


def test_limits_of_input_are_listed():
    page = (DOCS / "input.md").read_text(encoding="utf-8")
    listed = {row[0].strip("`"): row[1] for row in rows(page, "| limit | most | counts |")}
    words = {"million": 1e6}
    values = {name: float(most.split()[0]) * words.get(most.split()[-1], 1.0) for name, most in listed.items()}
    assert values == {name: each.most for name, each in LIMITS.items()}
