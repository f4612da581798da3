"""Intervals of recalibration and of loads: as an identification of the new recording would have them."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from armid import identify, load_study
from armid.checked_array import Array
from armid.dataclass_files import load, save
from armid.estimation.fit_result import Fit
from armid.estimation.uncertainty.jackknife import blend_with_textbook
from armid.estimation.update.stacked_problem import stack_problems
from armid.estimation.update.stacked_solution import solve_stacked
from armid.lab.inverse_dynamics_recording import record
from armid.maths.inertia import com_inertia_to_vector
from armid.runs.new_recordings import load_new_recordings
from armid.runs.payload import find_payload, payload_record
from armid.runs.recalibration import Changed, recalibrate
from armid.runs.run import Run, load_run, save_run
from labs import FRICTION, KNOWN_FRICTION, SENSORS, small_model, small_plan, small_truth, write_arm, write_recording

LOAD = com_inertia_to_vector(0.8, np.array([0.05, 0.02, 0.1]), np.diag([0.004, 0.005, 0.003]))
LACK = 4.0
"""Torque against the turn at each reversal that the model does not have [N·m]."""

STUDY = f"""{KNOWN_FRICTION}[estimation]
method = "{{method}}"
"""


def truth(friction: float = 1.0, carried: bool = False) -> Array:
    """Standard parameters with so many times the friction, and perhaps a load on the last link."""
    model, theta = small_model(), np.array(small_truth())
    if carried:
        theta[model.inertial_columns[-10:]] += LOAD
    for k, parameter in enumerate(model.parameters):
        theta[k] *= friction if parameter.symbol in FRICTION else 1.0
    return theta


def write(path: Path, seed: int, theta: Array, repetitions: int = 3, motion: int = 1) -> Path:
    """A log of an arm that has more friction at reversals than any model."""
    plan = small_plan(motion)
    log = record(small_model(), theta, plan, SENSORS, np.random.default_rng(seed), repetitions=repetitions)[0]
    assert log.effort is not None
    moved = plan.sample(SENSORS.rate, repetitions)
    bump = np.sign(moved.ddq) * np.exp(-((moved.dq / (0.05 * moved.dq.std(axis=0))) ** 2))
    return write_recording(replace(log, effort=log.effort + LACK * bump[: len(log.effort)]), path)


def run_of(folder: Path, log: str, name: str, method: str = "wls") -> Run:
    """A log identified."""
    (folder / f"{name}.toml").write_text(STUDY.format(log=log, method=method))
    return load_run(save_run(identify(load_study(folder / f"{name}.toml")), folder / name))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("arm")
    write_arm(folder)
    write(folder / "first.npz", 1, truth())
    write(folder / "worn.npz", 2, truth(1.4))
    write(folder / "often.npz", 4, truth(1.4), repetitions=7)
    write(folder / "loaded.npz", 3, truth(1.1, carried=True), motion=3)
    run_of(folder, "first.npz", "run")
    return folder


def held(ends: Array, true: Array) -> float:
    return float(np.mean((ends[:, 0] <= true) & (true <= ends[:, 1])))


@pytest.mark.parametrize("method", ["wls", "physical"])
@pytest.mark.parametrize("changed", ["friction", "all"])
def test_intervals_after_recalibration_hold_the_truth(folder: Path, method: str, changed: Changed):
    run = load_run(folder / "run") if method == "wls" else run_of(folder, "first.npz", "physical", method)
    fit = recalibrate(run, [str(folder / "worn.npz")], {}, changed=changed).result.estimate.fit
    assert fit.covariance_kind == "spectral" and "reversals" in fit.report.why
    assert held(fit.intervals, run.estimate.base.values_of(truth(1.4))) >= 0.85


@pytest.mark.parametrize("log", ["worn.npz", "often.npz"])
def test_where_everything_may_have_changed_intervals_are_those_of_an_identification(folder: Path, log: str):
    again = recalibrate(load_run(folder / "run"), [str(folder / log)], {}, changed="all").result.estimate.fit
    alone = run_of(folder, log, f"alone-{log}").estimate.fit
    assert again.covariance_kind == alone.covariance_kind
    # Weights of the joints are those of both recordings.
    ratio = np.log(np.diag(again.covariance) / np.diag(alone.covariance))
    assert np.abs(ratio).max() < np.log(2.0) and np.median(np.abs(ratio)) < np.log(1.3)


def test_intervals_of_a_load_hold_the_truth(folder: Path):
    run = load_run(folder / "run")
    found = find_payload(run, [str(folder / "loaded.npz")], {})
    assert held(found.load.intervals, LOAD) >= 0.9
    said = payload_record(found)["covariance"]
    assert said["kind"] == "spectral" and "covariance of their run" in said["why"]


def test_factors_alone_say_that_they_are_factors_alone(folder: Path):
    run = load_run(folder / "run")
    beside = load_new_recordings(run, [str(folder / "worn.npz")], {})
    solved = solve_stacked(stack_problems(beside.earlier, run.estimate.fit, beside.new, beside.changing))
    assert solved.fit.covariance_kind == "block" and "factors are stored, and no samples" in solved.fit.report.why


def test_what_reversals_do_to_both_recordings_is_added_with_its_sign(folder: Path):
    """The same motion twice has the same move, which a second recording does not average out."""
    run = load_run(folder / "run")
    beside = load_new_recordings(run, [str(folder / "worn.npz")], {})
    joined = stack_problems(beside.earlier, run.estimate.fit, beside.new, beside.changing, samples=beside.samples)
    shared = [k for k, own in enumerate(beside.changing) if not own]
    after = (joined.to_new @ solve_stacked(joined).fit.report.moved)[shared]
    before = run.estimate.fit.report.moved[shared]
    assert after @ before / (np.linalg.norm(after) * np.linalg.norm(before)) > 0.9
    assert np.linalg.norm(after) > 0.8 * np.linalg.norm(before)


def test_a_scatter_of_few_periods_is_made_definite():
    rng = np.random.default_rng(1)
    half = rng.normal(size=(12, 12))
    textbook = half @ half.T
    draws = half @ rng.normal(size=(12, 5)) * 2.0
    full = blend_with_textbook(draws @ draws.T / 5.0, textbook, 5.0)
    ratio = np.linalg.eigvals(np.linalg.solve(textbook, full)).real
    assert ratio.min() > 1.0 and ratio.max() < 20.0 and 2.5 < np.mean(ratio) < 6.0


def test_a_run_that_says_nothing_of_reversals_is_read(folder: Path):
    """As runs were that were written before: their moves are part of the covariance and no more."""
    run = load_run(folder / "run")
    fit = run.estimate.fit
    before = replace(fit, report=replace(fit.report, moved=np.zeros(0), reach=0.0))
    path = save(before, folder / "before.npz")
    with np.load(path) as archive:
        arrays = {name: archive[name] for name in archive.files}
    header = json.loads(bytes(arrays["value.json"]))
    for name in ("moved", "reach"):
        del header["value"]["report"][name]
    arrays["value.json"] = np.frombuffer(json.dumps(header).encode(), dtype=np.uint8)
    np.savez(path, **arrays)  # pyright: ignore[reportArgumentType]
    beside = load_new_recordings(run, [str(folder / "worn.npz")], {})
    joined = stack_problems(beside.earlier, load(Fit, path), beside.new, beside.changing, samples=beside.samples)
    values = joined.to_new @ solve_stacked(joined).values
    assert np.isfinite(values).all()
