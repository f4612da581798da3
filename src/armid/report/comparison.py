"""Comparison of two runs of an arm: changes beyond the intervals, and torque errors."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from armid.checked_array import Array
from armid.errors import ArmidError
from armid.estimation.estimate_record import averaged
from armid.estimation.update.parameter_change import ParameterChange, changed
from armid.model.base_formulas import base_formulas
from armid.model.parameter_name import ParameterName
from armid.report.data.joint_names import label_of
from armid.report.data.number_format import decimals_of, fixed, short
from armid.report.data.page_data import PageData
from armid.report.section import Section, effort_unit
from armid.report.tables import Column, Table, TableCell
from armid.runs.recalibration_record import recorded_changes

BY_CHANCE = 0.05
"""Expected share of unchanged parameters whose estimated change is larger than its 95 % interval by chance."""


@dataclass(frozen=True, eq=False, slots=True)
class Pair:
    """Page data of two runs of the same arm.

    Attributes:
        before: The earlier run.
        after: The later run.
    """

    before: PageData
    after: PageData


@dataclass(frozen=True, slots=True)
class RunChange:
    """Change of a parameter that has the same definition in both runs.

    Attributes:
        change: The change, with the half width of the 95 % interval of the change.
        unit: Unit of the parameter.
        before_half: Half width of the 95 % interval of the parameter in the earlier run.
        after_half: Half width of the 95 % interval of the parameter in the later run.
    """

    change: ParameterChange
    unit: str
    before_half: float
    after_half: float

    @property
    def name(self) -> str:
        """Name of the parameter."""
        return self.change.name

    @property
    def difference(self) -> float:
        """Value in the later run minus value in the earlier run."""
        return self.change.change

    @property
    def size(self) -> float:
        """Absolute change divided by the half width of its 95 % interval; noise does not explain a value above 1."""
        return self.change.size


def pair_of(before: PageData, after: PageData) -> Pair:
    """Pair of two runs, after a check that they can be compared.

    Raises:
        ArmidError: The runs are of arms with different joints, or have no common parameter.
    """
    names = [page_data.run.robot.joint_names for page_data in (before, after)]
    if names[0] != names[1]:
        raise ArmidError(
            f"The runs cannot be compared: {before.run.folder} has the joints {', '.join(names[0])}, but "
            f"{after.run.folder} has {', '.join(names[1])}.",
            remedy="compare two runs of the same arm.",
        )
    if not changes(pair := Pair(before, after)):
        raise ArmidError(
            f"The runs cannot be compared: {before.run.folder} and {after.run.folder} have no common parameter.",
            remedy="identify both with the same description, gravity and terms.",
        )
    return pair


def changes(pair: Pair) -> list[RunChange]:
    """Changes of the parameters that both runs have with the same grouping, largest first.

    If the later run was recalibrated from the earlier run, the changes are taken from the recalibration, whose
    intervals include the correlation of both runs. Otherwise the two estimates are treated as independent.
    """
    recorded = recorded_changes(pair.before.run, pair.after.run)
    result = _independent(pair) if recorded is None else _recorded(pair, recorded)
    return sorted(result, key=lambda change: -change.size)


def _recorded(pair: Pair, recorded: Iterable[ParameterChange]) -> list[RunChange]:
    """Changes that a recalibration has recorded, together with the intervals of the parameters in the two runs."""
    base = pair.after.run.estimate.base
    units: dict[str, str] = dict(zip(base.names, base.units, strict=True))
    halves: list[dict[str, float]] = []
    for each in _both(pair):
        intervals = averaged(each.run.estimate.base.names, each.run.estimate.fit).intervals
        halves.append(
            dict(zip(each.run.estimate.base.names, map(float, 0.5 * np.ptp(intervals, axis=1)), strict=True))
        )
    return [RunChange(each, units[each.name], *(half[each.name] for half in halves)) for each in recorded]


def _independent(pair: Pair) -> list[RunChange]:
    """Differences of two independent estimates; the interval of a difference follows from the two intervals."""
    formulas = [
        dict(zip(m.run.estimate.base.names, base_formulas(m.run.estimate.base), strict=True)) for m in _both(pair)
    ]
    result: list[RunChange] = []
    values = [_values(m) for m in _both(pair)]
    units = dict(zip(pair.before.run.estimate.base.names, pair.before.run.estimate.base.units, strict=True))
    for name, (before, before_half, before_deviation) in values[0].items():
        if name in values[1] and formulas[0][name.of_all] == formulas[1].get(name.of_all):
            after, after_half, after_deviation = values[1][name]
            deviation = float(np.hypot(before_deviation, after_deviation))
            half = float(np.hypot(before_half, after_half))
            change = ParameterChange(name, before, after, after - before, deviation, half)
            result.append(RunChange(change, units[name.of_all], before_half, after_half))
    return result


def _both(pair: Pair) -> tuple[PageData, PageData]:
    return pair.before, pair.after


def _values(page_data: PageData) -> dict[ParameterName, tuple[float, float, float]]:
    """Value, half width of the 95 % interval, and standard deviation of each parameter of a run."""
    fit = page_data.run.estimate.fit
    half = 0.5 * np.ptp(page_data.run.estimate.intervals, axis=1)
    numbers = zip(fit.names, fit.values, half, fit.deviation, strict=True)
    return {name: (float(x), float(h), float(d)) for name, x, h, d in numbers}


def _show_changes(pair: Pair) -> Section:
    all_changes = changes(pair)
    beyond = [each.name for each in changed(each.change for each in all_changes)]
    shared = {each.name for each in all_changes}
    recalibrated = recorded_changes(pair.before.run, pair.after.run) is not None
    content = {
        "beyond": beyond,
        "count": len(all_changes),
        "chance": round(BY_CHANCE * len(all_changes)),
        "only": [(page_data.run.folder, _only(page_data, shared)) for page_data in _both(pair)],
    }
    columns = (
        Column("parameter", words=True),
        Column("before"),
        Column("after"),
        Column("change"),
        Column("unit", words=True),
        Column("change / half interval"),
    )
    rows: list[list[TableCell]] = []
    for each in all_changes:
        decimals = decimals_of(min(each.before_half, each.after_half) or abs(each.difference))
        mark = " ▲" if each.change.beyond else ""
        rows.append(
            [
                TableCell(each.name, kind="name"),
                TableCell(
                    f"{fixed(each.change.before, decimals)} ± {fixed(each.before_half, decimals)}", each.change.before
                ),
                TableCell(
                    f"{fixed(each.change.after, decimals)} ± {fixed(each.after_half, decimals)}", each.change.after
                ),
                TableCell(fixed(each.difference, decimals), each.difference),
                TableCell(each.unit),
                TableCell(fixed(each.size, 2) + mark, each.size, kind="poor" if mark else ""),
            ]
        )
    origin = "is taken from the recalibration" if recalibrated else "follows from the two intervals"
    note = (
        f"± half of the 95 % interval. The interval of a change {origin}; ▲ marks changes that are larger than "
        "this interval."
    )
    return Section(
        "Changes", content, (Table("changes", "Parameters, sorted by the size of the change", columns, rows, note),)
    )


def _only(page_data: PageData, shared: Collection[str]) -> list[str]:
    """Parameters of a run that the comparison with the other run does not contain.

    If a parameter is compared, its separate values for single recordings are left out.
    """
    names = page_data.run.estimate.fit.names
    return [name for name in names if name not in shared and name.of_all not in shared]


def _show_errors(pair: Pair) -> Section:
    unit = effort_unit(pair.after)
    columns = [Column("joint", words=True)]
    numbers: list[Array] = []
    for what, of in (("training", PageData.training_rms), ("validation", PageData.validation_rms)):
        for when, page_data in (("before", pair.before), ("after", pair.after)):
            columns.append(Column(f"{what}, {when}", unit))
            numbers.append(of(page_data))
    rows = [
        [
            TableCell(label_of(pair.after.joints, j), kind="name"),
            *(TableCell(short(x), x) for x in (float(column[j]) for column in numbers)),
        ]
        for j in range(len(pair.after.joints))
    ]
    note = "Each run is compared with its own recordings, in its own band; errors also differ between motions."
    return Section("Torque error", {}, (Table("errors", "RMS torque error of each joint", columns, rows, note),))


def _show_sources(pair: Pair) -> Section:
    rows: list[list[TableCell]] = []
    for what, of in SOURCES.items():
        before, after = (of(page_data) for page_data in _both(pair))
        rows.append(
            [TableCell(what), TableCell(before), TableCell(after), TableCell("" if before == after else "differs")]
        )
    columns = [Column(name, words=True) for name in ("", "before", "after", " ")]
    return Section("Sources", {}, (Table("sources", "The two runs", columns, rows),))


SOURCES: Mapping[str, Callable[[PageData], str]] = {
    "folder": lambda m: m.run.folder,
    "robot": lambda m: m.run.robot.sha256[:12],
    "recordings": lambda m: ", ".join(f"{each.path} ({each.role})" for each in m.study.recordings),
    "method": lambda m: m.run.estimate.method,
    "terms": lambda m: ", ".join(term.name for term in m.run.estimate.terms),
    "cut-off": lambda m: f"{m.run.processing.cutoff} Hz",
    "covariance": lambda m: m.run.estimate.fit.covariance_kind,
    "verdict": lambda m: m.validation.verdict,
}

COMPARISON: Mapping[str, Callable[[Pair], Section]] = {
    "changes": _show_changes,
    "errors": _show_errors,
    "sources": _show_sources,
}
"""Sections of the page that compares two runs, in the order of the page."""
