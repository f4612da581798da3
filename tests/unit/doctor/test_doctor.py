"""The doctor on virtual arms: each check fires on its fault and is silent on the sound log."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from armid.doctor import CHECKS, LogEvidence, effects, explanations_of
from armid.doctor.check_input import Explanation
from armid.doctor.checks.dynamics import joint_order
from armid.doctor.checks.dynamics.excitation_weak import poorly_determined
from armid.doctor.checks.dynamics.gravity_direction import explain as explain_gravity
from armid.doctor.checks.dynamics.position_offset import offsets_of
from armid.doctor.checks.signals import velocity_mismatch
from armid.doctor.fitted_log import LogState
from armid.doctor.quick_fit import solve
from armid.doctor.remedy_trial import heldout_error
from armid.errors import Finding
from armid.excitation.fourier import Excitation
from armid.lab.known_arms import truth_of
from armid.lab.options import Arm, LabOptions
from armid.lab.sensors import Sensing, SensorChannel
from armid.lab.simulation import simulate
from armid.maths.signals.resampling import resample
from armid.measurement.convention_conversion import to_robot_convention
from armid.measurement.log_format import LogFormat
from armid.robot import load_robot
from armid.study.diagnosis import diagnose_recording
from armid.study.remedy_translation import tables_of
from gantries import gantry
from healing import delay_error
from sick import FAULTS, Case, sound

SAME_FIT = 1e-6
"""Two orders of orthogonal reductions of one table: ε times a condition number of at most 1e9."""

SEEDS = (4, 11)  # a UR10e and an iiwa 14


@cache
def sound_findings(seed: int) -> tuple[Finding, ...]:
    return examined(sound(seed))


def examined(case: Case) -> tuple[Finding, ...]:
    return diagnose_recording(case.robot, case.recording, case.reading)


def codes(findings: tuple[Finding, ...], *severities: str) -> set[str]:
    return {f.code for f in findings if not severities or f.severity in severities}


def state_of(case: Case) -> LogState:
    log = to_robot_convention(case.recording, case.reading, case.robot).recording
    state = LogEvidence(case.robot, case.recording, case.reading, log).state
    assert state is not None
    return state


@pytest.mark.parametrize("seed", SEEDS)
def test_a_sound_log_raises_no_alarm(seed: int):
    assert codes(sound_findings(seed), "error", "warning") == set()


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_is_named_and_no_other_called_an_error(fault: str):
    found = examined(FAULTS[fault](4))
    severities = ("error", "warning") if fault == "excitation-weak" else ()  # as information sound logs have it, too
    assert fault in codes(found, *severities)
    assert fault not in codes(sound_findings(4), *severities)
    assert codes(found, "error") <= {fault}


def test_findings_come_with_numbers_an_effect_and_a_remedy():
    for fault in ("position-offset", "contact"):
        for finding in examined(FAULTS[fault](4)):
            assert any(c.isdigit() for c in finding.evidence), finding
            assert finding.remedy and effects()[finding.code], finding


def test_a_long_rest_is_not_proposed_for_exclusion():
    """Rests of the whole arm show its weight; leaving them out takes information away."""
    case = FAULTS["torque-sign"](0)
    log = case.recording
    assert log.time is not None and log.effort is not None
    step = float(np.diff(log.time).mean())
    start, still = log.samples // 3, int(2.0 / step)
    held = np.concatenate([np.arange(start), np.full(still, start), np.arange(start, log.samples)])
    effort = log.effort[held] + 1e-3 * np.random.default_rng(0).normal(size=(len(held), log.n))
    time = log.time[0] + step * np.arange(len(held))
    resting = replace(log, time=time, q=log.q[held], dq=None, ddq=None, effort=effort, valid=log.valid[held])
    (found,) = (f for f in diagnose_recording(case.robot, resting, case.reading) if f.code == "standstill")
    assert found.severity == "info" and "exclude" not in found.remedy and "they show gravity" in found.evidence


def test_errors_come_first():
    found = examined(FAULTS["torque-sign"](0))
    assert [f.severity for f in found] == sorted((f.severity for f in found), key=("error", "warning", "info").index)


def test_signs_are_those_of_the_joints():
    case = FAULTS["torque-sign"](2)
    (found,) = (f for f in examined(case) if f.code == "torque-sign")
    assert found.remedy == "torque_sign = [" + ", ".join(str(int(s)) for s in case.truth["sign"]) + "]"


def test_the_remedy_heals():
    case = FAULTS["torque-sign"](2)
    read = replace(case.reading, torque_sign=case.truth["sign"])
    assert "torque-sign" not in codes(diagnose_recording(case.robot, case.recording, read))


@pytest.mark.parametrize("seed", [4, 5, 0, 8, 63001, 63011])
def test_a_delay_is_found_to_a_fifth_of_a_sample(seed: int):
    """Also at 500 Hz and 1 kHz, where noise in the band of the motion alone hides a fifth of a sample."""
    case = FAULTS["channel-delay"](seed)
    (found,) = (f for f in examined(case) if f.code == "channel-delay")
    assert delay_error(case, found.remedy) < 0.2


@pytest.mark.parametrize("late", [0, 8, 40])
def test_joints_that_stick_at_reversals_do_not_change_a_delay(late: int):
    """Delay of a slow log in ms; torque passes from one bound of friction to the other while a joint stands."""
    rng = np.random.default_rng(3)
    a, b = 0.15 * rng.normal(size=(2, 6, 5))
    robot = load_robot("ur10e")
    sensing = Sensing(rate=500.0, effort=SensorChannel(noise=0.3, delay=1e-3 * late))
    options = LabOptions(arm=Arm(effects=("stribeck",)), sensing=sensing)
    log = simulate(truth_of(robot), Excitation(2 * np.pi / 20.0, a, b, np.zeros(6)), options, seed=1).recording
    found = [f for f in diagnose_recording(robot, log, LogFormat()) if f.code == "channel-delay"]
    assert len(found) == (late > 0)
    for each in found:
        told, deviation = re.findall(r"([\d.]+) ± ([\d.]+) ms", each.evidence)[0]
        # Three deviations, and half of the last digit; friction at reversals would change it by 3 ms.
        assert float(told) == pytest.approx(late, abs=3.0 * float(deviation) + 0.005)
        assert float(deviation) < 0.5


def test_an_offset_is_found_in_its_joint_and_with_its_sign():
    case = FAULTS["position-offset"](10)
    offset, deviation, _ = offsets_of(state_of(case))
    j = int(np.argmax(np.abs(case.truth["offset"])))
    assert offset[j] == pytest.approx(-case.truth["offset"][j], abs=4 * deviation[j] + 0.03)


def test_a_tilt_is_found_to_a_degree():
    case = FAULTS["gravity-direction"](0)
    found = explain_gravity(state_of(case))
    assert found is not None
    g, true = found.after.model.robot.gravity, case.truth["gravity"]
    assert np.degrees(np.arccos(g @ true / np.linalg.norm(g) / np.linalg.norm(true))) < 1.0


def test_conflict_between_joints_is_what_wrong_geometry_makes_and_noise_does_not():
    assert state_of(sound(5)).conflict < 0.25 < state_of(FAULTS["joint-order"](5)).conflict


def test_two_faults_are_told_apart():
    case = FAULTS["torque-sign"](0)
    assert case.recording.effort is not None
    late = np.roll(case.recording.effort, round(0.02 / float(case.motion.time[1])), axis=0)
    found = examined(case.logged(effort=late))
    assert codes(found, "error") == {"torque-sign", "channel-delay"}


def test_a_reversed_velocity_is_not_a_scaled_one():
    texts: dict[int, str] = {}
    for case in (FAULTS["velocity-mismatch"](seed) for seed in range(8)):
        log = to_robot_convention(case.recording, case.reading, case.robot).recording
        (found, *_) = velocity_mismatch.check(LogEvidence(case.robot, case.recording, case.reading, log))
        texts[case.truth["kind"]] = found.evidence
    assert "opposite sign" in texts[0] and "times" in texts[1] and "lag" in texts[3]


def test_a_log_with_nan_is_an_error_and_not_a_crash():
    case = sound(4)
    q = case.recording.q.copy()
    q[10, 2] = np.nan
    assert codes(examined(case.logged(q=q)), "error") == {"value-missing"}


def test_an_empty_channel_is_told_as_such_with_what_to_do():
    case = sound(4)
    assert case.recording.effort is not None
    effort = case.recording.effort.copy()
    effort[:, 2] = np.nan
    (found,) = [each for each in examined(case.logged(effort=effort)) if each.code == "value-missing"]
    assert "effort of" in found.evidence and "is empty: no row has a number" in found.evidence
    assert "lock" in found.remedy and "rows" not in found.remedy


def test_every_code_has_an_effect_and_every_explanation_a_check():
    assert set(FAULTS) <= effects().keys()
    assert len(explanations_of()) <= len(CHECKS)


def test_what_could_not_be_looked_at_is_said():
    log = sound(4).recording
    assert log.time is not None and log.effort is not None
    rows = slice(0, 60)
    short = replace(log, time=log.time[rows], q=log.q[rows], dq=None, effort=log.effort[rows], valid=True)
    (found,) = diagnose_recording(sound(4).robot, short, LogFormat())
    assert "not checked" in found.evidence
    assert codes(diagnose_recording(sound(4).robot, replace(log, effort=None), LogFormat())) == {"effort-missing"}


@pytest.mark.parametrize("pushes", [1, 2, 3])
def test_pushes_are_found_however_many_they_are(pushes: int):
    case = sound(4)
    assert case.recording.effort is not None
    time = case.motion.time
    limits = np.array([joint.effort_limit for joint in case.robot.joints])
    places = np.linspace(0.2, 0.8, pushes) * time[-1]
    push = sum(np.exp(-0.5 * ((time - at) / 0.25) ** 2)[:, None] for at in places)
    found = examined(case.logged(effort=case.recording.effort + 0.2 * limits * push))
    (contact,) = [each for each in found if each.code == "contact"]
    assert contact.remedy.count("], [") == pushes - 1
    assert codes(found, "error") == set()


def test_what_is_left_out_already_is_no_push():
    case = sound(4)
    assert case.recording.effort is not None and case.recording.time is not None
    time = case.recording.time
    bad = (time > 8.0) & (time < 8.5)
    effort = case.recording.effort + 200.0 * bad[:, None]
    valid = case.recording.valid & ~bad[:, None]
    assert "contact" not in codes(
        examined(replace(case, recording=replace(case.recording, effort=effort, valid=valid)))
    )


def test_an_arm_of_one_joint_says_between_which_directions_it_cannot_tell():
    others = [f"A{k}" for k in range(1, 8) if k != 2]
    robot = load_robot("iiwa14-r820", locked=others)
    case = sound(1, robot=robot)
    assert codes(examined(case), "error") == set()
    lying = replace(case, robot=robot.with_gravity((0.0, 9.81, 0.0)))
    (found,) = (f for f in examined(lying) if f.severity == "error")
    assert found.code == "gravity-direction" and found.remedy.startswith("find out how the arm is mounted: ")
    assert "gravity = [0.0, 0.0, -9.81]" in found.remedy


def test_a_planar_arm_that_lies_is_no_arm_in_another_order():
    robot = load_robot("iiwa14-r820", locked=["A1", "A3", "A5", "A7"])
    lying = replace(sound(1, robot=robot), robot=robot.with_gravity((0.0, 9.81, 0.0)))
    (found,) = (f for f in examined(lying) if f.severity == "error")
    assert found.remedy == "gravity = [0.0, 0.0, -9.81]  # in [robot]"


@pytest.mark.parametrize("sign", [(1, 1), (1, -1), (-1, 1), (-1, -1)])
def test_joints_that_do_not_feel_each_other_have_signs_of_their_own(tmp_path: Path, sign: tuple[int, int]):
    case = sound(2, robot=gantry(tmp_path, second=0.5))
    assert case.recording.effort is not None
    errors = [f for f in examined(case.logged(effort=case.recording.effort * sign)) if f.severity == "error"]
    told = {(1, 1): [], (-1, -1): ["torque_sign = -1"]}.get(sign, [f"torque_sign = [{sign[0]}, {sign[1]}]"])
    assert [f.remedy for f in errors] == told


def test_a_row_counts_in_another_order_where_motion_and_torque_of_a_joint_do():
    log = state_of(sound(4)).log
    channels = np.arange(log.mask.shape[1])
    bad = replace(log.runs[0], mask=log.runs[0].mask & (channels != 1))  # one of both channels
    marked = replace(log, runs=(bad, *log.runs[1:]))
    order = np.array([2, 1, 0, *channels[3:]])
    order[[1, 3]] = order[[3, 1]]
    for motion, torque, out in ((channels, channels, {1}), (order, order, {3}), (order, channels, {1, 3})):
        counted = marked.reordered(motion, torque).runs[0].mask.any(axis=0)
        assert set(np.flatnonzero(~counted)) == out


@pytest.mark.parametrize("seed", [62000, 62004])
def test_an_order_is_no_rival_of_itself(seed: int):
    (found,) = (f for f in examined(FAULTS["joint-order"](seed)) if f.code == "joint-order")
    assert "% smaller." in found.evidence and "the log does not say" not in found.evidence


def test_a_zero_that_only_the_description_asks_for_is_no_error():
    """A sound log whose wrist is heavier than described, so that another zero of it would leave one percent less."""
    assert codes(examined(sound(1039)), "error", "warning") == set()


def test_a_condition_number_that_is_rounding_is_not_told_as_a_number():
    assert poorly_determined(("FV_1",), np.ones(1), 1e9).endswith("at all, within numerical precision.")


def test_where_orders_tie_nothing_is_called_an_error(tmp_path: Path):
    """Axes that do not feel each other: exchanged torques look like exchanged positions."""
    case = sound(2, robot=gantry(tmp_path, first=0.5, second=0.5))
    assert case.recording.effort is not None
    found = [f for f in examined(case.logged(effort=case.recording.effort[:, ::-1])) if f.code == "joint-order"]
    assert [f.severity for f in found] in ([], ["info"])


@pytest.mark.parametrize("what", ["effort", "q"])
def test_channels_are_never_exchanged_across_kinds(what: str):
    """A SCARA whose quill slides between joints that turn, two of its channels exchanged all the same."""
    case = sound(3, robot=load_robot(Path(__file__).parents[2] / "tables/scara.toml"))
    values = getattr(case.recording, what)[:, [0, 1, 3, 2]]
    found = examined(case.logged(dq=None, **{what: values}))
    assert "joint-order" not in codes(found)


def test_no_joint_is_given_positions_that_it_cannot_reach():
    """Positions of two joints exchanged: put back where the limits of both allow it, and not where they do not."""
    case = sound(4)
    order = [0, 2, 1, 3, 4, 5]
    mixed = case.logged(q=case.recording.q[:, order], dq=None)
    assert [f.channel for f in examined(mixed) if f.code == "joint-order"] == [", ".join(case.robot.joint_names[1:3])]
    joints = list(case.robot.joints)
    low, high = mixed.recording.q[:, 1].min(), mixed.recording.q[:, 1].max()
    joints[1] = replace(joints[1], position_limits=np.array([low, low + 0.6 * (high - low)]))
    shorter = replace(case.robot, joints=tuple(joints))
    low, high = mixed.recording.q[:, 2].min(), mixed.recording.q[:, 2].max()
    assert low < joints[1].position_limits[0] - 0.5 or high > joints[1].position_limits[1] + 0.5
    for name, state in (("wide", state_of(mixed)), ("short", state_of(replace(mixed, robot=shorter)))):
        found = joint_order.explain(state)
        moved = found is not None and found.channel == ", ".join(case.robot.joint_names[1:3])
        assert moved == (name == "wide"), name


def test_stamps_of_samples_taken_unevenly_are_used_and_nothing_is_to_do():
    case = sound(4)
    time, rng = case.recording.time, np.random.default_rng(1)
    assert time is not None and case.recording.effort is not None
    step = time[1] - time[0]
    then = time[8:-8]
    then = then + 3 * step * np.sin(2 * np.pi * then / 5.0) + 0.3 * step * rng.uniform(-1, 1, len(then))
    log = {name: resample(time, getattr(case.recording, name), then) for name in ("q", "effort")}
    found = [f for f in examined(case.logged(time=then, dq=None, valid=True, **log)) if f.code == "clock-jitter"]
    assert [(f.severity, f.remedy) for f in found] == [("info", "")]
    assert "nothing to do" in found[0].evidence


def test_missing_rows_are_counted():
    case = sound(4)
    log = case.recording
    kept = np.arange(log.samples) % 37 != 20
    assert log.time is not None and log.effort is not None
    dropped = case.logged(time=log.time[kept], q=log.q[kept], dq=None, effort=log.effort[kept], valid=True)
    (found,) = [f for f in examined(dropped) if f.code == "clock-jitter"]
    assert f"about {(~kept).sum()} rows are missing" in found.evidence


def test_an_explanation_that_makes_left_out_motion_worse_is_not_believed():
    case = sound(4)
    log = to_robot_convention(case.recording, case.reading, case.robot).recording

    def wrong(state: LogState) -> Explanation:
        after = state.with_torque(np.where(np.arange(state.rows.n) == 1, -1.0, 1.0))
        return Explanation("torque-sign", 1.0, "error", "", "Wrong.", lambda _: "torque_sign = -1", after)

    def right(state: LogState) -> Explanation:
        return Explanation("contact", 0.5, "warning", "", "Right.", lambda _: "exclude = []", state)

    found = LogEvidence(case.robot, case.recording, case.reading, log, explains=(wrong, right)).explanations
    assert [each.code for each in found] == ["contact"]


@pytest.mark.parametrize("fault", sorted(FAULTS))
def test_a_remedy_says_what_left_out_motion_says_of_it(fault: str):
    for finding in examined(FAULTS[fault](4)):
        if tables_of(finding.remedy):
            assert "eft-out motion" in finding.evidence, finding


def test_rows_that_are_left_out_judge_and_rows_that_are_fitted_do_not():
    """Parameters without meaning explain what they are fitted to and nothing else."""
    rows = state_of(sound(4)).rows
    noise = np.random.default_rng(0).normal(size=(40, len(rows.torque)))
    more = replace(
        rows,
        columns=tuple(np.vstack([own, noise]) for own in rows.columns),
        parameters=tuple(
            np.concatenate([own, np.arange(rows.count, rows.count + 40, dtype=np.int32)]) for own in rows.parameters
        ),
        count=rows.count + 40,
    )
    assert solve(more).cost < solve(rows).cost
    assert heldout_error(more) > heldout_error(rows)


@pytest.mark.parametrize("seed", range(3))
def test_the_factor_of_all_joints_gives_the_separate_fit_of_each(seed: int):
    state = state_of(sound(seed))
    for fit in state.joint_fits:
        alone = solve(fit.rows)
        np.testing.assert_allclose(fit.sigma, alone.sigma, rtol=SAME_FIT)
        np.testing.assert_allclose(fit.residual, alone.residual, atol=SAME_FIT * alone.sigma[0])


PENDULUM = "".join(
    f"""<link name="{child}"><inertial><origin xyz="0 0 0.05"/><mass value="0.2"/>
  <inertia ixx="2e-4" iyy="2e-4" izz="2e-5" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="{name}" type="continuous"><parent link="{parent}"/><child link="{child}"/>
  <origin xyz="0 0 0.1"/><axis xyz="0 1 0"/></joint>"""
    for name, parent, child in (("first", "stand", "upper"), ("second", "upper", "lower"))
)
"""Two light links with the friction of heavy ones: in closed loop it gives way before it slides."""


@pytest.mark.parametrize(
    ("position", "told"),
    [(SensorChannel(noise=1e-5), {"sticking"}), (SensorChannel(noise=2e-4, resolution=2 * np.pi / 4096), set())],
)
def test_friction_that_gives_way_is_no_delay(tmp_path: Path, position: SensorChannel, told: set[str]):
    """Also where noise of coarse encoders hides that joints stick, and leaves no room for a wider band."""
    path = tmp_path / "pendulum.urdf"
    path.write_text(f'<robot name="pendulum"><link name="stand"/>{PENDULUM}</robot>')
    robot = load_robot(path)
    a, b = 0.2 * np.random.default_rng(8).normal(size=(2, 2, 5))
    sensing = Sensing(rate=250.0, position=position, effort=SensorChannel(noise=0.03))
    plan = Excitation(2 * np.pi / 10.0, a, b, np.zeros(2))
    log = simulate(truth_of(robot), plan, LabOptions(repetitions=2, sensing=sensing), seed=1).recording
    # It mostly stands, which is said if it is seen; nothing is wrong with the log.
    assert codes(diagnose_recording(robot, log, LogFormat()), "error", "warning") == told
