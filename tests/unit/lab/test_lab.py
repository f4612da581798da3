"""Simulations as a whole: options, the way along a plan, what is refused."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from armid import kernel
from armid.errors import ArmidError, LabError, MissingExtraError
from armid.excitation.fourier import Excitation
from armid.lab.controller import CONTROLLERS, Controller, Drive
from armid.lab.faults import Gap, LostRows
from armid.lab.inverse_dynamics_recording import Sensors, record
from armid.lab.known_arms import with_effects
from armid.lab.options import Arm, LabOptions, load_options, parse_options
from armid.lab.plant import Plant, stable_rate, write_mjcf
from armid.lab.sensors import Sensing, SensorChannel
from armid.lab.simulated_motion import MARGIN, TrueMotion, closed_loop, inverse_dynamics
from armid.lab.simulation import simulate, simulation_findings, true_model, truth_record
from armid.model.motion import Motion
from armid.robot import load_robot
from plants import EXACT, lab, short_plan, small_arm, smooth_arm

EVERYTHING = """
mode = "closed-loop"
repetitions = 2
physics_rate = 2000
[arm]
effects = ["rotor", "stribeck"]
rotor = [0.1, 0.2, 0.3]
[arm.friction]
viscous = [1, 2, 3]
coulomb = [0.5, 0.5, 0.5]
[arm.friction.slip]
torque = [[0.1, 0.1, 0.1]]
deflection = [[0.01, 0.01, 0.01]]
[controller]
kind = "pid"
compliance = 0.01
[drive]
bandwidth = 200
saturation = 0.9
[sensing]
rate = 500
side = "link"
velocity = { noise = 1e-3 }
[sensing.position]
resolution = 1e-4
[[faults]]
kind = "lost-rows"
share = 0.02
[[faults]]
kind = "gap"
"""


def test_a_file_says_everything(tmp_path: Path):
    path = tmp_path / "lab.toml"
    path.write_text(EVERYTHING)
    found = load_options(path)
    assert (found.repetitions, found.controller.kind, found.drive.bandwidth) == (2, "pid", 200)
    assert found.faults == (LostRows(0.02), Gap())
    assert found.sensing.velocity == SensorChannel(noise=1e-3) and found.sensing.position == SensorChannel(
        resolution=1e-4
    )
    truth = found.arm.of(small_arm())
    np.testing.assert_array_equal(truth.friction.viscous, [1.0, 2.0, 3.0])
    np.testing.assert_array_equal(truth.rotor, [0.1, 0.2, 0.3])
    assert truth.friction.slip is not None and truth.friction.stribeck is not None


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ({"mod": "closed-loop"}, "has no key 'mod'"),
        ({"mode": "magic"}, "Unknown mode 'magic'"),
        ({"repetitions": 0}, "at least 1"),
        ({"repetitions": "two"}, "must be a number"),
        ({"lead_in": True}, "must be a number"),
        ({"controller": 3}, "must be a table"),
        ({"controller": {"kind": "magic"}}, "Unknown controller 'magic'"),
        ({"controller": {"compliance": 0.0}}, "must be positive"),
        ({"drive": {"bandwidth": -1.0}}, "must not be negative"),
        ({"sensing": {"position": {"noice": 1.0}}}, "has no key 'noice'"),
        ({"arm": {"friction": {"viscous": [1.0]}}}, "these keys are missing: coulomb"),
        ({"arm": {"friction": {"viscous": ["x"], "coulomb": [1.0]}}}, "must be an array of numbers"),
        ({"arm": {"effects": "rotor"}}, "must be a list"),
        ({"faults": [{"kind": "magic"}]}, "unknown kind of fault 'magic'"),
        ({"faults": [{"share": 0.1}]}, "unknown kind of fault"),
        ({"faults": [{"kind": "gap", "share": 0.1}]}, "has no key 'share'"),
    ],
)
def test_a_wrong_file_is_refused(table: dict, message: str):
    with pytest.raises(LabError, match=message):
        parse_options(table)


@pytest.mark.parametrize("text", ["mode = ", None])
def test_an_unreadable_file_is_refused(tmp_path: Path, text: str | None):
    path = tmp_path / "lab.toml"
    if text is not None:
        path.write_text(text)
    with pytest.raises(LabError, match=r"lab\.toml"):
        load_options(path)


# Moving ----------------------------------------------------------------------------------------------------------


def off_the_plan(trace: TrueMotion, plan: Excitation) -> float:
    """Largest distance from the plan after the lead-in [rad]."""
    after = trace.from_time(0.0)
    return float(np.abs(after.q - plan.at(after.time).q).max())


@pytest.mark.parametrize("kind", CONTROLLERS)
def test_every_controller_follows_the_plan(kind):
    """Computed torque of the true model errs by friction alone, the others by more."""
    truth, plan = small_arm(), short_plan(period=2.0)
    trace, gain = closed_loop(truth, plan, Controller(kind), Drive(), rate=2000.0, lead_in=0.5)
    error = off_the_plan(trace, plan)
    allowed = {"computed-torque": 0.03, "pd-gravity": 0.06, "pid": 0.12}[kind]
    assert error < allowed
    assert bool(gain.integral.any()) == (kind == "pid")
    assert trace.time[0] == pytest.approx(-MARGIN) and trace.time[-1] == pytest.approx(2.0 - 0.0005)


def test_a_perfect_model_without_friction_follows_exactly():
    plan = short_plan(period=2.0)
    trace, _ = closed_loop(smooth_arm(), plan, Controller(), Drive(), rate=4000.0, lead_in=0.5)
    assert off_the_plan(trace, plan) < 1e-5
    exact = inverse_dynamics(smooth_arm(), plan, 4000.0, 1)
    np.testing.assert_allclose(trace.from_time(0.0).effort, exact.from_time(0.0).effort, atol=0.05)


def test_the_trace_is_consistent_with_inverse_dynamics_and_friction():
    """At every instant, not only between: torque = rigid bodies + friction, with the friction of that velocity."""
    truth = small_arm()
    trace, _ = closed_loop(truth, short_plan(period=2.0), Controller(), Drive(), rate=4000.0, lead_in=0.5)
    model, theta = true_model(truth)
    expected = model.torque(Motion(trace.time, trace.q, trace.dq, trace.ddq), theta)
    sliding = np.abs(trace.dq) > 0.02
    np.testing.assert_allclose(trace.effort[sliding], expected[sliding], atol=1e-3)


def test_friction_fed_forward_helps():
    plan, errors = short_plan(period=2.0), []
    for share in (0.0, 1.0):
        trace, _ = closed_loop(small_arm(), plan, Controller(friction=share), Drive(), rate=2000.0, lead_in=0.5)
        errors.append(off_the_plan(trace, plan))
    assert errors[1] < 0.2 * errors[0]


def test_saturation_and_current_loop_bound_the_torque():
    limits = 80.0
    plan = short_plan(period=2.0)
    bound, _ = closed_loop(small_arm(), plan, Controller("pid"), Drive(saturation=0.2), rate=2000.0, lead_in=0.5)
    assert np.abs(bound.effort).max() == pytest.approx(0.2 * limits)
    free, _ = closed_loop(small_arm(), plan, Controller(), Drive(), rate=2000.0, lead_in=0.5)
    slow, _ = closed_loop(small_arm(), plan, Controller(), Drive(bandwidth=20.0), rate=2000.0, lead_in=0.5)
    assert np.abs(np.diff(slow.effort, axis=0)).max() < np.abs(np.diff(free.effort, axis=0)).max()


def test_a_slow_controller_holds_its_torque():
    trace, _ = closed_loop(
        small_arm(), short_plan(period=1.0), Controller(rate=250.0), Drive(), rate=2000.0, lead_in=0.5
    )
    changes = (np.diff(trace.effort, axis=0) != 0.0).any(axis=1)
    assert changes.mean() == pytest.approx(1.0 / 8.0, abs=0.01)


def test_repetitions_repeat_once_settled():
    done = simulate(small_arm(), short_plan(period=2.0), lab(repetitions=2))
    first, second = np.split(done.recording.q, 2)
    np.testing.assert_allclose(first, second, atol=2e-4)
    assert done.recording.samples == 400


def test_a_period_between_steps_goes_on_without_a_jump():
    plan = short_plan(period=1.00033)
    done = simulate(small_arm(), plan, lab(repetitions=3))
    assert done.recording.samples == 300
    assert np.abs(np.diff(done.trace.q, axis=0)).max() < 0.01


@pytest.mark.parametrize("mode", ["closed-loop", "inverse-dynamics"])
def test_the_seed_makes_the_log(mode):
    options = lab(mode=mode, sensing=Sensing(100.0), faults=(LostRows(0.1),))
    logs = [simulate(small_arm(), short_plan(period=1.0), options, seed=seed).recording for seed in (1, 1, 2)]
    assert logs[0].sha256 == logs[1].sha256 != logs[2].sha256
    np.testing.assert_array_equal(logs[0].effort, logs[1].effort)  # pyright: ignore[reportArgumentType]


def test_a_slower_log_of_the_same_motion_has_the_same_truth():
    done = [
        simulate(small_arm(), short_plan(period=1.0), lab(sensing=replace(EXACT, rate=r))) for r in (100.0, 500.0)
    ]
    np.testing.assert_allclose(done[0].recording.q, done[1].recording.q[::5], atol=1e-12)


def test_the_name_of_a_file_is_no_plan():
    with pytest.raises(ArmidError, match="load_plan"):
        simulate(small_arm(), "plan.json")  # pyright: ignore[reportArgumentType]


def test_what_the_real_arm_could_not_do_is_said():
    plan = short_plan(period=2.0)
    wide = replace(plan, offset=plan.offset + np.array([0.0, 2.9, 0.0]))
    done = simulate(small_arm(), wide, lab(mode="inverse-dynamics"))
    assert {(f.code, f.channel) for f in simulation_findings(done)} >= {("plan-outside-limits", "joint_2")}
    fast = simulate(small_arm(), plan.stretched(0.3), lab(mode="inverse-dynamics"))
    assert "plan-too-fast" in {f.code for f in simulation_findings(fast)}
    weak = simulate(small_arm(), plan, lab(drive=Drive(saturation=0.1)))
    closed = simulate(small_arm(), plan, lab())
    assert "limit-overshot" not in {f.code for f in simulation_findings(closed)}
    top = np.abs(plan.sample(1000.0).dq).max(axis=0)
    robot = small_arm().robot
    joints = [replace(joint, velocity_limit=v) for joint, v in zip(robot.joints, top, strict=True)]
    at_limit = replace(small_arm(), robot=replace(robot, joints=tuple(joints)))
    assert not simulation_findings(simulate(at_limit, plan, lab(mode="inverse-dynamics")))
    loose = simulation_findings(simulate(at_limit, plan, lab(controller=Controller("pid"))))
    overshot = [f for f in loose if f.code == "limit-overshot"]
    assert overshot and all("in the plan is at most" in f.evidence and ".velocity=" in f.remedy for f in overshot)
    assert "plan-too-fast" not in {f.code for f in loose}
    assert "drive-saturated" in {f.code for f in simulation_findings(weak)}
    assert not simulation_findings(simulate(small_arm(), short_plan(), lab(mode="inverse-dynamics")))


def test_inverse_dynamics_is_what_the_demo_records():
    silent = Sensors(position=0.0, torque=0.0, rate=100.0)
    rng = np.random.default_rng(0)
    truth = small_arm()
    model, theta = true_model(truth)
    expected, _, _ = record(model, theta, short_plan(), silent, rng, repetitions=2)
    found = simulate(truth, short_plan(), lab(mode="inverse-dynamics", repetitions=2)).recording
    np.testing.assert_allclose(found.q, expected.q, atol=1e-12)
    np.testing.assert_allclose(found.effort, expected.effort, atol=1e-9)  # pyright: ignore


def test_a_wound_spring_swings_at_the_frequency_of_two_masses():
    """ω² = K (1/J + 1/I) where one joint has the inertia I; the first joint of the small arm, its others stiff."""
    stiffness, rotor = np.array([2000.0, 1e6, 1e6]), np.array([0.05, 50.0, 50.0])
    truth = smooth_arm(rotor=rotor, stiffness=stiffness)
    rest = np.zeros((1, 3))
    holding = kernel.inverse_dynamics(truth.robot.tree, truth.inertial, rest, rest, rest)[0]
    inertia = kernel.mass_matrix(truth.robot.tree, truth.inertial, rest)[0, 0, 0]
    expected = np.sqrt(stiffness[0] * (1.0 / rotor[0] + 1.0 / inertia))
    plant = Plant(truth, 1e-5, rest[0], holding + np.array([2.0, 0.0, 0.0]))
    stretch = []
    for _ in range(6000):
        plant.step(holding)
        stretch.append(plant.drive_q[0] - plant.q[0])
    crossings = np.flatnonzero(np.diff(np.sign(stretch)) != 0)
    period = 2.0 * 1e-5 * np.diff(crossings).mean()
    assert len(crossings) >= 4 and 2.0 * np.pi / period == pytest.approx(expected, rel=0.02)


# Truth -----------------------------------------------------------------------------------------------------------


def test_the_record_has_the_truth_that_an_identification_should_find():
    options = lab(arm=Arm(("rotor", "hysteresis")), faults=(Gap(),))
    done = simulate(small_arm(), short_plan(period=1.0), options)
    record = truth_record(done, "abc")
    assert record["recording_sha256"] == "abc"
    assert record["parameters"]["FV_1"] == 1.5
    # Springs that have slipped count: their torque is that of a sliding joint.
    assert record["parameters"]["FS_2"] == pytest.approx(1.2)
    assert record["parameters"]["IA_1"] == done.truth.rotor[0] > 0.0
    assert set(record["base_parameters"]) >= {"FV_1", "FS_3"}
    assert record["options"]["faults"][0]["kind"] == "gap"
    assert len(record["controller"]["proportional"]) == 3


def test_springs_ask_for_a_shorter_step():
    truth = with_effects(small_arm(), ["hysteresis"])
    needed = stable_rate(truth, np.zeros((1, 3)))
    with pytest.raises(LabError, match="too long"):
        Plant(truth, 2.0 / needed, np.zeros(3), np.zeros(3))
    done = simulate(truth, short_plan(period=0.5), lab(physics_rate=1.0))
    assert 1.0 / (done.trace.time[1] - done.trace.time[0]) >= needed * 0.999


@pytest.mark.parametrize(
    "wrong",
    [
        lambda: simulate(
            small_arm(), replace(short_plan(), offset=np.zeros(2), a=np.zeros((2, 3)), b=np.zeros((2, 3)))
        ),
        lambda: simulate(with_effects(small_arm(), ["elastic"]), short_plan(), lab(mode="inverse-dynamics")),
        lambda: write_mjcf(small_arm().robot, np.zeros((3, 10))),
        lambda: write_mjcf(small_arm().robot, np.tile([1.0, 0, 0, 0, 1.0, 0, 0.1, 0, 0, 0.1], (3, 1))),
        lambda: simulate(
            smooth_arm(),
            short_plan(),
            LabOptions(controller=Controller(model_scale=1e6), drive=Drive(saturation=0.0)),
        ),
    ],
)
def test_what_cannot_be_simulated_is_refused(wrong):
    with pytest.raises(LabError):
        wrong()


def test_without_mujoco_the_extra_is_named(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(MissingExtraError, match=r"armid\[lab\]"):
        simulate(small_arm(), short_plan(), lab())
    assert simulate(small_arm(), short_plan(), lab(mode="inverse-dynamics")).gains is None


def test_truths_of_the_built_in_arms_are_named_after_them():
    from armid.lab.known_arms import OWN

    assert all(load_robot(name).name == name for name in OWN)
