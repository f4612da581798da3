"""Rows that do not follow each other, a clock that velocities contradict, coarse channels, units by the limits."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from armid.errors import Finding
from armid.measurement.recording import Recording
from armid.robot import Robot
from armid.study.diagnosis import diagnose_recording
from armid.study.remedy_translation import tables_of
from healing import told_after
from sick import Case, sound

UR10E, PANDA = 4, 51
"""Seeds of logs of these arms."""

RATE = 0.02
"""Relative error of a unit of time that is taken from velocities."""


def told(case: Case) -> list[Finding]:
    return [f for f in diagnose_recording(case.robot, case.recording, case.reading) if f.severity != "info"]


def rows_of(case: Case, rows: np.ndarray) -> Case:
    """Some rows of a log, with time stamps as if they followed each other."""
    log = case.recording
    assert log.effort is not None and log.time is not None
    step = float(np.median(np.diff(log.time)))
    parts = {name: x[rows] for name in ("q", "dq", "ddq", "effort") if (x := getattr(log, name)) is not None}
    few: Recording = replace(log, time=step * np.arange(len(rows)), valid=log.valid[rows], **parts)
    return replace(case, recording=few)


@pytest.mark.parametrize("velocities", [True, False])
def test_a_cut_is_named_with_its_time(velocities: bool):
    case = sound(UR10E)
    if not velocities:
        case = case.logged(dq=None)
    count = case.recording.samples
    cut = rows_of(case, np.concatenate([np.arange(count // 2), np.arange(count * 11 // 20, count)]))
    found = [f for f in told(cut) if f.code == "rows-not-consecutive"]
    assert [(f.severity, f.channel) for f in found] == [("error", "time")]
    assert cut.recording.time is not None
    at = float(re.findall(r"At t = ([\d.]+) s", found[0].evidence)[0])
    assert abs(at - float(cut.recording.time[count // 2 - 1])) < 2e-3  # the last digit that is printed, and a step
    (interval,) = tables_of(found[0].remedy)["recording"]["exclude"]
    assert interval[0] < at < interval[1]


def test_lost_rows_are_named():
    case = sound(UR10E)
    rng = np.random.default_rng(1)
    lost = rows_of(case, np.flatnonzero(rng.random(case.recording.samples) > 0.05))
    assert "rows-not-consecutive" in {f.code for f in told(lost)}
    assert "rows-not-consecutive" not in {f.code for f in told(case)}


@pytest.mark.parametrize("factor", [2.0, 0.5])
def test_a_clock_that_all_velocities_contradict_is_named_and_the_remedy_heals(factor: float):
    case = sound(UR10E)
    assert case.recording.time is not None
    if case.recording.dq is None:
        case = case.logged(dq=case.motion.dq)
    assert case.recording.time is not None
    slow = replace(case, recording=replace(case.recording, time=factor * case.recording.time))
    found = [f for f in told(slow) if f.code == "clock-rate"]
    assert [(f.severity, f.channel) for f in found] == [("error", "time")]
    unit = tables_of(found[0].remedy)["recording"]["time_unit"]
    assert unit * factor == pytest.approx(1.0, rel=RATE)
    assert not {"clock-rate", "velocity-mismatch"} & told_after(slow, found[0])


def test_velocities_in_degrees_are_no_wrong_clock():
    case = sound(UR10E)
    case = case.logged(dq=np.degrees(case.motion.dq))
    codes = {f.code for f in told(case)}
    assert "velocity-mismatch" in codes and "clock-rate" not in codes


@pytest.mark.parametrize("steps", [5.0, 14.0, 20.0])
def test_coarse_channels_are_named_and_others_are_not(steps: float):
    """Also a torque that lost what is behind its decimal point."""
    case = sound(UR10E)
    assert case.recording.effort is not None
    effort, q = case.recording.effort.copy(), case.recording.q.copy()
    step = np.ptp(effort[:, 1]) / steps
    effort[:, 1] = np.trunc(effort[:, 1] / step) * step
    q[:, 2] = np.round(q[:, 2] / 0.05) * 0.05
    found = [f for f in told(case.logged(effort=effort, q=q)) if f.code == "channel-coarse"]
    names = case.robot.joint_names
    assert {(f.channel, f.evidence.split()[1]) for f in found} == {(names[1], "torque"), (names[2], "position")}
    fine = np.round(case.recording.q / 0.0015) * 0.0015  # encoders of 4096 counts
    assert "channel-coarse" not in {f.code for f in told(case.logged(q=fine))}


def without_masses(robot: Robot) -> Robot:
    return replace(robot, links=tuple(replace(link, inertial=None) for link in robot.links))


@pytest.mark.parametrize(("factor", "name"), [(1000.0, "mN·m"), (1e-4, "kN·m")])
def test_units_are_seen_by_the_limits_where_masses_are_missing(factor: float, name: str):
    case = sound(UR10E)
    bare = replace(case, robot=without_masses(case.robot))
    assert "torque-unit" not in {f.code for f in told(bare)}
    assert bare.recording.effort is not None
    found = [f for f in told(bare.logged(effort=factor * bare.recording.effort)) if f.code == "torque-unit"]
    assert [f.severity for f in found] == ["error"] and name in found[0].evidence


def test_units_are_seen_by_masses_and_limits_together_where_masses_are_placeholders():
    case = sound(UR10E)
    assert case.recording.effort is not None
    links = tuple(
        replace(link, inertial=link.inertial and replace(link.inertial, mass=3.0)) for link in case.robot.links
    )
    same = replace(case, robot=replace(case.robot, links=links))
    assert "torque-unit" not in {f.code for f in told(same)}
    found = [f for f in told(same.logged(effort=10.197 * case.recording.effort)) if f.code == "torque-unit"]
    assert [f.severity for f in found] == ["error"]


@pytest.mark.parametrize(("seed", "joint"), [(PANDA, 1), (PANDA, 2)])
def test_a_torque_that_is_logged_without_its_sign_is_named(seed: int, joint: int):
    case = sound(seed)
    assert case.recording.effort is not None
    effort = case.recording.effort.copy()
    effort[:, joint] = np.abs(effort[:, joint])
    found = [f for f in told(case.logged(effort=effort)) if "without signs" in f.evidence]
    assert [(f.code, f.channel) for f in found] == [("torque-sign", case.robot.joint_names[joint])]


def test_a_torque_whose_number_overflows_is_named():
    case = sound(UR10E)
    assert case.recording.effort is not None
    effort = case.recording.effort.copy()
    end = 0.6 * np.abs(effort[:, 1]).max()
    effort[:, 1] = (effort[:, 1] + end) % (2.0 * end) - end
    found = [f for f in told(case.logged(effort=effort)) if f.code == "saturation"]
    assert [(f.severity, f.channel) for f in found] == [("error", case.robot.joint_names[1])]
    assert "overflows" in found[0].evidence


def test_a_torque_that_falls_to_zero_again_and_again_is_named():
    case = sound(UR10E)
    assert case.recording.effort is not None and case.recording.time is not None
    effort = case.recording.effort.copy()
    effort[(10.0 * case.recording.time).astype(int) % 2 == 1, 2] = 0.0
    found = [f for f in told(case.logged(effort=effort)) if f.code == "channel-dead"]
    assert [(f.severity, f.channel) for f in found] == [("error", case.robot.joint_names[2])]
    assert "comes back" in found[0].evidence


def test_a_torque_that_is_sampled_more_slowly_is_named_with_its_interval():
    case = sound(UR10E)
    assert case.recording.effort is not None and case.recording.time is not None
    step = float(np.median(np.diff(case.recording.time)))
    rows = max(2, round(0.1 / step))
    effort = case.recording.effort.copy()
    effort[:, 2] = effort[np.arange(len(effort)) // rows * rows, 2]
    found = [f for f in told(case.logged(effort=effort)) if f.code == "channel-coarse"]
    assert [(f.severity, f.channel) for f in found] == [("warning", case.robot.joint_names[2])]
    seconds = float(re.findall(r"new every ([\d.]+) s", found[0].evidence)[0])
    assert seconds == pytest.approx(rows * step, rel=0.02)  # three digits are printed


def test_a_noisy_torque_that_is_lost_again_and_again_is_named():
    """The steps to zero and back are no larger than those of the noise, but no other value repeats."""
    case = sound(UR10E)
    assert case.recording.effort is not None and case.recording.time is not None
    effort, rng = case.recording.effort.copy(), np.random.default_rng(1)
    effort[:, 4] += 2.0 * effort[:, 4].std() * rng.standard_normal(len(effort))
    effort[(case.recording.time * 10.0).astype(int) % 3 == 0, 4] = 0.0
    found = [f for f in told(case.logged(effort=effort)) if f.code == "channel-dead"]
    assert [f.channel for f in found] == [case.robot.joint_names[4]]
