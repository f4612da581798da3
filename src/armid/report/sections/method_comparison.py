"""Section of the comparison of all estimation methods on the data of a run, made by `identify --compare`."""

from __future__ import annotations

import numpy as np

from armid.checked_array import Array
from armid.estimation.estimate_record import averaged, collapse
from armid.estimation.link_properties import QUANTITIES, UNITS
from armid.report.data.joint_names import groups_of
from armid.report.data.number_format import decimals_of, fixed, share, short
from armid.report.data.page_data import PageData
from armid.report.plots.plot_specification import Axes, Plot, PlotRange, points
from armid.report.section import Section, effort_unit
from armid.report.tables import Column, Table, TableCell
from armid.study.compare_methods import MethodScore, MethodTable

LEGEND = (("training", "value of the method minus value of this run"), ("above", "outside the plot"))


def show_methods(page_data: PageData) -> Section | None:
    """Section of the comparison of estimation methods; `None` if the run has no comparison."""
    table_of_methods = page_data.records.methods
    if table_of_methods is None:
        return None
    unit = effort_unit(page_data)
    columns = (
        Column("method", words=True),
        Column("training RMS", unit),
        Column("held-out RMS", unit),
        Column("physically consistent", words=True),
        Column("distance"),
        Column("set to zero"),
        Column("time", "s"),
        Column("", words=True),
    )
    rows = [_row(each, page_data.run.estimate.method) for each in table_of_methods.scores]
    note = (
        "RMS over all joints, root of the sum of squares. Distance: to the nearest consistent parameters, Euclidean, "
        "SI units."
    )
    table = Table("methods", "All methods on the same data", columns, rows, note)
    tables = (table, *_values(page_data, table_of_methods))
    content = {"unseen": table_of_methods.unseen}
    return Section("Methods compared", content, tables, _plots(page_data, table_of_methods), LEGEND)


def _values(page_data: PageData, methods: MethodTable) -> list[Table]:
    """Table of the base parameters by each method, and for each method that estimates links a table of the bodies."""
    if not methods.estimates:
        return []
    order, groups = groups_of(methods.names, page_data.joints)
    half = _half(page_data, methods)
    rows = [
        [
            TableCell(methods.names[k], kind="name"),
            *(
                TableCell(fixed(each.base[k], decimals_of(half[k])) if half[k] > 0.0 else short(each.base[k]),
                          float(each.base[k]))
                for each in methods.estimates
            ),
        ]
        for k in order
    ]  # fmt: skip
    columns = (Column("parameter", words=True), *(Column(each.method) for each in methods.estimates))
    note = (
        "SI units. Parameters with a value for each recording, such as offsets, are averaged. Intervals are computed "
        "for the method of the run alone."
    )
    base = Table("method-values", "Base parameters by each method", columns, rows, note, folded=True, groups=groups)
    links = [_bodies(page_data, each.method, each.bodies) for each in methods.estimates if each.bodies is not None]
    return [base, *links]


def _bodies(page_data: PageData, method: str, bodies: Array) -> Table:
    """Table of the links by one method, in the form of Table 4.2 of the thesis: a column for each link."""
    links = page_data.run.robot.links
    columns = (
        Column("", words=True),
        Column("unit", words=True),
        *(Column(f"{k + 1} · {link.name}") for k, link in enumerate(links)),
    )
    rows = [
        [
            TableCell(quantity, kind="name"),
            TableCell(UNITS[q]),
            *(TableCell(short(float(body[q])), float(body[q])) for body in bodies),
        ]
        for q, quantity in enumerate(QUANTITIES)
    ]
    note = (
        "Inertia about the centre of mass (com), in the axes of the link frame. Torques do not determine how the "
        "mass is distributed among the links: compare base parameters."
    )
    return Table(f"method-links-{method}", f"Links by {method}", columns, rows, note, folded=True)


def _plots(page_data: PageData, methods: MethodTable) -> tuple[tuple[str, tuple[Plot, ...]], ...]:
    """Plots of the differences between the base parameters of the methods and those of the run."""
    half, own = _half(page_data, methods), page_data.run.estimate
    others = [each for each in methods.estimates if each.method != own.method]
    if not others or not (half > 0.0).any():
        return ()
    values, number = collapse(methods.names, own.fit), np.arange(1.0, len(half) + 1.0)
    plots: list[Plot] = []
    for each in others:
        known = half > 0.0
        ratio = np.divide(each.base - values, half, out=np.full_like(values, np.nan), where=known)
        inside = float(np.mean(np.abs(ratio[known]) <= 1.0))
        shown = PlotRange.of(ratio[known])
        plots.append(
            Plot(
                f"method-{each.method}",
                each.method,
                f"{share(inside)} of the base parameters inside the 95 % intervals of {own.method}",
                "base parameter",
                "difference / half interval",
                (points("training", number, ratio, each.method), *shown.cut(number, ratio, each.method)),
                axes=Axes(levels=(-1.0, 0.0, 1.0), span=shown.span),
            )
        )
    return ((f"Differences from {own.method}, the method of this run", tuple(plots)),)


def _half(page_data: PageData, methods: MethodTable) -> Array:
    """Half width (b,) of the run's 95 % interval for each base parameter of the comparison; NaN if unknown."""
    estimate = page_data.run.estimate
    fit = averaged(estimate.base.names, estimate.fit)
    half = dict(zip(estimate.base.names, 0.5 * np.ptp(fit.intervals, axis=1), strict=True))
    return np.array([float(half.get(name, np.nan)) for name in methods.names])


def _row(score: MethodScore, method_of_run: str) -> list[TableCell]:
    consistent = {True: "yes", False: "no", None: "–"}[score.consistent]
    remark = score.failure or ("this run" if score.method == method_of_run else "")
    numbers = [float(np.linalg.norm(each)) for each in (score.training, score.unseen)]
    distance = np.nan if score.consistent else score.distance  # of consistent values it is the solver's tolerance
    return [
        TableCell(score.method, kind="name"),
        *(TableCell(short(x), x) for x in numbers),
        TableCell(consistent),
        TableCell(short(distance), distance),
        TableCell(str(score.dropped), score.dropped),
        TableCell(short(score.seconds, 2), score.seconds),
        TableCell(remark),
    ]
