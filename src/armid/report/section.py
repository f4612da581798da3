"""Section of a page: plain data for the template of the same name."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from armid.report.data.number_format import share, short
from armid.report.data.page_data import PageData
from armid.report.plots.plot_specification import Plot, PlotRange
from armid.report.tables import Table


@dataclass(frozen=True, eq=False, slots=True)
class Section:
    """Section of a page.

    Attributes:
        title: Heading of the section.
        content: Values for its template, by name.
        tables: Tables of the section.
        plots: Plots of the section, row by row: the heading of the row and its plots.
        legend: Roles of the lines and points in the plots, each with its description.
        template: Name of its template; if empty, the name of the section on the page.
    """

    title: str
    content: Mapping[str, Any] = field(default_factory=dict[str, Any])
    tables: tuple[Table, ...] = ()
    plots: tuple[tuple[str, tuple[Plot, ...]], ...] = ()
    legend: tuple[tuple[str, str], ...] = ()
    template: str = ""


def effort_unit(page_data: PageData) -> str:
    """Unit of the joints' torques and forces, for a column title."""
    return one_of([joint.effort_unit for joint in page_data.joints])


def one_of(units: list[str]) -> str:
    """Units as text, without repetition: `N·m`, or `N·m or N` for an arm that also has prismatic joints."""
    return " or ".join(dict.fromkeys(units))


def clipped_caption(plot_range: PlotRange, unit: str) -> str:
    """Caption about the rows outside the range of a plot; empty if all rows are inside the range."""
    if plot_range.span is None:
        return ""
    return f"▲ ▼ {share(plot_range.share)} of the rows are outside the plot, up to {short(plot_range.peak)} {unit}"
