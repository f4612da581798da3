"""Section of a page: plain data for the template of the same name."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from armid.report.data.number_format import share, short
from armid.report.data.page_data import PageData
from armid.report.plots.traces import Plot, Sight
from armid.report.tables import Table

__all__ = ["Section", "cut_words", "effort_unit", "one_of"]


@dataclass(frozen=True, eq=False, slots=True)
class Section:
    """A section of a page.

    Attributes:
        title: Its heading.
        content: What its template asks for, by name.
        tables: Its tables.
        plots: Its plots, row by row: a heading for the row and its plots.
        legend: Roles of the traces, and what they are.
        template: The template that shows it; that of its name on the page where empty.
    """

    title: str
    content: Mapping[str, Any] = field(default_factory=dict[str, Any])
    tables: tuple[Table, ...] = ()
    plots: tuple[tuple[str, tuple[Plot, ...]], ...] = ()
    legend: tuple[tuple[str, str], ...] = ()
    template: str = ""


def effort_unit(material: PageData) -> str:
    """Unit of the joints' efforts for the head of a column."""
    return one_of([joint.effort_unit for joint in material.joints])


def one_of(units: list[str]) -> str:
    """The units in a list, each once: `N·m`, or `N·m or N` on an arm that also slides."""
    return " or ".join(dict.fromkeys(units))


def cut_words(sight: Sight, unit: str) -> str:
    """Return what a plot leaves out, for its caption; nothing where it shows all."""
    if sight.span is None:
        return ""
    return f"▲ ▼ {share(sight.share)} of the rows beyond the picture, up to {short(sight.peak)} {unit}"
