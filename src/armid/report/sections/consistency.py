"""Section of physical consistency: nearest consistent parameters, and mass matrix in the worst pose."""

from __future__ import annotations

import numpy as np

from armid.report.data.joint_names import label_of
from armid.report.data.number_format import decimals_of, fixed, share, short
from armid.report.data.page_data import PageData
from armid.report.data.trust import outside_intervals
from armid.report.section import Section, one_of
from armid.report.tables import Column, Table, TableCell

MAX_BLAMED = 10
"""Largest number of parameters in the table of changes; further parameters hardly change."""


def show_consistency(page_data: PageData) -> Section | None:
    """Section of the certificate of a run; `None` if the model has no rigid bodies."""
    if page_data.verdict is None:
        return None
    verdict, certificate = page_data.verdict, page_data.verdict.certificate
    content = {
        "feasible": certificate.feasible,
        "distance": short(certificate.distance),
        "relative": share(certificate.relative_distance),
        "beyond": outside_intervals(page_data),
        "mass": short(float(certificate.masses.sum())),
        "eigenvalue": short(verdict.pose.min_eigenvalue),
        "unit": verdict.pose.unit,
        "positive": verdict.pose.min_eigenvalue > 0.0,
        "heaviest": f"{verdict.heaviest:.3g}",
        "limited": short(verdict.limited.distance),
        "gap": short(certificate.gap, 2),
    }
    tables = (_bodies(page_data), *(() if certificate.feasible else (_blame(page_data),)))
    return Section("Physical consistency", content, tables)


def _bodies(page_data: PageData) -> Table:
    verdict, robot = page_data.verdict, page_data.run.robot
    assert verdict is not None
    unit = one_of([joint.unit for joint in robot.joints])
    rows: list[list[TableCell]] = []
    for j in range(robot.n):
        inertial = robot.links[j].inertial
        masses = (float(verdict.certificate.masses[j]), float(verdict.limited.masses[j]))
        rows.append(
            [
                TableCell(label_of(robot.joints, j), kind="name"),
                TableCell("–", "") if inertial is None else TableCell(short(inertial.mass), inertial.mass),
                *(TableCell(short(x), x) for x in masses),
                TableCell(fixed(float(verdict.pose.q[j]), 3), float(verdict.pose.q[j])),
            ]
        )
    columns = (
        Column("joint", words=True),
        Column("mass, CAD/URDF", "kg"),
        Column("mass, nearest consistent", "kg"),
        Column(f"mass, none above {verdict.heaviest:.3g}", "kg"),
        Column("worst pose", unit),
    )
    note = (
        "Base parameters do not determine masses; these are one of many possible choices. Worst pose: pose within "
        "the joint limits at which the mass matrix with rotors has its smallest eigenvalue."
    )
    return Table("bodies", "Nearest consistent masses, and the worst pose", columns, rows, note, folded=True)


def _blame(page_data: PageData) -> Table:
    assert page_data.verdict is not None
    fit = page_data.run.estimate.fit
    names: list[str] = [name.of_all for name in fit.names]
    half = dict(zip(names, 0.5 * np.ptp(fit.intervals, axis=1), strict=True))
    value = dict(zip(names, fit.values, strict=True))
    rows: list[list[TableCell]] = []
    for each in page_data.verdict.certificate.blame[:MAX_BLAMED]:
        width = float(half[each.name])
        decimals = decimals_of(max(abs(each.change), 1e-9))
        times = abs(each.change) / width if width > 0.0 else np.inf
        rows.append(
            [
                TableCell(each.name, kind="name"),
                TableCell(fixed(float(value[each.name]), decimals), float(value[each.name])),
                TableCell(fixed(each.change, decimals), each.change),
                TableCell(fixed(times, 2) + (" ▲" if times > 1.0 else ""), times, kind="poor" if times > 1.0 else ""),
            ]
        )
    columns = (
        Column("parameter", words=True),
        Column("value"),
        Column("change to the nearest consistent value"),
        Column("change / half interval"),
    )
    note = "▲ marks changes beyond the 95 % interval, which noise alone does not explain."
    return Table("blame", "Changes that make the values physically consistent", columns, rows, note, folded=True)
