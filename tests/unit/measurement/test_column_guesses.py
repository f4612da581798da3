"""Meanings of the names of columns, by a table of the headers that people write."""

import re
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from armid.errors import RecordingError
from armid.measurement.columns.column_guessing import ClockRequest, Guess, guess_columns
from armid.measurement.columns.column_name_parsing import clock_of, column_unit, named
from armid.measurement.columns.unread import effort_possible, pattern_of
from armid.measurement.convention_conversion import to_robot_convention, understood
from armid.measurement.log_format import LogFormat
from armid.measurement.readers import load_recording
from armid.robot.robot import Frame, Joint, Link, Robot
from recordings import write_csv

ALL = ("time", "q", "dq", "ddq", "effort")
JOINTS = ("turn", "lift", "Elbow")


def each(*forms: str, of=(1, 2, 3)) -> list[str]:
    """Columns of some forms, one for each number or joint."""
    return [form.format(k) for form in forms for k in of]


ZERO = (0, 1, 2)

HEADERS = {
    "q1": (["t", *each("q{}", "tau{}")], {"time": ["t"], "q": each("q{}"), "effort": each("tau{}")}),
    "q_0": (each("q_{}", "qd_{}", of=ZERO), {"q": each("q_{}", of=ZERO), "dq": each("qd_{}", of=ZERO)}),
    "q[0]": (
        each("q[{}]", "effort[{}]", of=ZERO),
        {"q": each("q[{}]", of=ZERO), "effort": each("effort[{}]", of=ZERO)},
    ),
    "joint1_pos": (each("joint{}_pos", "joint{}_vel"), {"q": each("joint{}_pos"), "dq": each("joint{}_vel")}),
    "Joint1Pos": (
        ["Time", *each("Joint{}Pos", "Joint{}Torque")],
        {"time": ["Time"], "q": each("Joint{}Pos"), "effort": each("Joint{}Torque")},
    ),
    "pos_joint_1": (
        each("pos_joint_{}", "speed_joint_{}"),
        {"q": each("pos_joint_{}"), "dq": each("speed_joint_{}")},
    ),
    "turn_position": (
        each("{}_position", "{}_torque", of=("Elbow", "turn", "lift")),
        {"q": each("{}_position", of=JOINTS), "effort": each("{}_torque", of=JOINTS)},
    ),
    "turn_1_pos": (  # with an index beside the name of each joint
        [
            "Elbow_3_pos",
            "turn_1_pos",
            "lift_2_pos",
            *each("{}_torque", of=("turn_joint_4", "lift_joint_5", "Elbow_joint_6")),
        ],
        {
            "q": ["turn_1_pos", "lift_2_pos", "Elbow_3_pos"],
            "effort": ["turn_joint_4_torque", "lift_joint_5_torque", "Elbow_joint_6_torque"],
        },
    ),
    "position.turn": (
        each("position.{}", "effort.{}", of=JOINTS),
        {"q": each("position.{}", of=JOINTS), "effort": each("effort.{}", of=JOINTS)},
    ),
    "plotjuggler": (
        [
            "__time",
            *each("/joint_states/{}/position", "/joint_states/{}/velocity", "/joint_states/{}/effort", of=JOINTS),
        ],
        {
            "time": ["__time"],
            "q": each("/joint_states/{}/position", of=JOINTS),
            "dq": each("/joint_states/{}/velocity", of=JOINTS),
            "effort": each("/joint_states/{}/effort", of=JOINTS),
        },
    ),
    "armid's own plan": (
        ["t", *each("q_{}", "dq_{}", "ddq_{}", of=JOINTS)],
        {
            "time": ["t"],
            "q": each("q_{}", of=JOINTS),
            "dq": each("dq_{}", of=JOINTS),
            "ddq": each("ddq_{}", of=JOINTS),
        },
    ),
    "a joint in capitals": (
        each("POS {}", of=("TURN", "LIFT", "ELBOW")),
        {"q": each("POS {}", of=("TURN", "LIFT", "ELBOW"))},
    ),
    "UR RTDE": (
        [
            "timestamp",
            *each(
                "target_q_{}",
                "actual_q_{}",
                "actual_qd_{}",
                "target_qdd_{}",
                "actual_current_{}",
                "target_moment_{}",
                "actual_TCP_pose_{}",
                "joint_temperatures_{}",
                of=ZERO,
            ),
        ],
        {
            "time": ["timestamp"],
            "q": each("actual_q_{}", of=ZERO),
            "dq": each("actual_qd_{}", of=ZERO),
            "effort": each("actual_current_{}", of=ZERO),
        },
    ),
    "libfranka": (
        each(
            "q_{}",
            "q_d_{}",
            "dq_{}",
            "dq_d_{}",
            "ddq_d_{}",
            "tau_J_{}",
            "tau_J_d_{}",
            "dtau_J_{}",
            "theta_{}",
            "tau_ext_hat_filtered_{}",
            "O_T_EE_{}",
            of=ZERO,
        ),
        {"q": each("q_{}", of=ZERO), "dq": each("dq_{}", of=ZERO), "effort": each("tau_J_{}", of=ZERO)},
    ),
    "RSI": (each("AIPos_A{}", "ASPos_A{}", "MACur_A{}"), {"q": each("AIPos_A{}"), "effort": each("MACur_A{}")}),
    "[deg]": (each("q{} [deg]", "tau{} (Nm)"), {"q": each("q{} [deg]"), "effort": each("tau{} (Nm)")}),
    "_deg": (
        ["t_ms", *each("q{}_deg", "current_{} [A]")],
        {"time": ["t_ms"], "q": each("q{}_deg"), "effort": each("current_{} [A]")},
    ),
    "q_deg_1": (each("q_deg_{}"), {"q": each("q_deg_{}")}),
    "time[us]": (["time[us]", *each("pos{}")], {"time": ["time[us]"], "q": each("pos{}")}),
    "seconds and nanoseconds": (
        ["header.stamp.sec", "header.stamp.nanosec", *each("position[{}]", of=ZERO)],
        {"time": ["header.stamp.sec", "header.stamp.nanosec"], "q": each("position[{}]", of=ZERO)},
    ),
    "header before recorder": (
        ["rosbagTimestamp", "header.stamp", *each("pos{}")],
        {"time": ["header.stamp"], "q": each("pos{}")},
    ),
    "Greek": (each("θ{}", "τ{}"), {"q": each("θ{}"), "effort": each("τ{}")}),
    "dots": (
        each("q{}", "q\u0307{}", "q\u0308{}"),
        {"q": each("q{}"), "dq": each("q\u0307{}"), "ddq": each("q\u0308{}")},
    ),
    "qDot": (each("q{}", "qDot{}"), {"q": each("q{}"), "dq": each("qDot{}")}),
    "another number in it": (
        each("robot2_q_{}", "robot2_tau_{}"),
        {"q": each("robot2_q_{}"), "effort": each("robot2_tau_{}")},
    ),
    "measured and desired": (each("pos_des_{}", "pos_act_{}"), {"q": each("pos_act_{}")}),
    "joint before motor": (each("motor{}_pos", "joint{}_pos"), {"q": each("joint{}_pos")}),
    "torque before current": (
        each("pos{}", "current{}", "torque{}"),
        {"q": each("pos{}"), "effort": each("torque{}")},
    ),
    "one torque too few": ([*each("pos{}"), "torque1", "torque2"], {"q": each("pos{}")}),
    "a grip beside the arm": ([*each("{}_pos", of=JOINTS), "finger_pos"], {"q": each("{}_pos", of=JOINTS)}),
    # What must not be guessed:
    "a joint missing": (each("{}_pos", of=JOINTS[:2]), {}),
    "a pose": ([*each("tcp_pos_{}", "ee_position_{}"), "x", "y", "z"], {}),
    "temperatures": (["joint1_temp", "joint2_temp", "joint3_temp", "voltage_1", "voltage_2", "voltage_3"], {}),
    "errors": (each("q_error_{}", "tau_ext_{}", "position_limit_{}"), {}),
    "per cent": (each("torque{} [%]"), {}),
    "torques in degrees": (each("torque{} [deg]"), {}),
    "a gap": (["pos1", "pos3", "pos4"], {}),
    "desired velocities beside measured positions": (each("actual_q_{}", "target_qd_{}"), {"q": each("actual_q_{}")}),
    "a word that has t in it": (["settling_time", *each("pos{}")], {"q": each("pos{}")}),
}


@pytest.mark.parametrize("header", HEADERS)
def test_a_header(header):
    names, columns = HEADERS[header]
    guess = guess_columns(names, ALL, wanted=JOINTS)
    assert isinstance(guess, Guess)
    assert {quantity: list(found) for quantity, found in guess.columns.items()} == columns
    assert bool(guess.reasons) == bool(columns)
    shuffled = [names[k] for k in np.random.default_rng(3).permutation(len(names))]
    again = guess_columns(shuffled, ALL, wanted=JOINTS)
    assert isinstance(again, Guess) and again.columns == guess.columns


def rows_of_the_page() -> list[tuple[str, str]]:
    """Each example of docs/study.md with what it is said to be."""
    page = (Path(__file__).parents[3] / "docs" / "study.md").read_text(encoding="utf-8")
    table = page.split("| columns such as | are |", 1)[1].split("\n\n", 1)[0]
    rows = [row.strip("|").split("|") for row in table.splitlines()[2:]]
    return [(name, said.strip()) for names, said in rows for name in re.findall("`([^`]+)`", names)]


@pytest.mark.parametrize(("example", "said"), rows_of_the_page())
def test_the_page_says_what_is_guessed(example, said):
    """A column of the page stands for its joint; its neighbours differ in the number."""
    number = re.search(r"[01]", example)
    names = [example] if number is None else [example[: number.start()] + k + example[number.end() :] for k in "0123"]
    names = names if number is None else names[:3] if number[0] == "0" else names[1:]
    quantity = re.search("`(.*)`", said)
    beside = quantity is not None and quantity[1] == "command"  # it is one beside three columns of positions
    joints = [] if beside else ["joint_1", "joint_2", "joint_3"]
    quantities = ALL if quantity is None else [quantity[1]]
    guess = guess_columns(names, quantities, wanted=joints, channels=3 if beside else 0)
    assert isinstance(guess, Guess)
    assert {key: list(found) for key, found in guess.columns.items()} == (
        {} if quantity is None else {quantity[1]: names}
    )
    assert bool(guess.commanded) == ("commanded" in said)
    if "current" in said:
        assert named(names[0], ["joint_1"])[0].quantity == "current"


@pytest.mark.parametrize(
    ("names", "quantity"),
    [
        (each("left_q_{}", "right_q_{}"), "q"),
        (each("cmd_q_{}", "target_q_{}"), "q"),
        (each("q{}", "tau_meas_{}", "torque_actual_{}"), "effort"),
        (["Time", "Elapsed", *each("q{}")], "time"),
    ],
)
def test_two_that_are_as_good_are_a_question(names, quantity):
    question = guess_columns(names, ALL, wanted=JOINTS)
    assert isinstance(question, ClockRequest)
    assert question.quantity == quantity and len(question.sets) == 2


def test_only_commands_are_taken_and_said():
    guess = guess_columns(each("q_cmd_{}", "tau_meas_{}"), ALL, wanted=JOINTS)
    assert isinstance(guess, Guess) and guess.commanded == ("q",)
    assert "commanded and not measured" in "; ".join(guess.reasons)


def test_the_torque_that_was_left_lying_is_named():
    names, _ = HEADERS["UR RTDE"]
    guess = guess_columns(names, ALL, wanted=JOINTS)
    assert isinstance(guess, Guess)
    assert "actual_current_0, actual_current_1, actual_current_2, not target_moment_0" in guess.reasons[-1]


def test_matrices_have_no_numbers():
    names = ["stamp", "position", "velocity", "effort"]
    assert isinstance(flat := guess_columns(names, ALL), Guess) and "q" not in flat.columns
    whole = guess_columns(names, ALL, matrices=True)
    assert isinstance(whole, Guess) and whole.columns["q"] == ("position",)


def test_joints_that_are_held_come_along_where_all_have_them():
    names = each("{}_pos", "{}_tau", of=JOINTS)
    guess = guess_columns(names, ALL, wanted=JOINTS[1:], labels=JOINTS)
    assert isinstance(guess, Guess) and guess.joints == JOINTS
    guess = guess_columns(
        [*each("{}_pos", of=JOINTS), *each("{}_tau", of=JOINTS[1:])], ALL, wanted=JOINTS[1:], labels=JOINTS
    )
    assert isinstance(guess, Guess) and guess.joints == JOINTS[1:]


@pytest.mark.parametrize(
    ("column", "unit"),
    [
        ("q1 [deg]", ("deg", 1.0)),
        ("q1_deg", ("deg", 1.0)),
        ("dq1 (deg/s)", ("deg", 1.0)),
        ("qd1_rad_s", ("rad", 1.0)),
        ("acc [rad/s^2]", ("rad", 1.0)),
        ("acc [rad·s⁻²]", None),
        ("lift [mm]", ("m", 1e-3)),
        ("tau1 [N·m]", ("torque", 1.0)),
        ("tau1 (mNm)", ("torque", 1e-3)),
        ("i1 [mA]", ("current", 1e-3)),
        ("i1/A", ("current", 1.0)),
        ("cur 1 / mA", ("current", 1e-3)),
        ("tau1/mNm", ("torque", 1e-3)),
        ("tau 1 / N·m", ("torque", 1.0)),
        ("q1/deg", ("deg", 1.0)),
        ("dq1/rad/s", ("rad", 1.0)),
        ("larm1_ampere", ("current", 1.0)),
        ("tau_A1", None),
        ("tau/A1", None),
        ("axis_a", None),
        ("arm1/a", None),
        ("q[0]", None),
        ("q1", None),
    ],
)
def test_units_of_columns(column, unit):
    assert column_unit(column) == unit


@pytest.mark.parametrize(
    ("column", "unit"), [("t", None), ("t_ms", 1e-3), ("time (s)", 1.0), ("Time [µs]", 1e-6), ("stamp_ns", 1e-9)]
)
def test_units_of_clocks(column, unit):
    clock = clock_of(column)
    assert clock is not None and clock.unit == unit


N = 40
T = 0.01 * np.arange(N)
Q = np.sin(np.outer(np.arange(N), [0.11, 0.17, 0.23]) + np.array([0.1, 0.9, 2.0]))
TAU = Q**2 - 0.3 * Q


def arm() -> Robot:
    joints = tuple(
        Joint(name, "revolute", i - 1, [0.0, 0.0, 1.0], np.eye(4), [-3.0, 3.0]) for i, name in enumerate(JOINTS)
    )
    return Robot("arm", joints, tuple(Link(name) for name in JOINTS), Frame("tip", 2, np.eye(4)))


def table(q="q{}", tau="tau{}", time="t", of=(1, 2, 3), order=(0, 1, 2), scale=1.0, clock=1.0):
    named = [(form, values) for form, values in ((q, Q / scale), (tau, TAU)) if form]
    return {time: T / clock} | {form.format(of[k]): values[:, k] for form, values in named for k in order}


def read(path, robot=None, **reading):
    robot, how = robot or arm(), LogFormat(**reading)
    return to_robot_convention(load_recording(path, how, robot), how, robot)


def test_names_of_joints_choose_and_order_columns(tmp_path):
    path = write_csv(
        tmp_path / "run.csv", table("{}_position", "{} torque", "Time", JOINTS, (2, 0, 1)), delimiter=";"
    )
    result = read(path)
    np.testing.assert_array_equal(result.recording.q, Q)
    np.testing.assert_array_equal(result.recording.effort, TAU)
    np.testing.assert_array_equal(result.recording.time, T)
    (finding,) = (f for f in result.findings if f.code == "columns-guessed")
    said = tomllib.loads(finding.remedy)
    again = read(path, **said)  # what is pasted says the same, and nothing is guessed any more
    np.testing.assert_array_equal(again.recording.q, Q)
    assert not again.findings and finding.severity == "info"


def test_the_name_of_a_joint_wins_over_a_number_beside_it():
    """Names of joints with numbers of their own, and behind them the index: wrist_1_joint_4_pos."""
    joints = tuple(f"{name}_joint" for name in ("shoulder_pan", "elbow", "wrist_1", "wrist_2", "wrist_3"))
    names = [f"{joint}_{k}_{what}" for what in ("pos", "vel", "effort") for k, joint in enumerate(joints)]
    guess = guess_columns(names[::-1], ALL, wanted=joints, labels=joints)
    assert isinstance(guess, Guess)
    for quantity, what in (("q", "pos"), ("dq", "vel"), ("effort", "effort")):
        assert guess.columns[quantity] == tuple(f"{joint}_{k}_{what}" for k, joint in enumerate(joints))
    both = guess_columns([f"{j}_{k}_pos" for j in JOINTS for k in (1, 2)], ("q",), wanted=JOINTS, labels=JOINTS)
    assert isinstance(both, ClockRequest)  # two sensors on each joint


def test_a_part_of_the_joints_is_said_as_a_list(tmp_path):
    path = write_csv(tmp_path / "run.csv", table("{}_position", "{}_tau", of=JOINTS))
    robot = arm().lock({"turn": 0.0})
    result = read(path, robot)
    np.testing.assert_array_equal(result.recording.q, Q[:, 1:])
    (finding,) = (f for f in result.findings if f.code == "columns-guessed")
    said = tomllib.loads(finding.remedy)
    assert said["joints"] == list(JOINTS)
    np.testing.assert_array_equal(read(path, robot, **said).recording.q, Q[:, 1:])
    assert [f.channel for f in result.findings if f.code == "locked-joint"] == ["turn"]


def test_degrees_and_milliseconds_of_the_header_are_followed(tmp_path):
    degrees = np.pi / 180
    path = write_csv(tmp_path / "run.csv", table("q{} [deg]", "tau{} [Nm]", "t_ms", scale=degrees, clock=1e-3))
    result = read(path)
    np.testing.assert_allclose(result.recording.q, Q, rtol=1e-14)
    np.testing.assert_allclose(result.recording.time, T, rtol=1e-14)
    (finding,) = (f for f in result.findings if f.code == "columns-guessed")
    assert "q in deg" in finding.evidence and "time in ms" in finding.evidence
    said = tomllib.loads(finding.remedy)
    assert said["units"] == "deg" and said["time_unit"] == 1e-3
    np.testing.assert_allclose(read(path, **said).recording.q, Q, rtol=1e-14)
    np.testing.assert_allclose(read(path, units="deg").recording.q, Q, rtol=1e-14)


@pytest.mark.parametrize("units", ["rad", ["rad"] * 3])
def test_units_that_are_given_win_over_those_of_the_header(tmp_path, units):
    columns = table("q{} [deg]", "tau{} [Nm]", "t_ms") | {f"dq{k + 1} [deg/s]": TAU[:, k] for k in range(3)}
    path = write_csv(tmp_path / "run.csv", columns)
    result = read(path, units=units, time_unit=1.0)
    np.testing.assert_array_equal(result.recording.q, Q)
    np.testing.assert_array_equal(result.recording.dq, TAU)
    np.testing.assert_array_equal(result.recording.time, T)
    (finding,) = (f for f in result.findings if f.code == "units-of-header")
    assert finding.severity == "warning" and "units" not in finding.remedy
    assert "The key `units` is used, although the column name 'q1 [deg]' contains the unit deg." in finding.evidence
    assert "The key `time_unit` is used, although the column name 't_ms' contains the unit ms." in finding.evidence
    assert not any("in deg" in f.evidence for f in result.findings)


def test_degrees_that_are_given_win_over_radians_of_the_header(tmp_path):
    path = write_csv(tmp_path / "run.csv", table("q{}_rad", scale=np.pi / 180))
    np.testing.assert_allclose(read(path, units="deg").recording.q, Q, rtol=1e-14)


def test_velocities_may_have_another_unit_than_positions(tmp_path):
    columns = table("q{} [deg]", scale=np.pi / 180) | {f"dq{k + 1} [rad/s]": TAU[:, k] for k in range(3)}
    columns |= {f"tau{k + 1} [mNm]": 1e3 * TAU[:, k] for k in range(3)}
    for name in each("tau{}"):
        del columns[name]
    result = read(write_csv(tmp_path / "run.csv", columns))
    np.testing.assert_allclose(result.recording.q, Q, rtol=1e-14)
    np.testing.assert_allclose(result.recording.dq, TAU, rtol=1e-14)
    np.testing.assert_allclose(result.recording.effort, TAU, rtol=1e-14)


def test_amperes_are_currents(tmp_path):
    path = write_csv(tmp_path / "run.csv", table(tau="tau{} [A]"))
    with pytest.raises(RecordingError, match="the effort is a motor current"):
        read(path)
    np.testing.assert_allclose(read(path, drive_gain=[2.0, 2.0, 2.0]).recording.effort, 2.0 * TAU, rtol=1e-14)


@pytest.mark.parametrize(
    ("form", "ampere"),
    [
        *(
            (form, 1.0)
            for form in ("j{}_cur_A", "j{}_curr_A", "j{}_curr", "j{}_i_A", "I{}_A", "I_{}", "cur{}", "cur[{}]")
        ),
        *((form, 1.0) for form in ("iq{}", "Iq_{}_A", "iq{} [A]", "J{}.Iq", "amp{}", "j{}_amps_A", "Strom {} (A)")),
        *(
            (form, 1.0)
            for form in ("i{}/A", "j{} current / A", "tau_{}_A", "tau_{} (A)", "effort{}/A", "i_A{}", "i_A{}_A")
        ),
        *((form, 1e-3) for form in ("j{}_cur_mA", "I{}_mA", "i{}/mA", "cur{} (mA)", "iq{} [mA]", "tau{}_mA")),
    ],
)
def test_currents_are_known_by_word_or_unit(tmp_path, form, ampere):
    path = write_csv(tmp_path / "run.csv", table(tau=form))
    with pytest.raises(RecordingError, match="the effort is a motor current") as caught:
        read(path)
    assert caught.value.code == "current-without-gain" and form.format(1) in str(caught.value)
    np.testing.assert_allclose(read(path, drive_gain=[2.0] * 3).recording.effort, 2.0 * ampere * TAU, rtol=1e-14)
    named = read(path, columns={"effort": each(form)}, drive_gain=[1.0] * 3)
    np.testing.assert_allclose(named.recording.effort, ampere * TAU, rtol=1e-14)


@pytest.mark.parametrize("unit", ["_cur_A", "_i", "_iq", " [A]", " (A)", "_amp", "_amps", "/A"])
def test_currents_of_named_joints_are_known(tmp_path, unit):
    columns = table("{}_pos", f"{{}}{unit}", of=JOINTS) if unit != "/A" else table("{}_pos", "{} /A", of=JOINTS)
    with pytest.raises(RecordingError, match="the effort is a motor current"):
        read(write_csv(tmp_path / "run.csv", columns))


@pytest.mark.parametrize(
    ("q", "tau"),
    [
        ("q_A{}", "tau_A{}"),
        ("A{}_q", "A{}_tau"),
        ("axis_a{}_pos", "axis_a{}_torque"),
        ("pos_a_{}", "tau_a_{}"),
        ("q_{}_A", "tau_{}_A"),
        ("q{}-A", "tau{}-A"),
    ],
)
def test_an_a_in_the_name_of_a_joint_is_no_unit(tmp_path, q, tau):
    path = write_csv(tmp_path / "run.csv", table(q, tau))
    np.testing.assert_array_equal(read(path).recording.effort, TAU)


def test_a_joint_called_a_has_torque(tmp_path):
    joints = ("arm_A", "arm_I", "arm_Cur")
    robot = replace(arm(), joints=tuple(replace(j, name=name) for j, name in zip(arm().joints, joints, strict=True)))
    path = write_csv(tmp_path / "run.csv", table("q_{}", "tau_{}", of=joints))
    np.testing.assert_array_equal(read(path, robot).recording.effort, TAU)


def test_a_question_has_the_line_to_paste(tmp_path):
    columns = table("left_q_{}", None) | table("right_q_{}", "tau{}")
    path = write_csv(tmp_path / "run.csv", columns)
    with pytest.raises(RecordingError, match="2 sets of columns may hold q") as caught:
        read(path)
    said = tomllib.loads(caught.value.remedy)
    assert said["columns"]["q"] == each("left_q_{}")
    np.testing.assert_array_equal(read(path, **said).recording.q, Q)


@pytest.mark.parametrize("stated", [{}, {"q": each("right_q_{}")}])
def test_a_question_names_all_quantities_at_once(tmp_path, stated):
    columns = table("left_q_{}", "left_tau_{}") | table("right_q_{}", "right_tau_{}")
    path = write_csv(tmp_path / "run.csv", columns)
    with pytest.raises(RecordingError, match="2 sets of columns may hold effort") as caught:
        read(path, columns=stated)
    assert ("2 sets of columns may hold q" in str(caught.value)) == (not stated)
    side = "right" if stated else "left"
    said = tomllib.loads(caught.value.remedy)["columns"]
    assert said == {"q": each(f"{side}_q_{{}}"), "effort": each(f"{side}_tau_{{}}")}
    read(path, columns=said)


def test_what_cannot_be_guessed_is_asked_in_the_form_of_the_arm(tmp_path):
    path = write_csv(tmp_path / "run.csv", {"when": T} | {f"ch{k}": Q[:, k] for k in range(3)})
    with pytest.raises(RecordingError, match="No column holds positions") as caught:
        read(path)
    assert "in the order turn, lift, Elbow" in caught.value.remedy
    said = tomllib.loads(caught.value.remedy)
    assert said["columns"] == {"time": "when", "q": "ch{0}"} and "name the columns of effort" in caught.value.remedy
    np.testing.assert_array_equal(read(path, columns=said["columns"]).recording.q, Q)


def test_all_that_is_missing_is_asked_at_once(tmp_path):
    """Positions, torque and clock of unknown names: one error, and its study reads the file."""
    columns = {"tick": 1000.0 * T} | {
        f"{form}{k + 1}": x[:, k] for form, x in (("a", Q), ("b", TAU)) for k in range(3)
    }
    path = write_csv(tmp_path / "run.csv", columns)
    with pytest.raises(
        RecordingError, match=r"No column holds positions, effort \(torque or current\) or time"
    ) as caught:
        read(path)
    assert "tick, a1, a2" in caught.value.possible
    found = read(path, **tomllib.loads(caught.value.remedy)).recording
    assert found.time is not None and found.effort is not None
    np.testing.assert_allclose(found.time, T, atol=1e-9)  # rounding of milliseconds
    np.testing.assert_array_equal(found.effort, TAU)


@pytest.mark.parametrize("steps", [{"tick": 1000.0 * T}, {}])
def test_a_missing_clock_is_asked_together_with_missing_torque(tmp_path, steps):
    path = write_csv(
        tmp_path / "run.csv",
        steps | {f"q{k + 1}": Q[:, k] for k in range(3)} | {f"m{k}": TAU[:, k] for k in range(3)},
    )
    with pytest.raises(RecordingError, match="no effort") as caught:
        read(path)
    assert "m0, m1, m2" in caught.value.possible and 'effort = "m{0}"' in caught.value.remedy
    if steps:
        found = read(path, **tomllib.loads(caught.value.remedy)).recording
        np.testing.assert_array_equal(found.effort, TAU)
        np.testing.assert_allclose(found.time, T, atol=1e-9)  # rounding of milliseconds


@pytest.mark.parametrize(
    ("forms", "of"),
    [
        (("q{}_meas_rad", "q{}_trq_Nm"), (1, 2, 3)),
        (("pos_meas_{}", "trq_meas_{}"), (1, 2, 3)),
        (("q{}_rad", "q{}_Nm"), (1, 2, 3)),
        (("q{}", "i_q_{}"), (1, 2, 3)),  # the current that makes torque
        (("AXIS_ACT{}", "I_MOT{}"), (1, 2, 3)),
        (("$AXIS_ACT_MEAS.A{}", "$TORQUE_AXIS_ACT[{}]"), (1, 2, 3)),
        (("{}_meas_rad", "{}_trq_Nm"), JOINTS),
        (("{} [deg]", "{} [Nm]"), JOINTS),
    ],
)
def test_the_letter_of_a_joint_and_units_beside_its_name_are_understood(forms, of):
    q, effort = (each(form, of=of) for form in forms)
    found = guess_columns([*effort, *q], ALL, wanted=JOINTS)
    assert isinstance(found, Guess)
    assert found.columns == {"q": tuple(q), "effort": tuple(effort)}


def test_units_of_motion_beside_a_joints_name_tell_positions_from_velocities():
    forms = {"q": "{}_meas_rad", "dq": "{}_meas_rad_s", "ddq": "{} [rad/s^2]"}
    names = [name for form in forms.values() for name in each(form, of=JOINTS)]
    assert guess_columns(names, ALL, wanted=JOINTS).columns == {
        k: tuple(each(f, of=JOINTS)) for k, f in forms.items()
    }
    others = each("{}_slack_rad", of=JOINTS)  # an unknown word may mean anything
    assert guess_columns(others, ALL, wanted=JOINTS).columns == {}


def test_a_file_that_holds_torques_alone_is_answered_with_what_they_were_taken_for(tmp_path):
    path = write_csv(tmp_path / "run.csv", {"t": T} | {f"tau{k + 1}": TAU[:, k] for k in range(3)})
    with pytest.raises(
        RecordingError, match=r"No column holds positions. From the names, time is t; effort is tau1"
    ) as caught:
        read(path)
    assert caught.value.remedy.startswith("log the position of each joint")


def test_the_reading_of_a_study_knows_what_was_guessed(tmp_path):
    path = write_csv(tmp_path / "run.csv", table("{}_pos", "{}_tau", of=JOINTS))
    raw = load_recording(path, LogFormat(), arm())
    assert understood(raw, LogFormat(rate=None)).columns["q"] == tuple(each("{}_pos", of=JOINTS))
    assert raw.columns["effort"] == tuple(each("{}_tau", of=JOINTS))


GERMAN = ("_Winkel [deg]", "_Geschwindigkeit [deg/s]", "_Drehmoment [Nm]")


def test_german_words_and_units_of_torque_beside_a_joints_name_are_read():
    found = guess_columns(["Zeit [ms]", *(f"{j}{form}" for form in GERMAN for j in JOINTS)], ALL, wanted=JOINTS)
    assert isinstance(found, Guess)
    for quantity, form in zip(("q", "dq", "effort"), GERMAN, strict=True):
        assert found.columns[quantity] == tuple(f"{j}{form}" for j in JOINTS)
    q, load = [f"{j}_pos" for j in JOINTS], [f"{j}_Gelenklast [N·m]" for j in JOINTS]
    assert guess_columns([*q, *load], ALL, wanted=JOINTS).columns["effort"] == tuple(load)
    # A word that says torque goes before a unit alone, and other words still say that it is something else.
    said = [f"{j}_torque [Nm]" for j in JOINTS]
    assert guess_columns([*q, *load, *said], ALL, wanted=JOINTS).columns["effort"] == tuple(said)
    assert "effort" not in guess_columns([*q, *(f"{j}_ext [Nm]" for j in JOINTS)], ALL, wanted=JOINTS).columns
    assert "effort" not in guess_columns([*q, *(f"{j}_load [bar]" for j in JOINTS)], ALL, wanted=JOINTS).columns


def test_where_effort_is_missing_the_columns_that_were_not_read_are_proposed():
    chosen = {"time": ("t",), "q": ("q1", "q2", "q3"), "effort": ()}
    names = ["t", "q1", "q2", "q3", "Elbow load", "turn load", "lift load", "mode"]
    (said,) = effort_possible(names, chosen, LogFormat(), JOINTS)
    assert "unread columns: Elbow load, turn load, lift load, mode" in said.evidence
    assert tomllib.loads(said.remedy) == {"columns": {"effort": ["turn load", "lift load", "Elbow load"]}}
    (numbered,) = effort_possible([*names[:4], "L10", "L9", "L8"], chosen, LogFormat(), ())
    assert tomllib.loads(numbered.remedy)["columns"]["effort"] == ["L8", "L9", "L10"]
    (none,) = effort_possible([*names[:4], "mode"], chosen, LogFormat(), JOINTS)
    assert "mode" in none.evidence and none.remedy == ""
    assert effort_possible(names[:4], chosen, LogFormat(), JOINTS) == ()
    assert effort_possible(names, chosen, LogFormat(columns={"effort": ()}), JOINTS) == ()


def test_numbered_columns_are_named_by_a_pattern_that_matches_no_others():
    drives = each("ml_{}_drive [Nm]")
    assert pattern_of(drives, ["t", *drives]) == "ml_{}_drive [Nm]"
    assert pattern_of(each("m{}_i", of=ZERO), each("m{}_i", of=ZERO)) == "m{0}_i"
    assert pattern_of(drives, [*drives, "ml_4_drive [Nm]"]) == drives
    assert pattern_of(["a_tau", "b_tau"], ["a_tau", "b_tau"]) == ["a_tau", "b_tau"]
