"""Values in a notebook: one well-formed table each, with what they hold, and nothing that a name could smuggle in."""

from __future__ import annotations

from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import pytest

from armid import find_base_parameters, identify, load_robot, load_study
from armid.shown import MOST_ROWS, Shown, Summary, html_of
from labs import small_model, write_recordings, write_study


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
def values(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Shown]:
    folder = tmp_path_factory.mktemp("small")
    write_recordings(folder)
    result = identify(load_study(write_study(folder)))
    model = small_model()
    return {
        "FV_2": result.estimate,
        "run2.csv, RMS": result.validation,
        "joint_3": model.robot,
        "ZZR_1": find_base_parameters(model),
    }


@pytest.mark.parametrize("holds", ["FV_2", "run2.csv, RMS", "joint_3", "ZZR_1"])
def test_a_value_shows_itself_as_a_table(holds: str, values: dict[str, Shown]):
    summary = values[holds].summary()
    assert all(len(row) == len(summary.columns) for row in summary.rows)
    page = Tags(values[holds]._repr_html_())
    assert page.open == [] and holds in page.cells


def test_names_are_text_and_nothing_else():
    robot = replace(load_robot("ur5e"), name="<script>alert(1)</script>")
    assert "<script" not in robot._repr_html_() and "&lt;script&gt;" in robot._repr_html_()


def test_long_tables_end_and_say_so():
    page = html_of(Summary("long", ("k",), tuple((str(k),) for k in range(MOST_ROWS + 3))))
    assert page.count("<tr>") == MOST_ROWS + 1 and "3 rows more" in page


def test_pages_do_not_promise_more(values: dict[str, Shown]):
    """The first page says that these two show themselves."""
    text = (Path(__file__).parents[2] / "docs" / "start.md").read_text(encoding="utf-8")
    assert "`run.estimate` and `run.validation` show themselves as tables" in text
    assert {"Estimate", "Validation"} <= {type(value).__name__ for value in values.values()}
