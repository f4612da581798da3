"""A run followed through rests, where dry friction has any value up to its bound: they change nothing."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from armid.errors import ArmidError
from armid.measurement.recording import Recording
from armid.model.dynamics_model import DynamicsModel
from armid.model.motion import Motion
from armid.model.terms import Coulomb, RigidBody, Viscous
from armid.runs.run import Run, load_run, save_run
from armid.runs.tracking import track
from armid.study.config import ModelChoice, RecordingChoice, RobotChoice, Study
from armid.study.identify import identify
from labs import FRICTION, small_model, small_truth, write_arm, write_recording
from plants import short_plan

RATE, RAMP = 250.0, 0.5
COUNT = 2.0 * np.pi / 4096.0
FINE, COARSE = (1e-6, 0.0), (2e-4, COUNT)  # noise and step of the encoders [rad]
REPETITIONS = 3
FEW_OF_MANY = 5.0  # standard deviations that none of some thousand correlated values exceeds


def paced(rests: tuple[float, float, float]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Time along a plan, its rate and that one's derivative, with rests at start, middle and end."""
    up = np.arange(round(RAMP * RATE)) / (RAMP * RATE)
    rise, full = np.sin(np.pi / 2 * up) ** 2, np.ones(round((REPETITIONS * 8.0 - 2 * RAMP) / 2 * RATE))
    parts = []
    for k, rest in enumerate(rests):
        parts += [rise[::-1] if k and rest else rise[:0] + 1.0, np.zeros(round(rest * RATE))]
        parts += [rise, full] if rest and k < 2 else [full] if k < 2 else []
    pace = np.concatenate(parts)
    along = np.concatenate([[0.0], np.cumsum((pace[1:] + pace[:-1]) / 2)]) / RATE
    return along, pace, np.gradient(pace) * RATE


def log(seed: int, rests: tuple[float, float, float], encoder: tuple[float, float], dry: float = 1.0) -> Recording:
    """The small arm along a plan that pauses; at each rest dry friction stays somewhere between its bounds."""
    rng = np.random.default_rng(seed)
    along, pace, change = paced(rests)
    at = short_plan(seed, 8.0).at(along)
    time = np.arange(len(along)) / RATE
    motion = Motion(time, at.q, at.dq * pace[:, None], at.ddq * pace[:, None] ** 2 + at.dq * change[:, None])
    model = DynamicsModel(small_model().robot, (RigidBody(), Viscous(), Coulomb(width=0.0)))
    theta = small_truth()
    theta[[p.symbol == "FS" for p in model.parameters]] *= dry
    still = pace == 0.0
    rest = np.cumsum(np.diff(still, prepend=False))
    held = rng.uniform(-1.0, 1.0, (rest[-1] + 1, 3)) * np.array(FRICTION["FS"]) * dry
    torque = model.torque(motion, theta) + np.where(still[:, None], held[rest], 0.0)
    q = at.q + encoder[0] * rng.standard_normal(at.q.shape)
    if encoder[1]:
        q = np.round(q / encoder[1]) * encoder[1]
    effort = torque + 0.05 * rng.standard_normal(torque.shape)
    return Recording(
        time=time, q=q, effort=effort, joint_names=model.robot.joint_names, consecutive=True, source="pausing"
    )


@pytest.fixture(scope="module", params=[FINE, COARSE], ids=["fine", "coarse"])
def encoder(request: pytest.FixtureRequest) -> tuple[float, float]:
    return request.param


@pytest.fixture(scope="module")
def run(encoder: tuple[float, float], tmp_path_factory: pytest.TempPathFactory) -> Run:
    folder = tmp_path_factory.mktemp("earlier")
    paths = [write_recording(log(seed, (0, 0, 0), encoder), folder / f"{seed}.npz") for seed in (1, 2)]
    study = Study(
        RobotChoice(str(write_arm(folder))),
        ModelChoice(("rigid-body", "viscous", "coulomb", "offset"), {"coulomb": {"width": 0.0}}),
        tuple(RecordingChoice(str(path)) for path in paths),
    )
    return load_run(save_run(identify(study), folder / "run"))


@pytest.mark.parametrize("rest", [1.0, 4.0])
@pytest.mark.parametrize("where", [(1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 1)])
def test_rests_change_nothing(
    run: Run, encoder: tuple[float, float], where: tuple[int, int, int], rest: float, tmp_path: Path
):
    rests = (where[0] * rest, where[1] * rest, where[2] * rest)
    path = write_recording(log(3, rests, encoder), tmp_path / "pausing.npz")
    found = track(run, [str(path)], {}, memory=20.0)
    before, variance = run.estimate.fit.values, np.diag(run.estimate.fit.covariance)
    change = np.abs(found.values - before) / np.sqrt(found.deviation**2 + variance)
    assert not found.events
    assert change[-1].max() < 3.0 and change.max() < FEW_OF_MANY


@pytest.mark.parametrize("memory", [5.0, 20.0])
def test_a_minute_at_rest_keeps_estimate_and_intervals(
    run: Run, encoder: tuple[float, float], memory: float, tmp_path: Path
):
    """Blocks at rest have no rows; none of them moves a value or its deviation, and motion goes on as before."""
    path = write_recording(log(3, (0.0, 60.0, 0.0), encoder), tmp_path / "pausing.npz")
    found = track(run, [str(path)], {}, memory=memory)
    rest = (found.time > 14.0) & (found.time < 70.0)
    assert rest.sum() > 50 and not found.error[rest].any() and not found.normalized_innovation[rest].any()
    assert (found.values[rest] == found.values[rest][0]).all()
    assert (found.deviation[rest] == found.deviation[rest][0]).all()
    change = np.abs(found.values[-1] - run.estimate.fit.values)
    assert (change < 3.0 * np.hypot(found.deviation[-1], np.sqrt(np.diag(run.estimate.fit.covariance)))).all()
    assert not found.events


def test_intervals_hold_the_truth_after_rests(run: Run, encoder: tuple[float, float], tmp_path: Path):
    """95 % are meant of friction, whose truth is known; twenty motions of half a minute with three rests each."""
    truth = {f"{kind}_{j + 1}": FRICTION[kind][j] for kind in ("FV", "FS") for j in range(3)}
    truth |= {f"FO_{j}": 0.0 for j in (1, 2, 3)}
    inside = []
    for seed in range(3, 23):
        path = write_recording(log(seed, (2.0, 2.0, 2.0), encoder), tmp_path / f"{seed}.npz")
        found = track(run, [str(path)], {}, memory=10.0)
        at = [found.names.index(name) for name in truth]
        inside.append(np.abs(found.values[-1, at] - list(truth.values())) <= 1.96 * found.deviation[-1, at])
    assert np.mean(inside) > 0.85


def test_friction_that_changed_during_a_rest_is_found(run: Run, encoder: tuple[float, float], tmp_path: Path):
    """Dry friction is half as large again when the arm moves again after half a minute."""
    before = write_recording(log(3, (0.0, 0.0, 30.0), encoder), tmp_path / "before.npz")
    after = write_recording(log(4, (2.0, 0.0, 2.0), encoder, dry=1.5), tmp_path / "after.npz")
    found = track(run, [str(before), str(after)], {}, memory=5.0)
    dry = [found.names.index(f"FS_{j}") for j in (1, 2, 3)]
    changed = 1.5 * np.array(FRICTION["FS"])
    assert (np.abs(found.values[-1, dry] - changed) <= 4.0 * found.deviation[-1, dry]).all()
    assert (np.abs(found.values[-1, dry] - changed) <= 0.1 * changed).all()


def test_rest_alone_is_refused_and_changes_nothing_after_motion(
    run: Run, encoder: tuple[float, float], tmp_path: Path
):
    whole = log(3, (30.0, 0.0, 0.0), encoder)
    assert whole.time is not None and whole.effort is not None
    rows = slice(0, round(20.0 * RATE))
    still = replace(whole, time=whole.time[rows], q=whole.q[rows], effort=whole.effort[rows], valid=whole.valid[rows])
    path = str(write_recording(still, tmp_path / "still.npz"))
    with pytest.raises(ArmidError, match="no row in which a joint moves"):
        track(run, [path], {})
    moving = str(write_recording(log(3, (0.0, 0.0, 0.0), encoder), tmp_path / "moving.npz"))
    alone, both = track(run, [moving], {}), track(run, [moving, path], {})
    assert len(both.time) > len(alone.time) + 15 and not both.events
    np.testing.assert_array_equal(both.values[-1], alone.values[-1])
    np.testing.assert_array_equal(both.deviation[-1], alone.deviation[-1])
