"""Page of a fleet: units, own parameters with intervals, shared parameters, and changes since an earlier fleet."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from armid.notebook_display import plural
from armid.report.data.number_format import short, with_half_width
from armid.report.page import assemble
from armid.report.page_file import write_html
from armid.report.plots.plot_specification import Plot, points
from armid.report.rendering import require_extra
from armid.report.section import Section
from armid.report.tables import Column, Table, TableCell
from armid.runs.fleet.fleet_change import UnitChange
from armid.study.fleet.fleet_table import FleetRow, fleet_rows
from armid.study.fleet.identify_fleet import FleetIdentification

MAX_OPEN = 40
"""Largest number of rows of a table that is not folded."""

HALF = 1.96
"""Half width of a 95 % interval, as a multiple of the standard deviation."""


def write_fleet_page(
    fleet: FleetIdentification, path: Path | str, *, changes: Sequence[UnitChange] | None = None, since: str = ""
) -> Path:
    """Writes the page of a fleet.

    Args:
        fleet: Result of an identification of a fleet.
        path: The file; it is written completely or not at all.
        changes: Changes since an earlier fleet; `None` if it is not compared.
        since: Folder of the earlier fleet.

    Raises:
        MissingExtraError: jinja2 or plotly is not installed.
        OutputError: The file is not an HTML page, or cannot be written.
    """
    require_extra()
    rows = fleet_rows(fleet)
    odd = {row.of for row in rows if row.odd} | {each.unit for each in fleet.estimate.odd_bodies}
    units = plural(len(fleet.results), "unit")
    subtitle = f"{units}, {len(odd)} odd; {len(fleet.estimate.own.names)} parameters and torque scales of each unit"
    tables = [_units(fleet, rows), _own(rows), _shared(fleet)]
    if changes is not None:
        tables.insert(1, _changes(changes, since))
    content = {"findings": [(each.severity, each.code, each.channel, each.evidence) for each in fleet.findings]}
    section = Section("Units", content, tuple(tables), _plots(fleet, rows), (("training", "parameter of a unit"),))
    return write_html(path, assemble(f"{fleet.robot.name}: fleet", subtitle, {"fleet": section}, with_plots=True))


def _units(fleet: FleetIdentification, rows: tuple[FleetRow, ...]) -> Table:
    """Table with one row for each unit."""
    columns = (
        Column("unit", words=True),
        Column("odd in", words=True),
        Column("most apart", words=True),
        Column("standard deviations"),
        Column("verdict", words=True),
    )
    cells: list[tuple[TableCell, ...]] = []
    for name, result in zip(fleet.estimate.units, fleet.results, strict=True):
        own = [row for row in rows if row.of == name]
        most = max(own, key=lambda row: abs(row.score) if np.isfinite(row.score) else -1.0)
        odd = list(dict.fromkeys(row.joint for row in own if row.odd))
        odd += ["bodies"] * any(each.unit == name for each in fleet.estimate.odd_bodies)
        verdict = result.validation.verdict
        cells.append(
            (
                TableCell(name, kind="name"),
                TableCell(", ".join(odd) or "–", kind="poor" if odd else ""),
                TableCell(most.parameter),
                TableCell(short(most.score, 2), most.score),
                TableCell(verdict, kind="poor" if verdict == "fail" else ""),
            )
        )
    note = "Most apart: the parameter that differs most from those of all other units."
    return Table("units", "Units", columns, cells, note)


def _own(rows: tuple[FleetRow, ...]) -> Table:
    """Table of all own parameters and torque scales with their intervals."""
    columns = (
        Column("unit", words=True),
        Column("joint", words=True),
        Column("parameter", words=True),
        Column("value ± 95 %"),
        Column("unit of value", words=True),
        Column("standard deviations from the others"),
    )
    cells = [
        (
            TableCell(row.of, kind="name"),
            TableCell(row.joint),
            TableCell(row.parameter, kind="name"),
            TableCell(with_half_width(row.value, row.half), row.value),
            TableCell(row.unit),
            TableCell(short(row.score, 2), row.score, kind="poor" if row.odd else ""),
        )
        for row in rows
    ]
    note = "Friction and offsets are in the torque scale of the fleet; the scale of a unit is its torque over that."
    return Table("own", "Parameters of each unit", columns, cells, note, folded=len(cells) > MAX_OPEN)


def _shared(fleet: FleetIdentification) -> Table:
    """Table of the shared parameters."""
    prior, own = fleet.estimate.prior, set(fleet.estimate.prior.own)
    deviation = np.sqrt(np.diag(prior.covariance))
    columns = (Column("parameter", words=True), Column("value ± 95 %"), Column("unit", words=True))
    cells = [
        (
            TableCell(name, kind="name"),
            TableCell(with_half_width(float(prior.mean[k]), HALF * float(deviation[k])), float(prior.mean[k])),
            TableCell(unit),
        )
        for k, (name, unit) in enumerate(zip(fleet.base.names, fleet.base.units, strict=True))
        if name not in own
    ]
    note = "From the merged factors of all units that are not odd in their bodies."
    return Table("shared", "Bodies of the fleet", columns, cells, note, folded=len(cells) > MAX_OPEN)


def _changes(changes: Sequence[UnitChange], since: str) -> Table:
    """Table of the parameters that have changed since an earlier fleet."""
    beyond = [each for each in changes if each.beyond]
    columns = (
        Column("unit", words=True),
        Column("parameter", words=True),
        Column("before"),
        Column("after"),
        Column("change ± 95 %"),
    )
    cells = [
        (
            TableCell(each.unit, kind="name"),
            TableCell(each.parameter, kind="name"),
            TableCell(short(each.before, 4), each.before),
            TableCell(short(each.after, 4), each.after),
            TableCell(with_half_width(each.change, each.half), each.change),
        )
        for each in beyond
    ]
    note = (
        f"{len(changes) - len(beyond)} of {plural(len(changes), 'parameter')} differ by no more than errors explain."
    )
    return Table("changes", f"Changed since {since}", columns, cells, note, folded=len(cells) > MAX_OPEN)


def _plots(fleet: FleetIdentification, rows: tuple[FleetRow, ...]) -> tuple[tuple[str, tuple[Plot, ...]], ...]:
    """For each joint, the scores of all units."""
    number = {name: u + 1.0 for u, name in enumerate(fleet.estimate.units)}
    result: list[tuple[str, tuple[Plot, ...]]] = []
    for j, joint in enumerate(fleet.robot.joint_names):
        own = [row for row in rows if row.joint == joint and np.isfinite(row.score)]
        if not own:
            continue
        at = np.array([number[row.of] for row in own])
        score = np.array([row.score for row in own])
        largest = f"largest {short(float(np.abs(score).max()), 2)} standard deviations"
        trace = points("training", at, score, "unit")
        title = "Difference from the other units"
        plot = Plot(f"fleet-{j}", title, largest, "unit, in the order of the table", "standard deviations", (trace,))
        result.append((joint, (plot,)))
    return tuple(result)
