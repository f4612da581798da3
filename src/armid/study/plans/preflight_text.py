"""Preflight report of a designed motion as text and as JSON."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from armid.errors import Finding
from armid.excitation.certification import Margin
from armid.excitation.collision.closest_approach import ClosestApproach
from armid.excitation.collision.ignored_pairs import pairs_by_reason
from armid.excitation.preflight import Expectation, Preflight
from armid.notebook_display import plural
from armid.study.plans.design_result import Designed
from armid.study.plans.poses_and_sweeps import DesignedMoves
from armid.study.storage.records import finding_record

Checked = Designed | DesignedMoves
"""Designed motion (periodic, poses or sweeps) with its preflight check."""

MOST_LINES = 12
"""Largest number of parameters, and of pairs of bodies, in the text report; `preflight.json` has all of them."""

MARKS = {"pass": "✓", "fail": "✗", "weak": "!", "not checked": "–"}
"""Marks that precede the verdict of a preflight check, by verdict."""

MEASURED = "distances between the shapes of the description, their convex hulls, or triangles of meshes"
"""Text that explains which shapes represent the bodies when the closest approaches are computed."""


def mark_of(report: Preflight) -> str:
    """Mark that precedes the verdict of a preflight check.

    A passed check also has the mark `!`, which means a warning, if limits are wider than described, or if the bodies
    of a pair touch that the user has excluded from the check.
    """
    doubtful = report.wider is not None or any(each.unexpected for each in report.touching)
    return MARKS["weak" if report.verdict == "pass" and doubtful else report.verdict]


def findings_of(designed: Checked) -> tuple[Finding, ...]:
    """Findings about the robot description and about the design, without duplicates."""
    return tuple(dict.fromkeys((*designed.robot.findings, *designed.findings)))


def report_record(designed: Checked) -> dict[str, Any]:
    """Content of the file `preflight.json` of a designed motion."""
    report = designed.preflight
    return {
        "verdict": report.verdict,
        "mark": mark_of(report),
        "said": report.sentence,
        "torque_lacks": report.torque_lacks,
        "clearance": report.clearance,
        "collisions": f"not checked: {report.unchecked}" if report.unchecked else "checked",
        "limits": [
            {
                "limit": m.limit,
                "joint": m.label,
                "value": m.value,
                "bound": m.bound,
                "unit": m.unit,
                "time": m.time,
                "share": m.share,
                "certified_share": m.certified,
                **({"measured": "capsules or hulls, as in the search"} if m.limit == "collision" else {}),
            }
            for m in report.margins
        ],
        "approaches": [
            {
                "pair": a.pair,
                "distance": a.distance,
                "time": a.time,
                "asked": a.required_distance,
                "measured": a.measured,
                "constant": a.constant,
            }
            for a in report.approaches
        ],
        "skipped_pairs": [
            {"pair": each.pair, "touching": None if each.reason else each.share, "reason": each.why}
            for each in report.skipped
        ],
        **(_expected_record(designed.expected) if isinstance(designed, Designed) else {}),
        "torque_units": [joint.effort_unit for joint in designed.robot.joints],
        "start": dict(zip(designed.limits.joints, designed.start.tolist(), strict=True)),
        "velocity_share": 1.0,
        "torque_share": torque_share(designed),
        "findings": [finding_record(finding) for finding in findings_of(designed)],
    }


def _expected_record(expected: Expectation) -> dict[str, Any]:
    """Predicted uncertainty of the parameters after a recording of the plan, as keys of `preflight.json`."""
    return {
        "condition": expected.condition,
        "log_det": expected.log_det,
        "base_parameters": [
            {"name": name, "unit": unit, "deviation": deviation}
            for name, unit, deviation in zip(expected.names, expected.units, expected.deviation, strict=True)
        ],
        "torque_deviation": expected.torque,
    }


def report_text(designed: Checked, *, findings: bool = True) -> str:
    """Preflight report as text.

    Args:
        designed: The design.
        findings: True if findings are appended; on a screen they are printed separately.
    """
    report = designed.preflight
    lines = [
        f"{mark_of(report)} {report.sentence}",
        "",
        f"{designed.robot.name}: {designed.heading}",
        *(_criterion_lines(designed) if isinstance(designed, Designed) else []),
        f"start pose: {start_text(designed)}",
        "",
        "limits (share of the limit on a grid of 1 kHz, and certified share between the points of the grid)",
        f"  {margins_text(designed)}",
        *(_limit_line(m, designed) for m in report.margins if m.limit != "collision"),
    ]
    if report.approaches:
        lines += _approach_lines(report)
    if report.skipped:
        lines += ["", "pairs of bodies that are not checked, by reason"]
        lines += [f"  {why}: {'; '.join(pairs)}" for why, pairs in pairs_by_reason(report.skipped).items()]
    if isinstance(designed, Designed):
        lines += _expected_lines(designed)
    if findings:
        lines += ["", *(_finding_line(finding) for finding in findings_of(designed))]
    return "\n".join(lines).rstrip() + "\n"


def skipped_pairs(report: Preflight) -> dict[str, Any]:
    """Record of the pairs of bodies that are not checked: a sentence with their number, and the pairs by reason."""
    count = len(report.skipped)
    counted = f"{plural(count, 'pair')} of bodies {'is' if count == 1 else 'are'} not checked"
    return {"counted": counted, "skipped": pairs_by_reason(report.skipped)}


def _approach_lines(report: Preflight) -> list[str]:
    """Lines of the report with the closest approaches; pairs with constant distance come last."""
    changing = [each for each in report.approaches if not each.constant]
    constant = [each for each in report.approaches if each.constant]
    lines = ["", f"closest approaches (required distance; {MEASURED})"]
    lines += [
        f"  {a.pair:<40}{1000 * a.distance:8.0f} mm at {a.time:6.2f} s  ({1000 * a.required_distance:.0f} mm; "
        f"{a.measured})"
        for a in changing[:MOST_LINES]
    ]
    if len(changing) > MOST_LINES:
        lines.append(f"  … {len(changing) - MOST_LINES} more pairs have larger distances")
    if constant:
        lines.append(f"  {constant_text(constant)}")
    return lines


def constant_text(constant: Sequence[ClosestApproach]) -> str:
    """Sentence that lists pairs with nearly constant distance, each with its distance and its required distance."""
    pairs = "; ".join(f"{a.pair} {1000 * a.distance:.1f} mm ({1000 * a.required_distance:.1f} mm)" for a in constant)
    return f"neighbouring links at a nearly constant distance, and in parentheses the required distance: {pairs}"


def _criterion_lines(designed: Designed) -> list[str]:
    """Line of the report with the criterion of the design, the condition number and the log-determinant."""
    expected = designed.expected
    return [
        f"designed for {designed.problem.goal.criterion}; condition number {expected.condition:.2f}, "
        f"log-determinant of the Fisher information {expected.log_det:.2f}"
    ]


def _limit_line(margin: Margin, designed: Checked) -> str:
    """Line of the report for one limit; for a position limit, the line contains the range of the position."""
    when = "" if np.isnan(margin.time) else f" at {margin.time:6.2f} s"
    shares = f"{100 * margin.share:6.1f} %  {100 * margin.certified:6.1f} %{when}"
    spread = designed.spread(margin)
    if spread is None:
        value = f"{margin.value:>10.4f} of {margin.bound:>9.4f} {margin.unit:<7}"
    else:
        low, high, lower, upper = spread
        value = f"{low:.4f}…{high:.4f} of {lower:.4f}…{upper:.4f} {margin.unit}  "
    return f"  {margin.limit:<13}{margin.label:<24}{value}{shares}"


def _expected_lines(designed: Designed) -> list[str]:
    """Lines of the report with the predicted standard deviations of the parameters after a recording of the plan."""
    goal, expected = designed.problem.goal, designed.expected
    units = [joint.effort_unit for joint in goal.model.robot.joints]
    noises = [f"{x:.3g} {unit}" for x, unit in zip(goal.noise, units, strict=True)]
    noise = ", ".join(noises if len(set(noises)) > 1 else noises[:1])
    lines = ["", f"predicted standard deviations, for uncorrelated torque noise of {noise} at {goal.rate:g} Hz"]
    order = np.argsort(-expected.deviation)
    for k in order[:MOST_LINES]:
        lines.append(f"  {expected.names[k]:<12}{expected.deviation[k]:12.3g} {expected.units[k]}")
    if len(order) > MOST_LINES:
        lines.append(f"  … {len(order) - MOST_LINES} more deviations are smaller; preflight.json contains all")
    torque = ", ".join(f"{x:.3g} {unit}" for x, unit in zip(expected.torque, units, strict=True))
    lines.append(f"  deviation of the predicted torque, joint by joint: {torque}")
    return lines


def start_text(designed: Checked) -> str:
    """Text that gives the start pose: name, position and unit of each joint."""
    q, joints = designed.start.tolist(), designed.robot.joints
    return ", ".join(f"{joint.name} {round(x, 4) + 0.0:g} {joint.unit}" for joint, x in zip(joints, q, strict=True))


def torque_share(designed: Checked) -> float | None:
    """Share of the torque limits that the plan may use; `None` if torque is not checked."""
    torque = designed.torque
    return None if torque is None else float(torque.limit[0] / designed.limits.effort[torque.joints[0]])


def margins_text(designed: Checked) -> str:
    """Sentence with the shares of the velocity and torque limits that the plan may use."""
    share = torque_share(designed)
    if share is None:
        return "the plan may use 100 % of each velocity limit; its torque is not checked"
    if share == 1.0:
        return "the plan may use 100 % of each velocity limit and of each torque limit"
    return (
        f"the plan may use 100 % of each velocity limit, but only {100.0 * share:.0f} % of each torque limit, "
        "because predicted torques are uncertain; the torque bounds in the table are these reduced limits"
    )


def _finding_line(finding: Finding) -> str:
    """Line of the preflight report with a finding and its remedy."""
    where = f"{finding.channel}: " if finding.channel else ""
    stop = "; " if finding.remedy and finding.evidence[-1:] not in (".", ";") else " "
    said = stop.join(part for part in (where + finding.evidence, finding.remedy) if part)
    return f"{finding.severity} {finding.code}: {said}"
