"""Mass, centre of mass and inertia about it of each link, as described and as identified."""

from __future__ import annotations

import numpy as np

from armid.estimation.link_properties import QUANTITIES, UNITS, LinkProperties, LinkTable, link_table
from armid.report.data.number_format import decimals_of, fixed, short
from armid.report.data.page_data import PageData
from armid.report.section import Section
from armid.report.tables import Column, Table, TableCell
from armid.values import Array

__all__ = ["show_bodies"]

ORDER = (0, 1, 2, 3, 4, 6, 9, 5, 7, 8)
"""Quantities in the order of the columns: the moments of inertia before the products."""

GUESSED = "guessed"
"""How values look that the data do not determine."""


ROUNDING = 1e-12
"""Coordinates [m] and moments [kg·m²] below it are what is left of differences."""


def show_bodies(material: PageData) -> Section | None:
    """The bodies of the links; nothing where neither the description nor the estimate has any."""
    found = link_table(material.run.model, material.run.estimate)
    if not any(np.isfinite([body.description, body.estimate]).any() for body in found.links):
        return None
    return Section("Links", {"note": found.note}, (_table(found),))


def _table(found: LinkTable) -> Table:
    columns = (
        Column("link", words=True),
        Column("", words=True),
        *(Column(QUANTITIES[k], UNITS[k]) for k in ORDER),
    )
    rows: list[list[TableCell]] = []
    for j, body in enumerate(found.links):
        label = f"{j + 1} · {body.link}"
        for source, cells in _values(body):
            first = source == "CAD/URDF" or not np.isfinite(body.description).any()
            rows.append([TableCell(label if first else "", label, kind="name"), TableCell(source), *cells])
    estimated = any(np.isfinite(body.estimate).any() for body in found.links)
    note = (
        "By the number of the joint that moves the link. Centre of mass (com) and inertia about it with the axes of "
        "the link's frame; bodies on fixed and locked joints count to the link that carries them."
    )
    if estimated:
        note += (
            " ± half of the 95 % interval, where the data determine a value; others, in grey, are one choice of many."
        )
    title = "Mass, centre of mass and inertia about it of each link"
    return Table("bodies-of-links", title, columns, rows, note)


def _values(body: LinkProperties) -> list[tuple[str, list[TableCell]]]:
    """Return what a link's row or two rows say, by their source."""
    found: list[tuple[str, list[TableCell]]] = []
    if np.isfinite(body.description).any():
        found.append(("CAD/URDF", [_plain(float(body.description[k])) for k in ORDER]))
    if np.isfinite(body.estimate).any():
        found.append(("identified", [_estimated(float(body.estimate[k]), body.intervals[k]) for k in ORDER]))
    return found


def _plain(value: float, kind: str = "") -> TableCell:
    value = 0.0 if abs(value) < ROUNDING else value
    return TableCell(short(value), value if np.isfinite(value) else "", kind=kind)


def _estimated(value: float, ends: Array) -> TableCell:
    """A value with half its interval, or the value alone where nothing is known of it."""
    if not np.isfinite(ends).all():
        return _plain(value, GUESSED)
    half = 0.5 * float(np.ptp(ends))
    decimals = decimals_of(half)
    return TableCell(f"{fixed(value, decimals)} ± {fixed(half, decimals)}", value)
