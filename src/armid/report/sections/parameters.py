"""Section of the base parameters with intervals, values of the description and groupings."""

from __future__ import annotations

import numpy as np

from armid.estimation.fit_result import POORLY_IDENTIFIED
from armid.maths.median import median
from armid.model.base_formulas import base_sums, parameter_latex
from armid.report.data.joint_names import groups_of, label_of
from armid.report.data.number_format import decimals_of, fixed, percent
from armid.report.data.page_data import PageData
from armid.report.data.residual_dependence import depends_on_velocity
from armid.report.section import Section
from armid.report.tables import Column, Table, TableCell


def show_parameters(page_data: PageData) -> Section:
    """Section of all base parameters of a run, joint by joint."""
    fit = page_data.run.estimate.fit
    content = {
        "covariance": fit.covariance_kind,
        "why": fit.report.why,
        "freedom": f"{float(median(fit.freedom)):.0f}",
        "count": len(fit.names),
        "kinds": _kinds(page_data),
        "contradicting": ", ".join(_with_other_friction(page_data)),
    }
    return Section("Parameters", content, (_table(page_data),))


def _with_other_friction(page_data: PageData) -> list[str]:
    """Labels of the joints whose residual depends on the velocity in both halves of the training motion."""
    train = page_data.of_role("train")
    return [label_of(page_data.joints, j) for j in range(len(page_data.joints)) if depends_on_velocity(train, j)]


def _kinds(page_data: PageData) -> str:
    """Text with the numbers of inertial parameters, rotor inertias and friction parameters."""
    model, base = page_data.run.model, page_data.run.estimate.base
    which = [base.names.index(name.of_all) for name in page_data.run.estimate.fit.names]
    inertial = np.isin(base.kept, model.inertial_columns)[which]
    rotor = np.array([model.parameters[k].symbol == "IA" for k in base.kept])[which]
    counts = (
        (int(inertial.sum()), "inertial"),
        (int((rotor & ~inertial).sum()), "rotor inertia"),
        (int((~rotor & ~inertial).sum()), "friction"),
    )
    return " + ".join(f"{count} {what}" for count, what in counts if count)


def _table(page_data: PageData) -> Table:
    estimate = page_data.run.estimate
    fit, base = estimate.fit, estimate.base
    number = {name: k for k, name in enumerate(base.names)}
    text, latex = base_sums(base), base_sums(base, "latex")
    nominal = page_data.run.model.nominal_parameters()
    prior = None if nominal is None else base.values_of(nominal)
    inertial = np.isin(base.kept, page_data.run.model.inertial_columns)
    columns = (
        Column("parameter", words=True),
        Column("value"),
        Column("unit", words=True),
        Column("95 % from"),
        Column("to"),
        Column("σ", "%"),
        *((Column("CAD/URDF"),) if prior is not None else ()),
        Column("combination", words=True),
    )
    rows: list[list[TableCell]] = []
    order, groups = groups_of(fit.names, page_data.joints)
    for k in order:
        name, (low, high) = fit.names[k], estimate.intervals[k]
        which, decimals = number[name.of_all], decimals_of(0.5 * float(high - low))
        poor = bool(fit.poorly_identified[k])
        is_sum = text[which] != name.of_all  # a single parameter needs no formula
        relative = float(fit.relative_deviation[k])
        rows.append(
            [
                TableCell(name, latex=f"${parameter_latex(name)}$", kind="name"),
                *_values(decimals, float(fit.values[k])),
                TableCell(base.units[which]),
                *_values(decimals, float(low), float(high)),
                TableCell(percent(relative) + ("*" if poor else ""), relative),
                *(_prior(float(prior[which]), inertial[which], decimals) if prior is not None else ()),
                TableCell(
                    text[which].replace("-", "−") if is_sum else "",
                    text[which],
                    f"${latex[which]}$" if is_sum else " ",
                    "formula",
                ),
            ]
        )
    note = (
        f"σ: relative standard deviation. * Above {POORLY_IDENTIFIED:g} %: poorly identified, or near zero. "
        "CAD/URDF: the value of the description, if it has one; descriptions have no friction."
    )
    title = f"Base parameters of {estimate.robot}, joint by joint: {_kinds(page_data)}"
    return Table("parameters", title, columns, rows, note, folded=True, groups=groups)


def _values(decimals: int, *values: float) -> list[TableCell]:
    return [TableCell(fixed(value, decimals), value) for value in values]


def _prior(value: float, inertial: bool, decimals: int) -> list[TableCell]:
    """Cell with the value that the description gives; a dash for friction, offsets and rotor inertia."""
    if not inertial:
        return [TableCell("–", "")]
    return [TableCell(fixed(value, decimals), value)]
