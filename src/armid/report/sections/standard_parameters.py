"""Section of the standard parameters, for methods that estimate them, with the share that the data determine."""

from __future__ import annotations

import numpy as np

from armid.estimation.standard_parameter_resolution import StandardFit
from armid.report.data.joint_names import groups_of
from armid.report.data.number_format import decimals_of, fixed, share, short
from armid.report.data.page_data import PageData
from armid.report.section import Section
from armid.report.tables import Column, Table, TableCell

MARKS = {"identified": "", "prior-dominated": " ○", "not identifiable": " ×"}


def show_standard_parameters(page_data: PageData) -> Section | None:
    """Section of the standard parameters and their prior; `None` if only base parameters are estimated."""
    fit = page_data.run.estimate.fit.standard
    if fit is None:
        return None
    content = {
        "count": {status: fit.status.count(status) for status in MARKS},
        "prior": fit.prior.kind,
        "weight": short(fit.prior.weight),
        "how": fit.prior.how,
        "price": share(fit.proof.cost_increase),
        "eigenvalue": short(fit.proof.smallest_eigenvalue),
        "lowest": short(fit.proof.lowest),
        "gap": short(fit.proof.gap, 2),
    }
    return Section("Standard parameters", content, (_table(page_data, fit),))


def _table(page_data: PageData, fit: StandardFit) -> Table:
    model = page_data.run.model
    nominal = model.nominal_parameters()
    prior = {} if nominal is None else {p.name: float(x) for p, x in zip(model.parameters, nominal, strict=True)}
    inertial = {model.parameters[k].name for k in model.inertial_columns}
    columns = (
        Column("parameter", words=True),
        Column("value"),
        Column("unit", words=True),
        Column("95 % from"),
        Column("to"),
        Column("CAD/URDF"),
        Column("share of the data", "%"),
        Column("status", words=True),
    )
    rows: list[list[TableCell]] = []
    order, groups = groups_of(fit.names, page_data.joints)
    for k in order:
        name, known = fit.names[k], fit.status[k] != "not identifiable"
        value, (low, high) = float(fit.values[k]), (float(end) for end in fit.intervals[k])
        decimals = decimals_of(0.5 * (high - low))
        described = prior.get(name.of_all, np.nan) if name.of_all in inertial else np.nan
        share_of_data = 100.0 * float(fit.resolution[k])
        rows.append(
            [
                TableCell(name, kind="name"),
                TableCell(fixed(value, decimals), value),
                *(
                    TableCell(fixed(x, decimals), x) if known and np.isfinite(x) else TableCell("–", "")
                    for x in (low, high)
                ),
                TableCell(fixed(described, decimals), described if np.isfinite(described) else ""),
                TableCell(fixed(share_of_data, 0), share_of_data),
                TableCell(fit.status[k] + MARKS.get(fit.status[k], ""), fit.status[k]),
            ]
        )
        rows[-1].insert(2, TableCell(fit.units[k]))
    note = (
        "Parameters about the origin of the link frame. Share of the data: share of a value that the data "
        "determine; the prior determines the rest. ○: mostly from the prior; ×: almost no information in the "
        "data, so the value is one of many possible choices and has no interval."
    )
    return Table("links", "Standard parameters, joint by joint", columns, rows, note, folded=True, groups=groups)
