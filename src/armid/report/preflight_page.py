"""Page of the preflight check: margins of a plan to all limits, and expected accuracy of the estimate."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from armid.excitation.certification import Margin
from armid.excitation.collision.closest_approach import ClosestApproach
from armid.excitation.limits.workspace import SCALE
from armid.excitation.preflight import Preflight, worst
from armid.model.described_torque import described_torque_text
from armid.report.data.joint_names import groups_of, label_of
from armid.report.data.number_format import fixed, share, short
from armid.report.page import assemble
from armid.report.page_file import write_html
from armid.report.planned_motion import motion_section
from armid.report.rendering import require_extra
from armid.report.section import Section
from armid.report.tables import Column, Table, TableCell
from armid.study.plans.design_result import Designed
from armid.study.plans.preflight_text import (
    Checked,
    findings_of,
    margins_text,
    mark_of,
    skipped_pairs,
    start_text,
)

COLLISION = "collision"
DISTANCES = (COLLISION, "tip")
"""Kinds of limits whose value is a distance that must not become smaller than the bound."""

CLOSE = 0.99
"""Used share of a limit above which the limit counts as fully used."""

MANY = 12
"""Largest number of rows with which a table is not folded."""


def write_preflight(designed: Checked, path: Path | str) -> Path:
    """Writes the page of the preflight check of a plan, completely or not at all.

    Raises:
        MissingExtraError: jinja2 or plotly is not installed.
        ArmidError: The file cannot be written.
    """
    require_extra()
    return write_html(path, render_preflight(designed))


def render_preflight(designed: Checked) -> str:
    """HTML of the page of the preflight check of a plan."""
    subtitle = f"Pre-flight check: {designed.heading}"
    if isinstance(designed, Designed):
        subtitle += f", {designed.plan.duration:.1f} s in all; designed for {designed.problem.goal.criterion}"
    sections = {name: section for name, show in PREFLIGHT.items() if (section := show(designed)) is not None}
    return assemble(designed.robot.name, subtitle, sections, with_plots=True)


def show_limits(designed: Checked) -> Section:
    """Section of all limits of a plan, each with the smallest margin, its joint and its time."""
    margins = designed.preflight.margins
    rows = [_margin_row(margin, designed) for margin in margins if margin.limit != COLLISION]
    columns = (
        Column("limit", words=True),
        Column("of", words=True),
        Column("value"),
        Column("bound"),
        Column("unit", words=True),
        Column("reached", "%"),
        Column("certified", "%"),
        Column("at", "s"),
    )
    note = (
        "Reached: largest value on a grid of 1 kHz. Certified: bound that also holds between the points of "
        "the grid. For friction, which may jump at a reversal of a joint, and for poses and sweeps, the "
        "largest step between two points is added instead. ▲ marks limits that are fully used."
    )
    content = {
        "verdict": designed.preflight.verdict,
        "mark": mark_of(designed.preflight),
        "said": designed.preflight.sentence,
        "worst": _worst_rows(designed.preflight),
        "findings": [(each.severity, each.code, each.evidence, each.remedy) for each in findings_of(designed)],
        "start": start_text(designed),
        "margins": margins_text(designed),
    }
    return Section("Limits", content, (Table("limits", "Every limit", columns, rows, note),))


def _worst_rows(report: Preflight) -> list[tuple[str, str, str, str]]:
    """Rows of a table: limit, joint or pair, value and time of the smallest margin of each kind of limit.

    Distances in these rows are those of the closest approaches, not the distances of capsules or hulls in the search.
    """
    rows = [
        (m.limit, m.label, _reached(m), "" if math.isnan(m.time) else fixed(m.time, 2))
        for m in worst(report.margins)
        if m.limit != COLLISION
    ]
    if report.approaches:
        changing = [each for each in report.approaches if not each.constant] or report.approaches
        nearest = min(changing, key=lambda each: each.distance - each.required_distance)
        distance, required = (fixed(1000.0 * each, 0) for each in (nearest.distance, nearest.required_distance))
        reached = f"{distance} mm distance, {required} mm required"
        rows.append((COLLISION, nearest.pair, reached, fixed(nearest.time, 2)))
    return rows


def _reached(margin: Margin) -> str:
    """Text that compares the largest value of a plan with its limit."""
    if margin.limit in DISTANCES:
        return f"{fixed(1000.0 * margin.value, 0)} mm distance, {fixed(1000.0 * margin.bound, 0)} mm required"
    return f"{share(margin.share)} of the limit"


def _margin_row(margin: Margin, designed: Checked) -> tuple[TableCell, ...]:
    timeless = math.isnan(margin.time)
    reached = certified = TableCell("–", "")
    if margin.limit not in DISTANCES:
        reached, certified = (TableCell(fixed(100.0 * x, 1), 100.0 * x) for x in (margin.share, margin.certified))
        if margin.certified > CLOSE:
            certified = TableCell(f"{certified.text} ▲", certified.value)
    return (
        TableCell(margin.limit, kind="name"),
        TableCell(margin.label, kind="name"),
        *_value_and_bound(margin, designed),
        TableCell(margin.unit),
        reached,
        certified,
        TableCell("–", "") if timeless else TableCell(fixed(margin.time, 2), margin.time),
    )


def _value_and_bound(margin: Margin, designed: Checked) -> tuple[TableCell, TableCell]:
    """Cells of one limit in the table: largest value in the plan, and its bound; for positions, the two ranges."""
    spread = designed.spread(margin)
    if spread is None:
        return TableCell(fixed(margin.value, 4), margin.value), TableCell(fixed(margin.bound, 4), margin.bound)
    low, high, lower, upper = (fixed(x, 4) for x in spread)
    return TableCell(f"{low}…{high}", margin.value), TableCell(f"{lower}…{upper}", margin.bound)


def show_approaches(designed: Checked) -> Section | None:
    """Section of the closest approach of each pair of links; `None` if collisions were not checked."""
    report = designed.preflight
    if not report.approaches and not report.skipped:
        return None
    required = {margin.label: margin for margin in report.margins if margin.limit == COLLISION}
    rows: list[tuple[TableCell, ...]] = []
    for each in nearest_of_links(report.approaches):
        capsules, distance = required.get(each.pair), 1000.0 * each.distance
        nothing = TableCell("–", "")
        around, between = nothing, nothing
        if capsules is not None:
            sure = 1000.0 * (capsules.value - SCALE * (capsules.certified - capsules.share))
            around = TableCell(fixed(1000.0 * capsules.value, 0), 1000.0 * capsules.value)
            between = TableCell(fixed(sure, 0), sure)
        mark = "" if each.is_sufficient else " ▲"
        rows.append(
            (
                TableCell(each.pair.links, kind="name"),
                TableCell(fixed(distance, 0) + mark, distance),
                TableCell(each.measured),
                TableCell("all poses", each.time) if each.constant else TableCell(fixed(each.time, 2), each.time),
                around,
                between,
                TableCell(fixed(1000.0 * each.required_distance, 0), 1000.0 * each.required_distance),
            )
        )
    columns = (
        Column("links", words=True),
        Column("closest", "mm"),
        Column("between", words=True),
        Column("at", "s"),
        Column("in search", "mm"),
        Column("certified", "mm"),
        Column("required", "mm"),
    )
    note = (
        "Closest: distance that is measured independently of the search, 50 times per second and 250 times "
        "per second near the minimum, between the shapes of the description, the convex hulls of up to four "
        "slices of a mesh, or its triangles. In search: distance of the capsules around the bodies, or of "
        "hulls if capsules are too wide, on a grid of 1 kHz. Certified: lower bound of this distance that "
        "also holds between the points of the grid. Required: the clearance, or less if links are built "
        "closer to each other. Pairs with the same distance in all poses are at the end. ▲ marks pairs that "
        "come too close."
    )
    title = f"Closest approach of each of {len(rows)} pairs of links, nearest pairs first, constant distances last"
    table = Table("approaches", title, columns, rows, note, folded=len(rows) > MANY)
    return Section("Closest approaches", skipped_pairs(report), (table,) if rows else ())


def nearest_of_links(approaches: Sequence[ClosestApproach]) -> list[ClosestApproach]:
    """Closest approach of each pair of links over all their bodies, nearest first, constant distances last."""
    nearest: dict[str, ClosestApproach] = {}
    for each in sorted(
        approaches, key=lambda approach: (approach.is_sufficient, approach.constant, approach.distance)
    ):
        nearest.setdefault(each.pair.links, each)
    return sorted(nearest.values(), key=lambda approach: (approach.constant, approach.distance))


def show_expected(designed: Checked) -> Section | None:
    """Section of the standard deviations that are predicted for an estimate from the planned motion."""
    if not isinstance(designed, Designed):
        return None
    expected, goal = designed.expected, designed.problem.goal
    robot = goal.model.robot
    order, groups = groups_of(expected.names, robot.joints)
    parameters = Table(
        "expected-parameters",
        f"Predicted standard deviation of each of {len(order)} base parameters, joint by joint",
        (Column("parameter", words=True), Column("standard deviation"), Column("unit", words=True)),
        [
            (
                TableCell(expected.names[k], kind="name"),
                _cell(float(expected.deviation[k])),
                TableCell(expected.units[k]),
            )
            for k in order
        ],
        folded=True,
        groups=groups,
    )
    torque = Table(
        "expected-torque",
        "Predicted standard deviation of the model's torque along this plan",
        (
            Column("joint", words=True),
            Column("assumed noise"),
            Column("standard deviation"),
            Column("unit", words=True),
        ),
        [
            (
                TableCell(label_of(robot.joints, j), kind="name"),
                _cell(float(noise)),
                _cell(float(x)),
                TableCell(robot.joints[j].effort_unit),
            )
            for j, (noise, x) in enumerate(zip(goal.noise, expected.torque, strict=True))
        ],
    )
    content = {
        "condition": short(expected.condition, 4),
        "log_det": fixed(expected.log_det, 2),
        "rate": f"{goal.rate:g}",
        "repetitions": goal.repetitions,
        "known": goal.prior is not None,
    }
    return Section("Expected accuracy", content, (torque, parameters))


def _cell(value: float) -> TableCell:
    return TableCell(short(value), value)


def show_motion(designed: Checked) -> Section:
    """Section of position, velocity, acceleration and torque over time, with their limits."""
    model = designed.problem.goal.model if isinstance(designed, Designed) else designed.model
    described = described_torque_text(model.robot) if model.nominal_parameters() is not None else ""
    estimated = any(finding.code == "torque-estimated" for finding in designed.findings)
    content = {"torque": described[:1].upper() + described[1:], "estimated": estimated}
    return motion_section(designed.plan, model, designed.limits, content)


PREFLIGHT: Mapping[str, Callable[[Checked], Section | None]] = {
    "limits": show_limits,
    "approaches": show_approaches,
    "motion": show_motion,
    "expected": show_expected,
}
"""Sections of the preflight page, in the order of the page; each section has a template of the same name."""
