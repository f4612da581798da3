"""Section of mass, centre of mass and inertia of each link, described and identified."""

from __future__ import annotations

import numpy as np

from armid.checked_array import Array
from armid.estimation.link_properties import QUANTITIES, UNITS, LinkProperties, LinkTable, link_table
from armid.report.data.number_format import decimals_of, fixed, short
from armid.report.data.page_data import PageData
from armid.report.section import Section
from armid.report.tables import Column, Table, TableCell

ORDER = (0, 1, 2, 3, 4, 6, 9, 5, 7, 8)
"""Indices of the quantities of a link in the order of the columns: moments of inertia before products of inertia."""

GUESSED = "guessed"
"""Style of the cells of values that the data do not determine."""


ROUNDING = 1e-12
"""Limit below which coordinates [m] and moments [kg·m²] are rounding errors."""


def show_link_properties(page_data: PageData) -> Section | None:
    """Section of the inertias of the links; `None` if neither the description nor the estimate has inertias."""
    links = link_table(page_data.run.model, page_data.run.estimate)
    if not any(np.isfinite([body.description, body.estimate]).any() for body in links.links):
        return None
    return Section("Links", {"note": links.note}, (_table(links),))


def _table(links: LinkTable) -> Table:
    columns = (
        Column("link", words=True),
        Column("", words=True),
        *(Column(QUANTITIES[k], UNITS[k]) for k in ORDER),
    )
    rows: list[list[TableCell]] = []
    for j, body in enumerate(links.links):
        label = f"{j + 1} · {body.link}"
        for source, cells in _values(body):
            first = source == "CAD/URDF" or not np.isfinite(body.description).any()
            rows.append([TableCell(label if first else "", label, kind="name"), TableCell(source), *cells])
    estimated = any(np.isfinite(body.estimate).any() for body in links.links)
    note = (
        "Links are numbered by the joint that moves them. Centre of mass (com), and inertia about it, along "
        "the axes of the link frame. Bodies on fixed and locked joints are included in the link to which "
        "they are attached."
    )
    if estimated:
        note += " ± half of the 95 % interval, if the data determine a value; grey values are one of many choices."
    title = "Mass, centre of mass and inertia about it of each link"
    return Table("bodies-of-links", title, columns, rows, note)


def _values(body: LinkProperties) -> list[tuple[str, list[TableCell]]]:
    """Rows of a link in the table: source of the values (description or estimate), and cells of the values."""
    links: list[tuple[str, list[TableCell]]] = []
    if np.isfinite(body.description).any():
        links.append(("CAD/URDF", [_plain(float(body.description[k])) for k in ORDER]))
    if np.isfinite(body.estimate).any():
        links.append(("identified", [_estimated(float(body.estimate[k]), body.intervals[k]) for k in ORDER]))
    return links


def _plain(value: float, kind: str = "") -> TableCell:
    value = 0.0 if abs(value) < ROUNDING else value
    return TableCell(short(value), value if np.isfinite(value) else "", kind=kind)


def _estimated(value: float, ends: Array) -> TableCell:
    """Cell of a value with the half width of its interval, or of the value alone if it has no interval."""
    if not np.isfinite(ends).all():
        return _plain(value, GUESSED)
    half = 0.5 * float(np.ptp(ends))
    decimals = decimals_of(half)
    return TableCell(f"{fixed(value, decimals)} ± {fixed(half, decimals)}", value)
