"""The model set free: its own torque brings its own motion back, and a wrong one does not."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from armid.cli.commands.validate_rollout import motion_table
from armid.errors import ArmidError
from armid.lab.controller import Controller, Drive
from armid.lab.friction import Friction, MaxwellSlip
from armid.lab.known_arms import KnownArm
from armid.lab.simulated_motion import closed_loop
from armid.measurement.low_pass_band import Band
from armid.measurement.observations import Observations, ObservedRun
from armid.model.dynamics_model import DynamicsModel
from armid.model.motion import Motion
from armid.model.terms import Coulomb, Hysteresis, LoadCoulomb, RigidBody, RotorInertia, Stribeck, Viscous
from armid.runs.rollout import judged_by_motion, load_feedback
from armid.validation.rollout import Feedback, Windows, roll_out, sharpened
from armid.validation.rollout_score import Losses, MotionScore, score_motion
from armid.validation.simulated_windows import simulate_windows
from armid.validation.torque_validation import Validation
from labs import small_model, small_truth
from plants import short_plan, small_arm

RATE = 500.0
MODEL = sharpened(small_model())
TRUTH = small_truth()


def exact_windows(model: DynamicsModel, theta: np.ndarray, length: int = 251, count: int = 4) -> Windows:
    """Windows of an exact motion under the torque that it takes."""
    motion = model.remember(short_plan().sample(RATE))
    torque = model.torque(motion, theta)
    starts = [700 * k + 100 for k in range(count)]
    memory = np.zeros((count, 0)) if motion.memory is None else motion.memory[starts]
    parts = [np.stack([x[s : s + length] for s in starts]) for x in (motion.q, motion.dq, motion.ddq, torque)]
    return Windows(*parts, memory=memory, step=1.0 / RATE)


def test_the_true_model_gives_the_motion_back():
    windows = exact_windows(MODEL, TRUTH)
    found = roll_out(MODEL, TRUTH, windows).q
    moved = np.abs(windows.q - windows.q[:, :1]).max()
    assert moved > 0.3
    # Half a second in which sgn(q̇) turns between samples: friction of 1 N·m that comes a sample late.
    np.testing.assert_allclose(found, windows.q, atol=2e-3)


def test_without_sign_changes_the_error_is_that_of_the_step():
    model = DynamicsModel(MODEL.robot, (RigidBody(), Viscous(), RotorInertia()))
    nominal = model.nominal_parameters()
    assert nominal is not None
    theta = nominal.copy()
    theta[[k for k, p in enumerate(model.parameters) if p.symbol in ("FV", "IA")]] = 0.3
    windows = exact_windows(model, theta)
    np.testing.assert_allclose(roll_out(model, theta, windows).q, windows.q, atol=2e-4)


def test_a_wrong_model_goes_elsewhere():
    windows = exact_windows(MODEL, TRUTH)
    heavy = TRUTH.copy()
    heavy[MODEL.inertial_columns] *= 1.3
    right, wrong = (np.abs(roll_out(MODEL, theta, windows).q - windows.q).max() for theta in (TRUTH, heavy))
    assert wrong > 20.0 * right


def test_feedback_holds_a_wrong_model():
    """The same controller needs no plan: at the recorded motion it gave the recorded torque."""
    windows = exact_windows(MODEL, TRUTH)
    heavy = TRUTH.copy()
    heavy[MODEL.inertial_columns] *= 1.3
    gains = Feedback(np.full(3, 400.0), np.full(3, 30.0), np.zeros(3))
    open_loop, closed = (np.abs(roll_out(MODEL, heavy, windows, f).q - windows.q).max() for f in (None, gains))
    assert closed < 0.05 * open_loop


def test_the_same_controller_moves_another_model_as_it_would_another_plant():
    """The model with twice the friction, under the gains alone, does what a plant with twice the friction did."""
    truth, plan = small_arm(), short_plan(period=4.0)
    rough = replace(truth, friction=Friction(2.0 * truth.friction.viscous, 2.0 * truth.friction.coulomb))
    (trace, gain), (other, same) = (
        closed_loop(t, plan, Controller(), Drive(), rate=2000.0, lead_in=0.5) for t in (truth, rough)
    )
    np.testing.assert_array_equal(gain.proportional, same.proportional)
    trace, other = trace.from_time(0.0), other.from_time(0.0)
    parts = [x[None, ::4] for x in (trace.q, trace.dq, trace.ddq, trace.effort)]
    windows = Windows(*parts, memory=np.zeros((1, 0)), step=4.0 / 2000.0)
    theta = TRUTH.copy()
    theta[[k for k, p in enumerate(MODEL.parameters) if p.symbol in ("FV", "FS")]] *= 2.0
    found = roll_out(MODEL, theta, windows, Feedback(gain.proportional, gain.derivative, gain.integral)).q[0]
    apart = np.abs(other.q[::4] - trace.q[::4])[500:].max()
    off = np.abs(found - other.q[::4])[500:].max()  # a second, in which the other state of the beginning has gone
    assert apart > 1e-3 and off < 0.1 * apart


@pytest.mark.parametrize("term", [Stribeck(), LoadCoulomb(), Hysteresis(widths=(0.01,))])
def test_every_kind_of_friction_is_rolled_out(term):
    bodies = small_arm().inertial
    model = sharpened(
        DynamicsModel(MODEL.robot, (RigidBody(), Viscous(), Coulomb(0.02), term), load_parameters=bodies)
    )
    theta = np.zeros(len(model.parameters))
    theta[model.inertial_columns] = bodies.ravel()
    values = {"FV": 1.0, "FS": 0.5, "FT": 0.3, "FSL": 0.05}
    for k, parameter in enumerate(model.parameters):
        if k not in model.inertial_columns:
            theta[k] = values.get(parameter.symbol, 0.3)
    windows = exact_windows(model, theta)
    np.testing.assert_allclose(roll_out(model, theta, windows).q, windows.q, atol=4e-3)


def test_stuck_joints_stay():
    model = MODEL
    rest = np.zeros((1, 200, 3))
    gravity = model.gravity_torque(np.zeros((1, 3)), TRUTH)[0]
    push = np.array([0.7, 0.0, 0.0])  # Coulomb friction of the first joint is 0.8 N·m
    torque = np.tile(gravity + push, (1, 200, 1))
    windows = Windows(rest, rest, rest, torque, np.zeros((1, 0)), 1e-3)
    assert not roll_out(model, TRUTH, windows).q.any()
    harder = replace(windows, torque=torque + np.array([0.2, 0.0, 0.0]))
    assert roll_out(model, TRUTH, harder).q[0, -1, 0] > 1e-4


def test_widths_of_signs_become_zero_and_parameters_stay():
    model = DynamicsModel(MODEL.robot, (RigidBody(), Coulomb(0.02), Stribeck(width=0.01)))
    sharp = sharpened(model)
    assert [t.width for t in sharp.terms[1:]] == [0.0, 0.0]  # pyright: ignore[reportAttributeAccessIssue]
    assert sharp.parameters == model.parameters


def test_a_mass_matrix_that_is_not_positive_is_no_motion():
    windows = exact_windows(MODEL, TRUTH)
    found = roll_out(MODEL, -TRUTH, windows)
    assert np.isnan(found.q).all() and found.indefinite.all() and not found.ran_away.any()


def test_the_velocity_and_the_torque_of_the_true_model_are_those_recorded():
    windows = exact_windows(MODEL, TRUTH)
    gains = Feedback(np.full(3, 400.0), np.full(3, 20.0), np.zeros(3))
    alone, closed = roll_out(MODEL, TRUTH, windows), roll_out(MODEL, TRUTH, windows, gains)
    np.testing.assert_array_equal(alone.torque, windows.torque)  # nothing else acts without a controller
    inner = slice(5, None)  # the feedback settles within a few samples
    # A sample of 2 ms at 20 rad/s², and the friction of 1 N·m that comes a sample late at reversals.
    np.testing.assert_allclose(closed.dq[:, inner], windows.dq[:, inner], atol=0.05)
    assert np.sqrt(np.mean((closed.torque - windows.torque)[:, inner] ** 2)) < 0.02 * windows.torque.std()


def test_the_feedback_of_a_wrong_model_is_the_torque_that_it_lacks():
    """In closed loop, the simulated torque of a model with a heavier arm holds the additional weight."""
    windows = exact_windows(MODEL, TRUTH, length=501)
    heavy = TRUTH.copy()
    heavy[MODEL.inertial_columns] *= 1.2
    gains = Feedback(np.full(3, 4000.0), np.full(3, 100.0), np.zeros(3))
    found = roll_out(MODEL, heavy, windows, gains)
    needed = MODEL.torque(
        Motion(np.arange(501.0), *(getattr(windows, name)[0] for name in ("q", "dq", "ddq"))), heavy
    )
    lacking, feedback = needed - windows.torque[0], (found.torque - windows.torque)[0]
    settled = slice(200, None)  # 0.4 s, many time constants of this stiff loop
    error = np.sqrt(np.mean((feedback - lacking)[settled] ** 2, axis=0))
    assert (error < 0.2 * np.sqrt(np.mean(lacking[settled] ** 2, axis=0))).all()


def test_what_runs_away_ends_in_nothing():
    windows = exact_windows(MODEL, TRUTH)
    torque = windows.torque.copy()
    torque[1] += 1e5
    found = roll_out(MODEL, TRUTH, replace(windows, torque=torque))
    assert np.isnan(found.q[1, -1]).all() and np.isfinite(found.q[[0, 2, 3]]).all()
    assert found.ran_away.tolist() == [False, True, False, False] and not found.indefinite.any()


# Scores ----------------------------------------------------------------------------------------------------------


def observed(**changes) -> Observations:
    motion = short_plan().sample(RATE)
    torque = MODEL.torque(motion, TRUTH)
    rows = motion.samples
    run = ObservedRun(motion, torque, RATE, 1, 0, np.ones((rows, 3), bool), np.zeros(rows, int))
    return Observations((replace(run, **changes),), Band())


def scored(
    theta: np.ndarray, observations: Observations, *, tolerance: float = 0.01, path: str = "", **options: float
) -> MotionScore:
    simulated = simulate_windows(small_model(), theta, observations, **options)  # pyright: ignore[reportArgumentType]
    return score_motion(simulated, tolerance=tolerance, path=path)


def test_scores_say_how_far_and_how_long():
    score = scored(TRUTH, observed(), seconds=0.5, tolerance=0.01, path="log.csv")
    assert (score.windows, score.lost, score.path) == (15, 0, "log.csv")
    assert (score.rms < 2e-3).all() and (score.rms <= score.peak).all() and (score.peak < score.travelled).all()
    assert (score.held == 0.5).all() and score.seconds == pytest.approx(0.5)
    assert score.prior_rms is not None and (score.prior_rms > 5.0 * score.rms).all()
    strict = scored(TRUTH, observed(), seconds=0.5, tolerance=1e-7)
    assert (strict.held < 0.3).all()


def test_windows_leave_out_masked_rows():
    rows = observed().runs[0].motion.samples
    mask = np.ones((rows, 3), dtype=bool)
    mask[1001:1100, 2] = False  # after 2.0 s, where a window ends
    score = scored(TRUTH, observed(mask=mask), seconds=0.5)
    assert score.windows == 14


def test_lost_windows_are_counted():
    score = scored(-TRUTH, observed(), seconds=1.0)
    assert score.lost == score.windows == 7 and np.isnan(score.rms).all() and (score.held == 0.0).all()
    assert score.losses == Losses(ran_away=0, indefinite=7, nominal=0)


@pytest.mark.parametrize(
    "wrong",
    [
        {"seconds": 100.0},
        {"seconds": 0.0},
        {"tolerance": -1.0},
    ],
)
def test_what_cannot_be_scored_is_refused(wrong):
    with pytest.raises(ArmidError):
        scored(TRUTH, observed(), **wrong)


def test_rows_that_do_not_follow_each_other_are_no_motion():
    with pytest.raises(ArmidError, match="needs a segment"):
        scored(TRUTH, observed(consecutive=False))


def test_gains_come_from_a_file(tmp_path: Path):
    path = tmp_path / "gains.json"
    path.write_text(json.dumps({"controller": {"kind": "pid", "proportional": [1, 2, 3], "derivative": [4, 5, 6]}}))
    found = load_feedback(path)
    np.testing.assert_array_equal(found.derivative, [4.0, 5.0, 6.0])
    assert not found.integral.any()


@pytest.mark.parametrize(
    "content",
    [
        "",
        "[]",
        "{}",
        '{"controller": null}',
        '{"controller": {"proportional": 1, "derivative": 2}}',
        '{"controller": {"proportional": [1], "derivative": [-1]}}',
        '{"controller": {"proportional": [1], "derivative": [1, 2]}}',
    ],
)
def test_what_are_no_gains_is_refused(tmp_path: Path, content: str):
    path = tmp_path / "gains.json"
    path.write_text(content)
    with pytest.raises(ArmidError):
        load_feedback(path)


def test_slip_of_the_lab_is_hysteresis_of_the_model():
    """One law, stated twice: springs of the truth and the term that is identified."""
    from armid.lab.friction import friction_along

    motion = short_plan().sample(RATE)
    slip = MaxwellSlip(np.full((1, 3), 2.0), np.full((1, 3), 0.01))
    friction = Friction(np.zeros(3), np.zeros(3), slip=slip)
    assert isinstance(small_arm(friction=friction), KnownArm)
    torque, _ = friction_along(friction, motion, np.zeros_like(motion.q))
    model = DynamicsModel(MODEL.robot, (Hysteresis(widths=(0.01,)),))
    remembered, known = model.remembered(Motion(motion.time, motion.q, motion.dq, motion.ddq))
    expected = model.torque(remembered, np.full(len(model.parameters), 2.0))
    np.testing.assert_allclose(torque[known.max() :], expected[known.max() :], atol=1e-9)


def test_a_description_that_runs_away_is_not_flattered_by_its_beginnings():
    """Under a torque far too large every model is soon faster than any arm."""
    run = observed().runs[0]
    strong = replace(run, torque=run.torque + 3e3)
    score = scored(TRUTH, Observations((strong,), Band()), seconds=0.5)
    assert score.lost == score.windows and score.prior_rms is not None and np.isnan(score.prior_rms).all()
    assert score.losses == Losses(ran_away=score.windows, indefinite=0, nominal=score.windows)
    table = motion_table(small_model().robot, [score], closed=False)
    assert f"this simulation diverged in {score.windows} of the {score.windows} windows" in str(table.caption)


@pytest.mark.parametrize(("lost", "verdict"), [(0, "pass"), (25, "pass"), (26, "fail"), (51, "fail")])
def test_a_model_that_loses_most_windows_fails_its_verdict(lost: int, verdict: str):
    none = np.zeros(3)
    score = MotionScore("log.csv", none, none, none, none, None, 51, Losses(lost), 0.5, 0.01)
    judged = judged_by_motion(Validation(("a", "b", "c"), (), "pass", ()), [score], closed=False)
    assert (judged.verdict, judged.checks[-1].ok) == (verdict, verdict == "pass")
    assert judged.checks[-1].value == lost / 51
    assert judged.checks[-1].name == "share of windows of 0.5 s lost under the recorded torque alone"


def test_a_tolerance_that_is_never_left_is_said_to_last_longer_than_the_window():
    none, held = np.zeros(3), np.array([0.5, 0.12, 0.5])
    score = MotionScore("log.csv", none, none, held, none, None, 51, Losses(0), 0.5, 0.01)
    table = motion_table(small_model().robot, [score], closed=False)
    assert list(table.columns[4].cells) == ["> 0.50 s", "0.12 s", "> 0.50 s"]
