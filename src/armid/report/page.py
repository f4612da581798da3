"""HTML page of a run or a comparison: all sections that are not empty, in one file that needs no network.

plotly.js has 4.8 MB, and its Python package contains no smaller build. It is stored once in the page, compressed to a
third of its size, and the script of the page unpacks it. Plots contain numbers of four bytes, and only as many
points as a screen can show.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from importlib.metadata import version
from pathlib import Path
from typing import Any

from armid.report.comparison import COMPARISON, pair_of
from armid.report.data.page_data import PageData, gather, stored
from armid.report.heading import Heading, heading_of_run
from armid.report.page_file import write_html
from armid.report.plots.encoding import embedded, packed_plotly, unpacked
from armid.report.plots.style import plot_record
from armid.report.rendering import environment, require_extra, security_policy, text_of
from armid.report.section import Section
from armid.report.sections import SECTIONS
from armid.runs.run import Run


def write_report(run: Run, path: Path | str, *, data: Path | str | None = None) -> Path:
    """Writes the page of a run.

    Args:
        run: The run.
        path: The file; it is written completely or not at all.
        data: Folder that is searched first for recordings.

    Raises:
        MissingExtraError: jinja2 or plotly is not installed.
        ArmidError: A record of the run is damaged, or the file cannot be written.
    """
    require_extra()
    return write_page(gather(run, data=data), path)


def write_page(page_data: PageData, path: Path | str) -> Path:
    """Writes the page of a run from its gathered records and recordings.

    Raises:
        ArmidError: The file cannot be written.
    """
    return write_html(path, render(page_data))


def write_comparison(before: Run, after: Run, path: Path | str) -> Path:
    """Writes a page about the changes from one run to another.

    Args:
        before: The earlier run.
        after: The later run.
        path: The file; it is written completely or not at all.

    Raises:
        MissingExtraError: jinja2 or plotly is not installed.
        ArmidError: The runs are of different arms, or a record is damaged.
    """
    require_extra()
    pair = pair_of(stored(before), stored(after))
    sections = {name: show(pair) for name, show in COMPARISON.items()}
    title = f"{after.estimate.robot}: changes"
    return write_html(path, assemble(title, f"from {before.folder} to {after.folder}", sections, with_plots=False))


def render(page_data: PageData) -> str:
    """HTML of the page of a run."""
    sections = {name: section for name, show in SECTIONS.items() if (section := show(page_data)) is not None}
    estimate = page_data.run.estimate
    subtitle = (
        f"{len(estimate.fit.names)} base parameters of {len(page_data.joints)} joints, "
        f"{estimate.method}, {int(estimate.fit.rows.max())} rows"
    )
    has_plots = any(section.plots for section in sections.values())
    return assemble(
        f"{estimate.robot}: dynamic model",
        subtitle,
        sections,
        with_plots=has_plots,
        heading=heading_of_run(page_data),
    )


def assemble(
    title: str,
    subtitle: str,
    sections: Mapping[str, Section],
    *,
    with_plots: bool,
    heading: Heading | None = None,
) -> str:
    """HTML of a page; each section is rendered with the template of its name.

    Args:
        title: Heading of the page.
        subtitle: Line below the heading.
        sections: Sections by name, in order.
        with_plots: True if plotly.js is needed.
        heading: Facts and picture next to the title.
    """
    script, plotly = text_of("unpack.js") + text_of("page.js"), packed_plotly() if with_plots else ""
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
            script=script,
            policy=security_policy(script, *([unpacked(plotly)] if plotly else [])),
            data=embedded(_data(sections.values())),
            plotly=plotly,
        )
    )


def _data(sections: Iterable[Section]) -> dict[str, Any]:
    """Data for the script of the page: all plots, and all tables as CSV and LaTeX."""
    sections = list(sections)
    plots = {plot.key: plot_record(plot) for section in sections for _, row in section.plots for plot in row}
    tables = {t.key: {"csv": t.csv(), "latex": t.latex()} for section in sections for t in section.tables}
    return {"plots": plots, "tables": tables}
