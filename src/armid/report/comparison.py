"""Comparison of two runs of an arm: changes beyond the intervals, and torque errors."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from armid.errors import ArmidError
from armid.model.base_formulas import base_formulas
from armid.model.parameter_name import ParameterName
from armid.report.data.joint_names import label_of
from armid.report.data.number_format import decimals_of, fixed, short
from armid.report.data.page_data import PageData
from armid.report.section import Section, effort_unit
from armid.report.tables import Column, Table, TableCell
from armid.values import Array

BY_CHANCE = 0.05
"""Expected share of unchanged parameters whose estimates differ by more than a 95 % interval."""


@dataclass(frozen=True, eq=False, slots=True)
class Pair:
    """Two runs.

    Attributes:
        before: The earlier one.
        after: The later one.
    """

    before: PageData
    after: PageData


@dataclass(frozen=True, slots=True)
class RunChange:
    """Change of a parameter that means the same in both runs.

    Attributes:
        name: The parameter.
        unit: Its unit.
        before: Its earlier value.
        after: Its later value.
        before_half: Half of the earlier 95 % interval.
        after_half: Half of the later one.
    """

    name: str
    unit: str
    before: float
    after: float
    before_half: float
    after_half: float

    @property
    def difference(self) -> float:
        """Later less earlier."""
        return self.after - self.before

    @property
    def size(self) -> float:
        """Change divided by half of its own interval; above 1 noise alone does not explain it."""
        half = float(np.hypot(self.before_half, self.after_half))
        return abs(self.difference) / half if half > 0.0 else float(np.inf if self.difference else 0.0)


def pair_of(before: PageData, after: PageData) -> Pair:
    """Pair of two runs, checked to be comparable.

    Raises:
        ArmidError: They are of arms with other joints, or share no parameter.
    """
    names = [page_data.run.robot.joint_names for page_data in (before, after)]
    if names[0] != names[1]:
        raise ArmidError(
            f"{before.run.folder} has joints {', '.join(names[0])}; {after.run.folder} has {', '.join(names[1])}.",
            remedy="compare two runs of one arm.",
        )
    if not changes(pair := Pair(before, after)):
        raise ArmidError(
            f"{before.run.folder} and {after.run.folder} have no parameter in common.",
            remedy="identify both with the same description, gravity and terms.",
        )
    return pair


def changes(pair: Pair) -> list[RunChange]:
    """Changes of parameters in both runs, largest first; parameters with different groupings are excluded."""
    formulas = [
        dict(zip(m.run.estimate.base.names, base_formulas(m.run.estimate.base), strict=True)) for m in _both(pair)
    ]
    result: list[RunChange] = []
    values = [_values(m) for m in _both(pair)]
    units = dict(zip(pair.before.run.estimate.base.names, pair.before.run.estimate.base.units, strict=True))
    for name, (before, before_half) in values[0].items():
        if name in values[1] and formulas[0][name.of_all] == formulas[1].get(name.of_all):
            after, after_half = values[1][name]
            result.append(RunChange(name, units[name.of_all], before, after, before_half, after_half))
    return sorted(result, key=lambda change: -change.size)


def _both(pair: Pair) -> tuple[PageData, PageData]:
    return pair.before, pair.after


def _values(page_data: PageData) -> dict[ParameterName, tuple[float, float]]:
    """Value and half interval of each parameter."""
    fit = page_data.run.estimate.fit
    half = 0.5 * np.ptp(page_data.run.estimate.intervals, axis=1)
    return {name: (float(x), float(h)) for name, x, h in zip(fit.names, fit.values, half, strict=True)}


def _show_changes(pair: Pair) -> Section:
    all_changes = changes(pair)
    beyond = [each.name for each in all_changes if each.size > 1.0]
    shared = {each.name for each in all_changes}
    content = {
        "beyond": beyond,
        "count": len(all_changes),
        "chance": round(BY_CHANCE * len(all_changes)),
        "only": [
            (page_data.run.folder, [name for name in page_data.run.estimate.fit.names if name not in shared])
            for page_data in _both(pair)
        ],
    }
    columns = (
        Column("parameter", words=True),
        Column("before"),
        Column("after"),
        Column("change"),
        Column("unit", words=True),
        Column("change over its half interval"),
    )
    rows: list[list[TableCell]] = []
    for each in all_changes:
        decimals = decimals_of(min(each.before_half, each.after_half) or abs(each.difference))
        mark = " ▲" if each.size > 1.0 else ""
        rows.append(
            [
                TableCell(each.name, kind="name"),
                TableCell(f"{fixed(each.before, decimals)} ± {fixed(each.before_half, decimals)}", each.before),
                TableCell(f"{fixed(each.after, decimals)} ± {fixed(each.after_half, decimals)}", each.after),
                TableCell(fixed(each.difference, decimals), each.difference),
                TableCell(each.unit),
                TableCell(fixed(each.size, 2) + mark, each.size, kind="poor" if mark else ""),
            ]
        )
    note = "± half of the 95 % interval. The interval of a change follows from both; ▲ marks changes beyond it."
    return Section(
        "Changes", content, (Table("changes", "Parameters, the largest change first", columns, rows, note),)
    )


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
    note = "Errors of each run on its own recordings and in its own band; they differ between motions."
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
"""Sections of a comparison, in order."""
