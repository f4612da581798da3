"""Files of a designed motion: plan, motion for controllers and the same motion at low speed, preflight report."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from armid.atomic_file import replace_file
from armid.errors import ArmidError, did_you_mean
from armid.excitation.formats import FORMATS, SampledMotion
from armid.excitation.plan import Plan
from armid.excitation.poses_and_sweeps import Moves
from armid.excitation.preflight import worst
from armid.robot.robot import Robot
from armid.study.plans.design_result import Designed
from armid.study.plans.plan_reading import PLAN_FILE, limits_record, shape_records
from armid.study.plans.poses_and_sweeps import DesignedMoves
from armid.study.plans.preflight_text import mark_of, report_record, report_text
from armid.study.storage.atomic_folder import refuse, whole_folder
from armid.study.storage.records import finding_record, to_json


def refuse_plan_folder(folder: Path | str) -> None:
    """Raises an error, before a design starts, if the plan must not replace the given folder."""
    refuse(folder, PLAN_FILE, "plan")


def choose_formats(names: Sequence[str] | None) -> tuple[str, ...]:
    """Checks names of motion formats and returns them; all formats if no names are given.

    Raises:
        ArmidError: A format is unknown.
    """
    unknown = [name for name in names or () if name not in FORMATS]
    if unknown:
        raise ArmidError(
            f"Unknown format {unknown[0]!r}.",
            possible=", ".join(FORMATS),
            remedy=did_you_mean(unknown[0], FORMATS),
        )
    return tuple(names or FORMATS)


def plan_record(designed: Designed | DesignedMoves) -> dict[str, Any]:
    """Content of the file `plan.json` of a design."""
    return design_record(designed) if isinstance(designed, Designed) else _moves_record(designed)


def design_record(designed: Designed) -> dict[str, Any]:
    """Content of the file `plan.json` of a designed periodic motion."""
    plan, report, goal = designed.plan, designed.preflight, designed.problem.goal
    series = plan.excitation
    limits = {
        margin.limit: {"value": margin.value, "bound": margin.bound, "joint": margin.label, "unit": margin.unit}
        for margin in worst(report.margins)
    }
    return {
        "robot": series.robot,
        "joints": goal.model.robot.joint_names,
        "base_frequency": series.base_frequency,
        "offset": series.offset,
        "a": series.a,
        "b": series.b,
        "criterion": goal.criterion,
        "condition": designed.expected.condition,
        "log_det": designed.expected.log_det,
        "seconds": designed.search.seconds,
        "limits": limits,
        "repetitions": plan.repetitions,
        "begin": plan.begin,
        "end": plan.end,
        "lead_in": plan.lead_in,
        "lead_out": plan.lead_out,
        "noise": goal.noise,
        "rate": goal.rate,
        "descents": designed.search.descents,
        "interrupted": designed.search.interrupted,
        "joint_limits": limits_record(designed.limits),
        **_verdict_record(designed),
        "surroundings": [] if designed.collision is None else shape_records(designed.collision.surroundings),
    }


def _moves_record(designed: DesignedMoves) -> dict[str, Any]:
    """Content of the file `plan.json` of designed poses or sweeps."""
    moves = designed.plan
    return {
        "robot": designed.robot.name,
        "joints": moves.joints,
        "poses": moves.poses,
        "speeds": moves.speeds,
        "stretches": [
            {"kind": kind, "seconds": seconds} for kind, seconds in zip(moves.kinds, moves.seconds, strict=True)
        ],
        "duration": moves.duration,
        "joint_limits": limits_record(designed.limits),
        **_verdict_record(designed),
    }


def _verdict_record(designed: Designed | DesignedMoves) -> dict[str, Any]:
    """Keys of `plan.json` for the verdict, the pairs of bodies that are not checked, and the findings."""
    report = designed.preflight
    return {
        "verdict": report.verdict,
        "mark": mark_of(report),
        "said": report.sentence,
        "left_out": [each.pair for each in report.skipped],
        "findings": [finding_record(finding) for finding in designed.findings],
    }


def save_design(
    designed: Designed | DesignedMoves,
    folder: Path | str,
    *,
    formats: Sequence[str] = tuple(FORMATS),
    rate: float | None = None,
    rehearsal: float = 0.2,
    pages: Callable[[Path], None] | None = None,
) -> Path:
    """Writes the folder of a design, completely or not at all.

    If the verdict of the design is `fail`, motions for controllers are not written.

    Args:
        designed: The design.
        folder: Output folder; an existing plan is replaced.
        formats: Names of the formats of the motion files; formats that cannot represent this arm are left out.
        rate: Sample rate in every format [Hz]; if not given, the default of each format.
        rehearsal: Speed of the rehearsal (the same motion, but slower), as a share of the speed of the plan.
        pages: Function that writes further files into a folder that is given to it, before the plan replaces an
            earlier one.
    """
    record = plan_record(designed)
    with whole_folder(folder, PLAN_FILE, "plan") as draft:
        if designed.preflight.verdict != "fail":
            _write_motions(draft, designed.plan, designed.robot, formats, rate, rehearsal)
        replace_file(draft / "preflight.json", to_json(report_record(designed)) + "\n")
        replace_file(draft / "preflight.txt", report_text(designed))
        replace_file(draft / PLAN_FILE, to_json(record) + "\n")
        if pages is not None:
            pages(draft)
    return Path(folder)


def _write_motions(
    draft: Path, plan: Plan | Moves, robot: Robot, formats: Sequence[str], rate: float | None, rehearsal: float
) -> None:
    """Writes the motion and its rehearsal in every format that can represent this arm."""
    for name in formats:
        for each, stem in ((plan, "plan"), (plan.rehearsal(rehearsal), "rehearsal")):
            track = track_of(each, robot, FORMATS[name].RATE if rate is None else rate)
            if not FORMATS[name].problem(track):
                replace_file(draft / f"{stem}{FORMATS[name].SUFFIX}", FORMATS[name].write(track))


def track_of(plan: Plan | Moves, robot: Robot, rate: float) -> SampledMotion:
    """Samples a plan at a rate [Hz], for a file that a controller reads."""
    if not rate > 0.0:
        raise ArmidError(
            f"The sample rate of a motion must be above zero; found {rate} Hz.", remedy="correct --format-rate."
        )
    prismatic = tuple(joint.is_prismatic for joint in robot.joints)
    if isinstance(plan, Moves):
        return SampledMotion(robot.name, robot.joint_names, prismatic, plan.sample(rate))
    series = plan.excitation
    text = json.dumps(
        {
            "robot": series.robot,
            "base_frequency": series.base_frequency,
            "offset": series.offset.tolist(),
            "a": series.a.tolist(),
            "b": series.b.tolist(),
            "repetitions": plan.repetitions,
            "lead_in": plan.lead_in,
            "lead_out": plan.lead_out,
        }
    )
    return SampledMotion(robot.name, robot.joint_names, prismatic, plan.sample(rate), text)
