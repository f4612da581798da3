"""Values in a notebook: one well-formed table each, with what they hold, and nothing that a name could smuggle in."""

from __future__ import annotations

from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import pytest

from armid import find_base_parameters, identify, load_robot, load_run, load_study, save_run
from armid.excitation.design.objective import CriterionGoal
from armid.excitation.plan import Plan
from armid.notebook_display import (
    MOST_ROWS,
    Displayed,
    Summary,
    html_of,
    interval_text,
    names_apart,
    percent,
    plural,
    text_of,
)
from armid.runs.consistency_check import certify_run
from armid.study.plans.design import DesignConstraints, DesignGoal, SearchBudget, design_plan
from labs import small_model, small_plan, small_recording, write_recordings, write_study


class Tags(HTMLParser):
    """Opened and closed tags, and the text of cells."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.cells: list[str] = []
        self.feed(page)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        assert tag in {"table", "caption", "thead", "tbody", "tr", "th", "td", "p"}
        self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.cells.append(data)


@pytest.fixture(scope="module")
def values(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Displayed]:
    folder = tmp_path_factory.mktemp("small")
    write_recordings(folder)
    study = write_study(folder).read_text() + '[estimation]\nmethod = "physical"\n'
    (folder / "study.toml").write_text(study)
    result = identify(load_study(folder / "study.toml"))
    run = load_run(save_run(result, folder / "run"))
    model, motion = small_model(), small_plan(1)
    goal = CriterionGoal(model, find_base_parameters(model), rate=20.0)
    designed = design_plan(DesignGoal(goal, 6.0, 3), DesignConstraints(acceleration=5.0), SearchBudget(None, 1, 0, 1))
    assert result.estimate.fit.standard is not None
    return {
        "Estimate": result.estimate,
        "Fit": result.estimate.fit,
        "StandardFit": result.estimate.fit.standard,
        "Validation": result.validation,
        "Result": result,
        "Run": run,
        "LinkTable": run.links,
        "Robot": model.robot,
        "DynamicsModel": model,
        "BaseParameters": find_base_parameters(model),
        "Excitation": motion,
        "Plan": Plan(motion, 3),
        "Motion": motion.sample(50.0),
        "Recording": small_recording(1),
        "Verdict": certify_run(run),
        "Designed": designed,
        "Study": load_study(folder / "study.toml"),
        "Information": result.information,
    }


HOLDS = {
    "Estimate": "FV_2",
    "Fit": "FV_2",
    "StandardFit": "XX_1",
    "Validation": "run2.csv, RMS",
    "Result": "run2.csv, RMS",
    "Run": "physical",
    "LinkTable": "com x",
    "Robot": "joint_3",
    "DynamicsModel": "viscous",
    "BaseParameters": "ZZR_1",
    "Excitation": "dq",
    "Plan": "dq",
    "Motion": "ddq",
    "Recording": "effort",
    "Verdict": "masses of links with these parameters",
    "Designed": "velocity",
    "Study": "run2.csv",
    "Information": "rows",
}
"""A cell of each value's table."""


@pytest.mark.parametrize("kind", HOLDS)
def test_a_value_shows_itself_as_a_table(kind: str, values: dict[str, Displayed]):
    value = values[kind]
    assert type(value).__name__ == kind
    summary = value.summary()
    assert summary.rows and all(len(row) == len(summary.columns) for row in summary.rows)
    page = Tags(value._repr_html_())
    assert page.open == [] and HOLDS[kind] in page.cells


def test_every_value_that_shows_itself_is_looked_at():
    assert {kind.__name__ for kind in leaves(Displayed)} == set(HOLDS)


def leaves(kind: type) -> list[type]:
    """Classes of a kind of which nothing is derived."""
    return [leaf for each in kind.__subclasses__() for leaf in (leaves(each) or [each])]


@pytest.mark.parametrize("kind", HOLDS)
def test_a_prompt_shows_ten_lines_of_a_value(kind: str, values: dict[str, Displayed]):
    text = repr(values[kind])
    assert kind in text.splitlines()[0] and text.count("\n") < 10 and len(text) < 1500
    assert "array(" not in text and " 1 findings" not in text


def test_a_study_shows_what_it_says_beyond_the_defaults(tmp_path: Path):
    write_recordings(tmp_path)
    text = write_study(tmp_path).read_text().replace('role = "validate"', 'role = "validate"\nrate = 50.0')
    text += '[processing]\ncutoff = 3.0\nslow = 0.1\n[estimation]\nmethod = "ridge"\n'
    (tmp_path / "study.toml").write_text(text)
    rows = {row[0]: row[1:] for row in load_study(tmp_path / "study.toml").summary().rows}
    assert rows["arm"] == ("small.urdf", "") and rows["train"] == ("run1.csv", "")
    assert rows["validate"] == ("run2.csv", "rate = 50.0") and rows["method"] == ("ridge", "")
    assert rows["processing"] == ("cut-off 3.0 Hz", "slow = 0.1")


def test_one_of_a_kind_is_no_plural():
    assert [plural(count, "joint") for count in (0, 1, 2)] == ["0 joints", "1 joint", "2 joints"]
    assert "1 row more" in html_of(Summary("long", ("k",), tuple((str(k),) for k in range(MOST_ROWS + 1))))


def test_deviations_in_percent_have_no_powers_of_ten():
    assert [percent(x) for x in (0.0337, 5.12, 99.6, 512.3, 73210.0)] == [
        "0.034 %", "5.1 %", "100 %", "512 %", "73210 %",
    ]  # fmt: skip
    assert percent(float("inf")) == "inf %"


def test_long_cells_and_notes_of_one_line_fit_a_prompt():
    text = text_of("Kind", Summary("title", ("a", "b"), tuple((str(k), "x" * 90) for k in range(9)), "see\nthere"))
    assert text.splitlines()[0] == "<Kind title" and text.endswith("see there>")
    assert "… and 3 more" in text and max(map(len, text.splitlines())) < 40


def test_names_are_text_and_nothing_else():
    robot = replace(load_robot("ur5e"), name="<script>alert(1)</script>")
    assert "<script" not in robot._repr_html_() and "&lt;script&gt;" in robot._repr_html_()


def test_long_tables_end_and_say_so():
    page = html_of(Summary("long", ("k",), tuple((str(k),) for k in range(MOST_ROWS + 3))))
    assert page.count("<tr>") == MOST_ROWS + 1 and "3 rows more" in page


def test_pages_do_not_promise_more(values: dict[str, Displayed]):
    """Values that the first page names show themselves."""
    text = (Path(__file__).parents[2] / "docs" / "start.md").read_text(encoding="utf-8")
    assert "A notebook shows a run, its `run.estimate`, robots, models, plans and recordings as tables" in text
    named = {"Run", "Estimate", "Robot", "DynamicsModel", "Plan", "Recording"}
    assert named <= {type(value).__name__ for value in values.values()}


def test_files_of_one_name_are_told_apart_by_their_folders():
    assert names_apart(["a/run.csv", "b/run.csv", "b/other.csv"]) == {
        "a/run.csv": "a/run.csv",
        "b/run.csv": "b/run.csv",
        "b/other.csv": "other.csv",
    }
    assert names_apart(["/x/a/1/run.csv", "/x/b/1/run.csv", "run.csv", "run.csv"]) == {
        "/x/a/1/run.csv": "a/1/run.csv",
        "/x/b/1/run.csv": "b/1/run.csv",
        "run.csv": "run.csv",
    }


@pytest.mark.parametrize("middle", [0.0, 0.00801, -3.2, 1234.5, 2e-7])
@pytest.mark.parametrize("width", [1.0, 3e-3, 4.9e-5, 1e-9])
@pytest.mark.parametrize("form", [{"decimals": 4}, {"decimals": 1}, {"digits": 3}, {}])
def test_the_ends_of_an_interval_differ_by_about_its_width(middle: float, width: float, form: dict[str, int]):
    """Each end is off by half of its last digit at most, and that digit is no larger than the width."""
    low, high = map(float, interval_text(middle - width / 2, middle + width / 2, **form).split(" … "))
    assert 0.0 < high - low <= 2.01 * width and low <= middle + width / 2 and high >= middle - width / 2


def test_an_interval_without_width_or_ends():
    assert interval_text(0.5, 0.5, decimals=2) == "0.50 … 0.50" and interval_text(2.0, 2.0) == "2 … 2"
    assert interval_text(float("nan"), float("nan")) == "–"
    assert interval_text(0.0, float("inf"), decimals=1) == "0.0 … inf"
    assert interval_text(0.00798, 0.00803, decimals=4) == "0.00798 … 0.00803"
    assert interval_text(1.0, 3.0, decimals=2) == "1.00 … 3.00" and interval_text(1.0, 3.0) == "1 … 3"
