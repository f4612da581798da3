"""A page: every section that has something to say, in one file that opens without a network.

plotly.js is 4.8 MB, and its Python package has no smaller build of it. It goes into the page once and compressed,
a third of its size; the page's script unpacks it. Plots are four-byte numbers, thinned to what a screen shows.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

from armid.report.comparison import COMPARISON, pair_of
from armid.report.data.page_data import PageData, gather, records_of
from armid.report.heading import Heading, heading_of_run
from armid.report.plots.encoding import compressed, embedded
from armid.report.plots.style import plot_record
from armid.report.rendering import environment, require_extra, text_of
from armid.report.section import Section
from armid.report.sections import SECTIONS
from armid.runs.run import Run
from armid.study.processed import ProcessedRecording
from armid.values import replace_file

__all__ = ["assemble", "render", "write_comparison", "write_page", "write_report"]


def write_report(
    run: Run,
    path: Path | str,
    *,
    recordings: Sequence[ProcessedRecording] | None = None,
    data: Path | str | None = None,
) -> Path:
    """Write a run's page.

    Args:
        run: The run.
        path: The file; written whole or not at all.
        recordings: What the run was made from, where it is at hand and need not be read and processed again.
        data: Folder in which recordings are looked for first.

    Raises:
        MissingExtraError: jinja2 or plotly is not installed.
        ArmidError: A record of the run is damaged, or the file cannot be written.
    """
    require_extra()
    return write_page(gather(run, recordings=recordings, data=data), path)


def write_page(material: PageData, path: Path | str) -> Path:
    """Write the page of a run whose records and recordings have been gathered.

    Raises:
        ArmidError: The file cannot be written.
    """
    return replace_file(path, render(material))


def write_comparison(before: Run, after: Run, path: Path | str) -> Path:
    """Write a page about what changed from one run to another.

    Args:
        before: The earlier run.
        after: The later one.
        path: The file; written whole or not at all.

    Raises:
        MissingExtraError: jinja2 or plotly is not installed.
        ArmidError: The runs are of different arms, or a record is damaged.
    """
    require_extra()
    pair = pair_of(records_of(before), records_of(after))
    shown = {name: show(pair) for name, show in COMPARISON.items()}
    title = f"{after.estimate.robot}: what changed"
    return replace_file(path, assemble(title, f"from {before.folder} to {after.folder}", shown, with_plots=False))


def render(material: PageData) -> str:
    """The page of a run as HTML."""
    shown = {name: section for name, show in SECTIONS.items() if (section := show(material)) is not None}
    estimate = material.run.estimate
    subtitle = (
        f"{len(estimate.fit.names)} base parameters of {len(material.joints)} joints, "
        f"{estimate.method}, {int(estimate.fit.rows.max())} rows"
    )
    drawn = any(section.plots for section in shown.values())
    return assemble(
        f"{estimate.robot}: dynamic model", subtitle, shown, with_plots=drawn, heading=heading_of_run(material)
    )


def assemble(
    title: str,
    subtitle: str,
    sections: Mapping[str, Section],
    *,
    with_plots: bool,
    heading: Heading | None = None,
) -> str:
    """HTML of sections, each through the template of its name.

    Args:
        title: Heading of the page.
        subtitle: A line below it.
        sections: Sections by name, in order.
        with_plots: Whether plotly.js is needed.
        heading: What stands beside the title.
    """
    return (
        environment()
        .get_template("page.html")
        .render(
            title=title,
            subtitle=subtitle,
            heading=heading or Heading(),
            sections=sections,
            version=version("armid"),
            style=text_of("theme.css") + text_of("page.css"),
            script=text_of("unpack.js") + text_of("page.js"),
            data=embedded(_data(sections.values())),
            plotly=_plotly() if with_plots else "",
        )
    )


def _data(sections: Iterable[Section]) -> dict[str, Any]:
    """Return what the page's script needs: plots and copies of the tables."""
    sections = list(sections)
    plots = {plot.key: plot_record(plot) for section in sections for _, row in section.plots for plot in row}
    tables = {t.key: {"csv": t.csv(), "latex": t.latex()} for section in sections for t in section.tables}
    return {"plots": plots, "tables": tables}


def _plotly() -> str:
    """plotly.js, compressed, in base 64; the same bytes each time."""
    from plotly.offline import get_plotlyjs

    return compressed(get_plotlyjs())
