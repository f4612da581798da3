"""Every section of a report shows a run, and leaves itself out or says what is missing where data are gone."""

from __future__ import annotations

from pathlib import Path

import pytest

from armid.report.comparison import COMPARISON
from armid.report.data.page_data import PageData, gather, stored
from armid.report.monitor_page import MONITOR
from armid.report.page import assemble
from armid.report.preflight_page import PREFLIGHT
from armid.report.rollout_page import ROLLOUT
from armid.report.section import Section
from armid.report.sections import SECTIONS
from armid.report.servos.page import SERVO
from reports import Page, make_run

pytest.importorskip("plotly")
pytest.importorskip("jinja2")

TEMPLATES = Path(__file__).parents[2] / "src" / "armid" / "report" / "templates"
SHARED = {"page", "macros", "chapter"}
OWN_PAGES = {"fleet"}
"""Templates of pages that consist of one section."""


@pytest.fixture(scope="module")
def materials(tmp_path_factory: pytest.TempPathFactory) -> dict[str, PageData]:
    """A run with its recordings, and the same run when they are gone."""
    folder = tmp_path_factory.mktemp("report")
    run = make_run(folder)
    return {"whole": gather(run), "records only": stored(run)}


section = pytest.mark.parametrize("name", SECTIONS)


def test_every_template_belongs_to_a_section():
    named = {path.stem for path in TEMPLATES.glob("*.html")}
    assert named == SHARED | OWN_PAGES | set(SECTIONS) | set(COMPARISON) | set(PREFLIGHT) | set(ROLLOUT) | set(
        MONITOR
    ) | set(SERVO)


@section
@pytest.mark.parametrize("which", ["whole", "records only"])
def test_a_section_renders(name: str, which: str, materials: dict[str, PageData]):
    found = SECTIONS[name](materials[which])
    if found is None:
        return
    page = Page(assemble("arm", "", {name: found}, with_plots=False))
    assert found.title in page.prose and name in page.identities
    assert {table.key for table in found.tables} == set(page.data["tables"])
    for table in found.tables:
        assert table.caption in page.prose
        assert all(len(row) == len(table.columns) for row in table.rows)
    for _, plots in found.plots:
        for plot in plots:
            assert f"plot-{plot.key}" in page.identities and plot.traces and plot.caption


def test_sections_with_nothing_to_show_leave_themselves_out(materials: dict[str, PageData]):
    left_out = {name for name, show in SECTIONS.items() if show(materials["records only"]) is None}
    assert {"residuals", "consistency"} <= left_out
    assert not {"verdict", "torque", "friction", "parameters", "provenance"} & left_out
    assert {"standard-parameters", "method-comparison"} <= left_out  # base parameters alone, no comparison


def test_keys_are_unique_over_the_page(materials: dict[str, PageData]):
    shown: list[Section] = [found for show in SECTIONS.values() if (found := show(materials["whole"])) is not None]
    keys = [plot.key for each in shown for _, plots in each.plots for plot in plots]
    keys += [table.key for each in shown for table in each.tables]
    assert len(keys) == len(set(keys)) and len(keys) > 20
