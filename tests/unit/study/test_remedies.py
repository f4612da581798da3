"""Remedies of the doctor: lines of a study that heal what they are for, and say so to whoever has no study."""

from __future__ import annotations

import tomllib
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from armid.errors import Finding
from armid.measurement.log_format import LogFormat
from armid.measurement.processing.options import ProcessingOptions
from armid.measurement.readers import load_recording
from armid.measurement.remedy_builders import excluding, lines, naming
from armid.remedy import Remedy
from armid.study.config import ModelChoice, RecordingChoice, RobotChoice, Study, parse_study
from armid.study.diagnosis import diagnose_recording
from armid.study.remedy_translation import applied, as_option, as_study, at_the_prompt, tables_of
from healing import TRUE, delay_error, is_right, told_after
from recordings import write_csv
from sick import FAULTS, Case, sound

BY_HAND = ("record ", "log ", "rewrite ", "find out ", "correct ")
"""Beginnings of remedies that are no line of a study."""

SEEDS = (51, 54)
"""A Panda and a UR10e."""


def findings(case: Case) -> tuple[Finding, ...]:
    return diagnose_recording(case.robot, case.recording, case.reading)


def errors_in(log: Path, case: Case, reading: LogFormat) -> list[Finding]:
    found = diagnose_recording(case.robot, load_recording(log, reading, case.robot), reading)
    return [finding for finding in found if finding.severity == "error"]


def of(name: str, case: Case) -> tuple[Finding, ...]:
    return tuple(finding for finding in findings(case) if finding.code == name)


@pytest.mark.long
@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("fault", FAULTS)
def test_every_remedy_is_a_line_of_a_study_that_heals_or_is_done_by_hand(fault: str, seed: int):
    """Fault, remedy, healed: whatever is told of a log is no longer told when its remedy is followed."""
    case = FAULTS[fault](seed)
    found = findings(case)
    assert fault in {finding.code for finding in found}
    assert is_right(case, fault, found)
    for finding in found:
        if not tables_of(finding.remedy):
            assert finding.remedy.startswith(BY_HAND) or (finding.severity == "info" and not finding.remedy), finding
            continue
        assert finding.code not in told_after(case, finding), finding


@pytest.mark.parametrize("fault", sorted(TRUE))
def test_where_a_fault_has_one_truth_the_remedy_is_it(fault: str):
    case = FAULTS[fault](SEEDS[0])
    assert is_right(case, fault, of(fault, case)) and of(fault, case)


def exchanged(case: Case, i: int, j: int, *, velocities: bool = True) -> Case:
    order = np.arange(case.robot.n)
    order[[i, j]] = j, i
    dq = case.recording.dq
    if velocities and dq is not None:
        dq = dq[:, order]
    return case.logged(q=case.recording.q[:, order], dq=dq)


@pytest.mark.parametrize(("i", "j"), [(4, 5), (1, 3)])
@pytest.mark.parametrize("velocities", [True, False])
def test_positions_alone_that_are_exchanged_are_put_back_and_nothing_else(i: int, j: int, velocities: bool):
    case = exchanged(sound(11), i, j, velocities=velocities)
    (found,) = [finding for finding in findings(case) if finding.severity == "error"]
    columns = tomllib.loads(found.remedy)["columns"]
    assert found.code == "joint-order" and "effort" not in columns
    assert columns["q"].index(f"q{j + 1}") == i and columns["q"].index(f"q{i + 1}") == j
    assert ("dq" in columns) == (velocities and case.recording.dq is not None)
    assert told_after(case, found) == set()


def test_an_order_that_no_columns_can_name_is_told_by_hand():
    case = exchanged(sound(11), 1, 3)
    found = diagnose_recording(case.robot, replace(case.recording, columns={}), case.reading)
    assert [f.remedy for f in found if f.code == "joint-order"] == [
        "rewrite the log with the position channels in the order 1, 4, 3, 2, 5, 6, 7"
    ]


@pytest.mark.parametrize("joint", range(6))
def test_a_joint_that_counts_the_other_way_is_named(joint: int):
    case = sound(11)
    sign = np.ones(7)
    sign[joint] = -1.0
    dq = case.recording.dq
    turned = case.logged(q=case.recording.q * sign, dq=None if dq is None else dq * sign)
    (found,) = [finding for finding in findings(turned) if finding.severity == "error"]
    assert found.code == "position-sign" and found.channel == case.robot.joint_names[joint]
    assert tomllib.loads(found.remedy)["position_sign"] == sign.astype(int).tolist()


def test_where_the_last_joint_turns_nothing_but_itself_both_signs_are_said():
    case = sound(11)
    sign = np.array([1.0] * 6 + [-1.0])
    dq = case.recording.dq
    (found,) = of("torque-sign", case.logged(q=case.recording.q * sign, dq=None if dq is None else dq * sign))
    assert (
        "equally well with the opposite sign of positions, position_sign = [1, 1, 1, 1, 1, 1, -1]" in found.evidence
    )


def test_a_joint_in_degrees_alone_is_named():
    case = sound(11)
    q = case.recording.q.copy()
    q[:, 3] = np.degrees(q[:, 3])
    (found,) = [f for f in findings(replace(case.logged(q=q, dq=None))) if f.severity == "error"]
    assert found.code == "degrees" and tomllib.loads(found.remedy)["units"] == ["rad"] * 3 + ["deg"] + ["rad"] * 3


@pytest.mark.parametrize(("header", "scale"), [("deg", 1.0), ("rad", np.pi / 180)])
def test_a_header_with_the_wrong_unit_is_healed_by_the_remedy(header: str, scale: float, tmp_path: Path):
    case = sound(11)
    log, joints = case.recording, range(case.robot.n)
    assert log.time is not None and log.effort is not None
    table = {"t": log.time} | {f"q{j + 1} [{header}]": log.q[:, j] / scale for j in joints}
    write_csv(tmp_path / "log.csv", table | {f"tau{j + 1}": log.effort[:, j] for j in joints})

    told = partial(errors_in, tmp_path / "log.csv", case)
    (found,) = told(LogFormat())
    assert found.code == "degrees" and not told(LogFormat(units=tomllib.loads(found.remedy)["units"]))


def test_degrees_stay_degrees_without_a_torque_and_in_a_short_log():
    case = sound(11)
    degrees = case.logged(q=np.degrees(case.recording.q), dq=None)
    short = slice(0, 60)
    log = degrees.recording
    assert log.time is not None and log.effort is not None
    brief = replace(log, time=log.time[short], q=log.q[short], effort=log.effort[short], valid=True)
    for each in (replace(log, effort=None), brief):
        told = {f.code for f in diagnose_recording(case.robot, each, case.reading) if f.severity == "error"}
        assert "degrees" in told and "motor-side" not in told


@pytest.mark.parametrize("unit", [1e-3, 1e-6, 1e-9])
def test_a_clock_that_counts_no_seconds_is_named(unit: float):
    case = sound(4)
    assert case.recording.time is not None
    (found,) = [f for f in findings(case.logged(time=case.recording.time / unit)) if f.severity == "error"]
    assert found.code == "clock-unit" and tomllib.loads(found.remedy)["time_unit"] == unit


@pytest.mark.parametrize(
    ("header", "unit"),
    [
        ("timestamp_ms", 1.0),
        ("t_us", 1.0),
        ("t_ns", 1.0),
        ("t_us", 1e-3),
        ("t_ms", 1e-6),
        ("t_us", 1e-9),
        ("t_s", 1e-3),
    ],
)
def test_the_unit_of_a_clock_replaces_that_of_its_header(tmp_path: Path, header: str, unit: float):
    case = sound(4)
    log, joints = case.recording, range(case.robot.n)
    assert log.time is not None and log.effort is not None
    table = {header: log.time / unit} | {f"q{j + 1}": log.q[:, j] for j in joints}
    write_csv(tmp_path / "log.csv", table | {f"tau{j + 1}": log.effort[:, j] for j in joints})

    told = partial(errors_in, tmp_path / "log.csv", case)
    (found,) = told(LogFormat())
    assert found.code == "clock-unit" and tomllib.loads(found.remedy)["time_unit"] == pytest.approx(unit, rel=1e-9)
    assert not told(LogFormat(time_unit=tomllib.loads(found.remedy)["time_unit"]))


def test_a_clock_is_looked_at_where_there_is_no_effort():
    case = FAULTS["clock-gap"](4)
    found = diagnose_recording(case.robot, replace(case.recording, effort=None), case.reading)
    assert "clock-gap" in {f.code for f in found}


def test_a_delay_is_told_to_a_fifth_of_a_sample():
    case = FAULTS["channel-delay"](54)
    (found,) = of("channel-delay", case)
    assert delay_error(case, found.remedy) < 0.2


# What a reading says already stays said ------------------------------------------------------------------------


def test_a_remedy_goes_on_top_of_what_the_reading_says():
    reading = LogFormat(exclude=[[1.0, 2.0]], columns={"effort": "i{}"})
    assert excluding(reading, [(5.00001, 5.5), (1.5, 2.25)]) == "exclude = [[1.0, 2.25], [5.0, 5.5]]"
    assert naming(reading, {"dq": ""}) == 'columns = { effort = "i{}", dq = "" }'
    assert lines("in [model]", terms=("viscous",)) == 'terms = ["viscous"]  # in [model]'


def test_signs_and_units_are_those_of_the_reading_turned():
    case = sound(11)
    assert case.recording.effort is not None
    read = replace(case.reading, torque_sign=[1, 1, 1, -1, 1, 1, 1])
    (found,) = [f for f in diagnose_recording(case.robot, case.recording, read) if f.severity == "error"]
    assert found.remedy == "torque_sign = 1"


# Where they belong ---------------------------------------------------------------------------------------------


def study() -> Study:
    return Study(
        RobotChoice("panda"), ModelChoice(("rigid-body",)), (RecordingChoice("a.csv"), RecordingChoice("b.csv"))
    )


@pytest.mark.parametrize(
    ("remedy", "table"),
    [
        ("torque_sign = -1", "recording"),
        ("gravity = [0.0, 0.0, 9.81]  # in [robot]", "robot"),
        ('terms = ["rigid-body", "rotor-inertia"]  # in [model]', "model"),
        ("saturation = 0.98  # in [processing]", "processing"),
        ("friction_per_recording = true  # in [estimation]", "estimation"),
    ],
)
def test_keys_find_their_table_and_only_the_recording_concerned_changes(remedy: str, table: str):
    (home,) = tables_of(Remedy.read(remedy))
    assert home == table
    after = applied(study(), "b.csv", Remedy.read(remedy))
    changed = after.recordings[1].reading != study().recordings[1].reading
    assert changed or getattr(after, table) != getattr(study(), table)
    assert repr(after.recordings[0]) == repr(study().recordings[0])


@pytest.mark.parametrize("remedy", ["record it again", "columns = { effort = [column 1] }"])
def test_what_is_no_line_of_a_study_has_no_keys(remedy: str):
    assert tables_of(remedy) == tables_of(Remedy.read(remedy)) == {}


@pytest.mark.parametrize(
    ("remedy", "said"),
    [
        ("rate = 50.0  # Hz", "--rate 50"),
        ("torque_sign = -1", "--torque-sign -1"),
        ("gravity = [0.0, 0.0, 9.81]  # in [robot]", "--gravity 0 0 9.81"),
        ('terms = ["rigid-body", "viscous"]  # in [model]', "--terms rigid-body,viscous"),
        ('units = "deg"', "--units deg"),
        ('columns = { time = "Zeit [ms]", q = ["a", "b"] }', "--columns 'time=Zeit [ms]' --columns q=a,b"),
        ('columns = { q = ["a,b", "c"] }', "--columns 'q=\"a,b\",c'"),
        ("slow = 0.05", "--slow 0.05"),
        ("torque_sign = [1, -1]", None),
        ("joint_offset = [0.1]", None),
        ("record it again", None),
    ],
)
def test_the_command_line_has_an_option_for_it_or_none(remedy: str, said: str | None):
    assert as_option(Remedy.read(remedy)) == said


def test_a_whole_study_says_what_no_option_does():
    hanging = replace(study(), robot=RobotChoice("panda", gravity=(0.0, 0.0, 9.81)))
    found = parse_study(tomllib.loads(as_study(lines(exclude=[[1.0, 2.0]]), hanging, "a.csv", {"rate": 50.0})))
    assert found.model.terms == ("rigid-body",)
    assert found.robot.gravity == (0.0, 0.0, 9.81)
    assert found.recordings[0].reading.exclude == ((1.0, 2.0),) and found.recordings[0].reading.rate == 50.0


def test_a_whole_study_keeps_the_caveat_of_a_remedy():
    remedy = lines("use the maker's values", drive_gain=[2.0, 3.0], drive_gain_deviation=[0.3, 0.7])
    text = as_study(remedy, study(), "a.csv", {})
    assert text.endswith("drive_gain_deviation = [0.3, 0.7]  # use the maker's values")
    assert parse_study(tomllib.loads(text)).recordings[0].reading.drive_gain is not None


@pytest.mark.parametrize(
    ("remedy", "said"),
    [
        ("slow = 0.05", "--slow 0.05; in a study: slow = 0.05"),
        ("rate = 50.0  # Hz", "in a study: rate = 50.0  # Hz"),  # where the command has no such option
        ("delay = 0.1", "in a study: delay = 0.1"),
        ("record it again.", "record it again."),
        (
            'They do not count; standstill = "keep" counts them.',
            'They do not count; --standstill keep (in a study: standstill = "keep") counts them.',
        ),
        (
            "rename with joints = { name in the recording = robot joint }.",
            "rename with joints = { name in the recording = robot joint }.",
        ),
    ],
)
def test_at_the_prompt_options_of_the_command_go_before_keys_of_a_study(remedy: str, said: str):
    assert at_the_prompt(Remedy.read(remedy), ("slow", "standstill")) == said


@pytest.mark.parametrize(
    ("remedy", "said"),
    [
        ("delay = 0.1", "--reading 'delay = 0.1'"),
        ('units = "deg"', "--reading 'units = \"deg\"'"),
        ("rate = 50.0", "--rate 50"),
        ("drive_gain = [2.0, 3.0]  # the maker's", "--reading 'drive_gain = [2.0, 3.0]'; the maker's"),
        ("Give drive_gain = 1 and a deviation.", "Give --reading 'drive_gain = 1' and a deviation."),
        ("cutoff = 5.0  # in [processing]", "in a study: cutoff = 5.0  # in [processing]"),
    ],
)
def test_a_command_that_reads_like_a_run_takes_any_line_of_a_recording(remedy: str, said: str):
    assert at_the_prompt(Remedy.read(remedy), ("rate", "reading")) == said


def test_torque_beyond_its_limit_is_no_saturation():
    """One drive in mN·m: leaving out what is beyond the limit would leave nearly nothing of that joint."""
    case = sound(4)
    assert case.recording.effort is not None
    effort, j = case.recording.effort.copy(), 1
    limit = 1.3 * float(np.abs(effort[:, j]).max())
    joints = tuple(replace(each, effort_limit=limit) if k == j else each for k, each in enumerate(case.robot.joints))
    effort[:, j] *= 1000.0
    robot = replace(case.robot, joints=joints)
    found = diagnose_recording(robot, case.logged(effort=effort).recording, case.reading)
    (beyond,) = [each for each in found if each.code == "torque-beyond-limit"]
    assert beyond.channel == robot.joint_names[j] and "drive_gain" in beyond.remedy
    assert not [each for each in found if each.code == "saturation" and each.channel == robot.joint_names[j]]


def test_samples_at_a_plateau_are_left_out_unless_the_study_keeps_them():
    case = sound(11)
    assert case.recording.effort is not None
    effort = case.recording.effort.copy()
    for j in (1, 3):
        level = np.quantile(np.abs(effort[:, j]), 0.9)
        effort[:, j] = np.clip(effort[:, j], -level, level)
    clipped = case.logged(effort=effort)
    found = of("saturation", clipped)
    assert [each.severity for each in found] == ["warning"] * 2 and all("not used" in each.evidence for each in found)
    keeping = ProcessingOptions(saturation="keep")
    kept = diagnose_recording(case.robot, clipped.recording, case.reading, processing=keeping)
    assert [each.severity for each in kept if each.code == "saturation"] == ["error"] * 2
