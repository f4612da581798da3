"""Each example of docs/extending.md is a member of its kind: with its file and its line it is used as any other."""

from __future__ import annotations

import ast
import importlib
import json
import re
import tomllib
from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from armid import DynamicsModel, find_base_parameters, identify, load_run, load_study, save_run
from armid.cli import main as cli
from armid.cli.folder_overview import next_step
from armid.codegen.generation import generate
from armid.export.write import export_run
from armid.lab.inverse_dynamics_recording import record
from armid.lazy_catalogue import Catalogue
from armid.measurement.readers import load_recording
from armid.measurement.recording import Recording
from armid.model.motion import Motion
from armid.model.terms import TERMS
from armid.study.config import parse_study
from labs import SENSORS, STUDY, small_model, small_plan, small_recording, small_truth, write_arm, write_recordings
from labs import write_recording as write_csv
from paged import DOCS

PAGE = (DOCS / "extending.md").read_text(encoding="utf-8")

EXAMPLE = re.compile(
    r"^## (?P<kind>[^\n]+)\n(?:(?!^## ).)*?```python\n# src/(?P<file>[\w/]+)\.py\n(?P<text>.*?)^```\n\n"
    r"```text\n# src/(?P<table>[\w/]+)\.py\n(?P<row>[^\n]+)\n```",
    re.M | re.S,
)
EXAMPLES = {found["kind"]: found for found in EXAMPLE.finditer(PAGE)}

Use = Callable[[str], Any]

SIGMAS = 5.0
"""Standard deviations that an estimate may be off by; of some thirty parameters one in a million goes beyond."""


@pytest.fixture
def use(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Use]:
    """Adds the example of a kind: its file to the folder of the kind, its line to the catalogue."""
    with _entered() as enter:

        def add(kind: str) -> None:
            example = EXAMPLES[kind]
            package, _, name = example["file"].replace("/", ".").rpartition(".")
            folder = tmp_path / "members" / package
            folder.mkdir(parents=True)
            (folder / f"{name}.py").write_text(example["text"], encoding="utf-8")
            home = importlib.import_module(package)
            monkeypatch.setattr(home, "__path__", [*home.__path__, str(folder)])
            monkeypatch.delitem(__import__("sys").modules, f"{package}.{name}", raising=False)
            table = importlib.import_module(example["table"].replace("/", "."))
            (catalogue,) = (each for each in vars(table).values() if isinstance(each, Catalogue))
            enter(catalogue.extended(eval(f"{{{example['row']}}}", vars(table))))

        yield add


@contextmanager
def _entered() -> Generator[Callable[[Any], None]]:
    from contextlib import ExitStack

    with ExitStack() as stack:
        yield stack.enter_context


def armid(*arguments: object) -> None:
    with pytest.raises(SystemExit) as ended:
        cli.main([str(each) for each in arguments])
    assert not ended.value.code, arguments


def test_every_kind_has_an_example_of_one_file_and_one_line():
    assert list(EXAMPLES) == [
        "A torque term",
        "A reader of recordings",
        "An estimator",
        "An exporter",
        "A check of the doctor",
        "A code language",
    ]
    for example in EXAMPLES.values():
        assert f"`src/{example['table']}.py`" in PAGE
        ast.parse(example["text"])


def quadratic_recordings() -> dict[str, Recording]:
    """The small arm with quadratic friction of 2 N·m·s²/rad² on each joint, which no other term has."""
    model = DynamicsModel(small_model().robot, (*small_model().terms, TERMS["quadratic"]()))
    known = dict(zip((p.name for p in small_model().parameters), small_truth(), strict=True))
    truth = np.array([known.get(parameter.name, 2.0) for parameter in model.parameters])
    rng = np.random.default_rng(5)
    return {f"run{k}.csv": record(model, truth, small_plan(k), SENSORS, rng, repetitions=2)[0] for k in (1, 2)}


@pytest.mark.parametrize("terms", [["rigid-body", "viscous", "coulomb", "quadratic"], "auto"])
def test_a_term(terms: Any, use: Use, tmp_path: Path):
    """By name it is estimated; `auto` selects it on every joint among all candidates, with the true value."""
    use("A torque term")
    write_arm(tmp_path)
    study = parse_study({**tomllib.loads(STUDY), "model": {"terms": terms}}, str(tmp_path))
    result = identify(study, given=quadratic_recordings())
    names = [str(name) for name in result.estimate.fit.names]
    found = [names.index(f"FQ_{joint}") for joint in (1, 2, 3)]
    values, deviations = result.estimate.fit.values[found], result.estimate.fit.deviation[found]
    assert (np.abs(values - 2.0) < SIGMAS * deviations).all() and (deviations < 0.2).all()


def test_a_reader(use: Use, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    use("A reader of recordings")
    monkeypatch.chdir(tmp_path)
    write_recordings(tmp_path)
    for k in (1, 2):
        names, *rows = np.genfromtxt(f"run{k}.csv", delimiter=",", dtype=str)
        lines = (json.dumps(dict(zip(names.tolist(), map(float, row), strict=True))) for row in rows)
        Path(f"run{k}.jsonl").write_text("\n".join(lines), encoding="utf-8")
    same, read = load_recording("run1.csv"), load_recording("run1.jsonl")
    assert read.q.tobytes() == same.q.tobytes() and read.joint_names == same.joint_names
    for path in tmp_path.glob("*.csv"):
        path.unlink()
    assert "small.urdf run1.jsonl" in next_step(tmp_path)
    armid("identify", "small.urdf", "run1.jsonl", "--validate", "run2.jsonl", "--out", "run", "--no-report")


def test_an_estimator(use: Use, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    use("An estimator")
    write_recordings(tmp_path)
    (tmp_path / "study.toml").write_text(f'{STUDY}[estimation]\nmethod = "relative"\nrelative = {{ floor = 0.1 }}\n')
    result = identify(load_study(tmp_path / "study.toml"))
    assert (
        result.estimate.method == "relative" and result.validation is not None and result.validation.verdict == "pass"
    )
    armid("identify", tmp_path / "study.toml", "--compare", "--out", tmp_path / "run", "--no-report")
    assert "relative" in capsys.readouterr().out


def test_an_exporter(use: Use, tmp_path: Path):
    use("An exporter")
    write_recordings(tmp_path)
    (tmp_path / "study.toml").write_text(f'{STUDY}[estimation]\nmethod = "physical"\n')
    save_run(identify(load_study(tmp_path / "study.toml")), tmp_path / "run")
    exported = export_run(load_run(tmp_path / "run"), "json", tmp_path / "arm.json")
    assert all(check.ok for check in exported.checks) and "torque on run2.csv" in {c.name for c in exported.checks}
    friction = [joint["friction"] for joint in json.loads((tmp_path / "arm.json").read_text())["joints"]]
    assert [set(each) for each in friction] == [{"viscous", "coulomb"}] * 3
    armid("export", tmp_path / "run", "--to", "json")
    assert (tmp_path / "run" / "small.json").is_file()


def test_a_check(use: Use, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    """It is told by `armid doctor` with its effect, and by `identify` for each recording."""
    use("A check of the doctor")
    write_recordings(tmp_path)
    coarse = small_recording(1)
    assert coarse.effort is not None
    write_csv(replace(coarse, effort=np.round(coarse.effort)), tmp_path / "run1.csv")
    (tmp_path / "study.toml").write_text(STUDY)
    armid("doctor", tmp_path / "study.toml", "--json")
    told = json.loads(capsys.readouterr().out)["findings"]
    found = [each for each in told if each["code"] == "torque-resolution"]
    assert found and {each["recording"] for each in found} == {"run1.csv"}
    assert all("values, 1 apart" in each["evidence"] and "noise" in each["effect"] for each in found)
    result = identify(load_study(tmp_path / "study.toml"))
    assert "torque-resolution" in {finding.code for finding in result.estimate.findings}


def test_a_language(use: Use):
    """The code gives the model's torque along a whole motion at once."""
    use("A code language")
    model, truth = small_model(), small_truth()
    base = find_base_parameters(model)
    (text,) = generate(model, base, base.values_of(truth), "numpy").values()
    names: dict[str, Any] = {}
    exec(text, names)
    q, dq, ddq = np.random.default_rng(2).uniform(-2.0, 2.0, (3, 50, 3))
    np.testing.assert_allclose(
        names["inverse_dynamics"](q, dq, ddq), model.torque(Motion.of_states(q, dq, ddq), truth), rtol=0, atol=1e-11
    )  # sums in another order, of torques of some tens of N·m
    assert names["mass_matrix"](q).shape == (50, 3, 3)
