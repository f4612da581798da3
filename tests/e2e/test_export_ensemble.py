"""Ensembles: possible arms whose torque spreads as the estimate says."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from armid.errors import OutputError
from armid.estimation.consistency.cones import smallest_eigenvalues
from armid.estimation.estimate_record import collapse, torque_parameters
from armid.estimation.problem import standard_of
from armid.export.ensemble.draws import Draws, draw_arms
from armid.export.ensemble.write import PARAMETERS, RECORD, export_ensemble
from armid.model.motion import Motion
from armid.robot import load_robot
from armid.runs.run import Run, load_run
from armid.runs.validation_and_prediction import motion_of
from armid.validation.prediction_interval import NORMAL, parameter_covariance, torque_band, torque_error_deviation
from command_line import exit_code as armid
from labs import STUDY, write_recordings, write_study

DRAWS = 400

SPREAD = 0.05
"""Change of the spread of the torque by the cone of real bodies and by the finite pilot sample, relative."""


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    folder = tmp_path_factory.mktemp("ensemble")
    write_recordings(folder)
    study = write_study(folder, f'{STUDY}\n[estimation]\nmethod = "physical"\n')
    assert armid("identify", study, "--out", folder / "run", "--no-report") == 0
    return load_run(folder / "run")


@pytest.fixture(scope="module")
def draws(run: Run) -> Draws:
    return draw_arms(run, centre_of(run), DRAWS, seed=1)


def centre_of(run: Run) -> np.ndarray:
    return torque_parameters(run.estimate.base, run.estimate.fit)


def test_every_draw_is_an_arm_of_real_bodies(run: Run, draws: Draws):
    standard = standard_of(run.model, run.estimate.base)
    lowest = [smallest_eigenvalues(standard, each).min() for each in draws.standard]
    assert min(lowest) > 0.0 and (draws.standard[:, np.flatnonzero(standard.nonnegative)] >= 0.0).all()
    scale = np.abs(draws.base).max()
    np.testing.assert_allclose(draws.standard @ standard.regrouping.T, draws.base, atol=1e-9 * scale)
    assert len(np.unique(draws.standard[:, 0])) == DRAWS


def test_the_torque_spreads_as_the_parameters_are_uncertain(run: Run, draws: Draws):
    spread, shift = spread_of(run, draws)
    assert (np.abs(spread - 1.0) < SPREAD).all()
    assert (shift < 0.25).all()  # the mean of the draws is moved by the cone only


def test_the_torque_spreads_so_where_most_draws_lie_outside_the_cone(run: Run):
    uncertain = with_deviations(run, 20.0)
    draws = draw_arms(uncertain, centre_of(run), DRAWS, seed=1)
    assert draws.replaced > 0.75
    spread, _ = spread_of(uncertain, draws)
    assert (np.abs(spread - 1.0) < SPREAD).all()


def test_a_spread_that_the_cone_does_not_allow_is_stated(run: Run, tmp_path: Path):
    """Estimates with deviations of a hundred times are wider than the cone: the record says what was reached."""
    uncertain = with_deviations(run, 100.0)
    draws = draw_arms(uncertain, centre_of(run), 2, seed=1)
    assert draws.spread[0] < 0.9 or draws.spread[1] > 1.1
    assert 0.3 < draws.spread[0] and draws.spread[1] < 3.0  # not what passes that diverge would give
    for each, exported in ((run, tmp_path / "certain"), (uncertain, tmp_path / "uncertain")):
        export_ensemble(each, "urdf", 2, exported, seed=1)
    certain, stated = (
        json.loads((tmp_path / name / RECORD).read_text())["spread"] for name in ("certain", "uncertain")
    )
    assert 0.9 < certain[0] <= certain[1] < 1.1
    np.testing.assert_allclose(stated, draws.spread, rtol=0.05)  # the centre is the exported one


def with_deviations(run: Run, factor: float) -> Run:
    """Run whose parameters have standard deviations that are larger by a factor."""
    estimate = run.estimate
    fit = replace(estimate.fit, covariance=factor**2 * estimate.fit.covariance)
    return replace(run, estimate=replace(estimate, fit=fit))


def spread_of(run: Run, draws: Draws) -> tuple[np.ndarray, np.ndarray]:
    """Standard deviation and mean change of the draws' torque, relative to the deviation by the covariance."""
    rng = np.random.default_rng(3)
    q, dq, ddq = rng.uniform(-1.5, 1.5, (3, 60, run.model.n))
    motion = Motion(np.arange(60.0), q, dq, ddq)
    base, covariance = run.estimate.base, parameter_covariance(run.estimate)
    rows = run.model.regressor(motion)[:, :, base.kept]
    spread = np.std(rows @ draws.base.T, axis=2)
    shift = np.mean(rows @ draws.base.T, axis=2) - rows @ collapse(base.names, run.estimate.fit)
    expected = np.einsum("njb,bc,njc->nj", rows, covariance, rows)
    size = np.sqrt(np.mean(expected, axis=0))
    return np.sqrt(np.mean(spread**2, axis=0)) / size, np.sqrt(np.mean(shift**2, axis=0)) / size


def test_the_torque_with_its_errors_spreads_as_the_prediction_interval_says(run: Run):
    motion = unlike_training(run)
    draws = draw_arms(run, centre_of(run), DRAWS, seed=1, motion=motion)
    rows = run.model.regressor(motion)[:, :, run.estimate.base.kept]
    torque = rows @ draws.base.T + draws.torque_error.T
    half = torque_band(run.model, run.estimate, motion) / NORMAL
    spread = np.sqrt(np.mean(np.var(torque, axis=2), axis=0) / np.mean(half**2, axis=0))
    assert (np.abs(spread - 1.0) < SPREAD).all()


def test_draws_spread_no_further_than_the_interval_where_left_out_errors_are_small(run: Run):
    """Left-out errors of 0.4 times the expected ones narrow the interval, also that by the parameters alone."""
    training = run.estimate.prediction
    assert training is not None
    small = replace(training, log_factor=np.log(0.4), log_deviation=0.1)
    narrow = replace(run, estimate=replace(run.estimate, prediction=small))
    motion = unlike_training(run)
    draws = draw_arms(narrow, centre_of(run), DRAWS, seed=1, motion=motion)
    torque = run.model.regressor(motion)[:, :, run.estimate.base.kept] @ draws.base.T + draws.torque_error.T
    half = torque_band(narrow.model, narrow.estimate, motion) / NORMAL
    spread = np.sqrt(np.mean(np.var(torque, axis=2), axis=0) / np.mean(half**2, axis=0))
    assert (np.abs(spread - 1.0) < SPREAD).all()


def test_torque_errors_without_a_motion_are_those_of_the_training_motion(run: Run, draws: Draws):
    """The motion of the training recording and the mean variances that the run keeps of it give the same size."""
    motion, _ = motion_of(run, str(Path(run.folder).parent / "run1.csv"), rate=100.0, reading={})
    kept = torque_error_deviation(run.model, run.estimate)
    found = torque_error_deviation(run.model, run.estimate, motion)
    np.testing.assert_allclose(found, kept, rtol=0.1)  # rows at rest are no training rows
    count = max(DRAWS, 4 * len(run.estimate.fit.values))
    np.testing.assert_allclose(np.std(draws.torque_error, axis=0), kept, rtol=4.0 / np.sqrt(2.0 * count))
    # Farther from the training motion, the error of the model is larger.
    assert (torque_error_deviation(run.model, run.estimate, unlike_training(run)) > found).all()


def unlike_training(run: Run) -> Motion:
    q, dq, ddq = np.random.default_rng(3).uniform(-1.5, 1.5, (3, 60, run.model.n))
    return Motion(np.arange(60.0), 2.0 * q, dq, ddq)


def test_the_motion_of_an_ensemble_is_an_option_of_the_command(
    run: Run, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    call = ("export", run.folder, "--to", "urdf", "--out", tmp_path / "arms")
    motion = Path(run.folder).parent / "run1.csv"
    assert armid(*call, "--ensemble", 3, "--motion", motion) == 0
    assert "torque_error in parameters.npz has an RMS of" in capsys.readouterr().out
    with np.load(tmp_path / "arms" / PARAMETERS) as arrays:
        assert arrays["torque_error"].shape == (3, run.model.n) and list(arrays["joints"]) == [*run.robot.joint_names]
    assert armid(*call, "--motion", motion) == 2
    assert "--ensemble N" in capsys.readouterr().err


def test_draws_inside_the_cone_are_not_changed(run: Run, draws: Draws):
    """A draw is replaced only where no real bodies have it; the others have the base parameters that were drawn."""
    inside = draws.distance <= 0.01
    assert 0.0 <= draws.replaced < 1.0 and inside.any()
    assert draws.replaced == pytest.approx(1.0 - inside.mean())


def test_the_seed_decides(run: Run):
    one, same, other = (draw_arms(run, centre_of(run), 3, seed=seed) for seed in (5, 5, 6))
    np.testing.assert_array_equal(one.standard, same.standard)
    assert np.abs(one.standard - other.standard).max() > 0.0


def test_the_files_have_the_bodies_of_the_draws(run: Run, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    folder = tmp_path / "arms"
    call = ("export", run.folder, "--to", "urdf", "--ensemble", 12, "--seed", 4, "--out", folder)
    assert armid(*call) == 0
    assert "12 possible arms written" in capsys.readouterr().out
    record = json.loads((folder / RECORD).read_text())
    assert record["draws"] == 12 and record["seed"] == 4 and record["files"][11] == "small_11.urdf"
    with np.load(folder / PARAMETERS) as arrays:
        standard, names = arrays["standard"], arrays["standard_names"].tolist()
    columns = run.model.inertial_columns.reshape(-1, 10)
    for k, name in enumerate(record["files"]):
        robot = load_robot(folder / name)
        for link, own in zip(robot.links, columns, strict=True):
            assert link.inertial is not None
            # Inertia about the centre of mass, then about the frame again: some digits of 16.
            np.testing.assert_allclose(link.inertial.vector, standard[k, own], atol=1e-9)
        assert robot.joints[0].drive.viscous == pytest.approx(standard[k, names.index("FV_1")])
    assert armid(*call, "--json") == 0  # an ensemble is replaced
    assert json.loads(capsys.readouterr().out)["draws"] == 12


def test_a_folder_of_something_else_is_kept(run: Run, tmp_path: Path):
    (tmp_path / "letter.txt").write_text("dear")
    with pytest.raises(OutputError, match="not a set of drawn arms"):
        export_ensemble(run, "urdf", 2, tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["letter.txt"]


@pytest.mark.parametrize(
    ("more", "words"), [(("--ensemble", 0), "at least one draw"), (("--to", "c"), "'c' is not a format of one")]
)
def test_wrong_requests_are_refused(
    run: Run, tmp_path: Path, capsys: pytest.CaptureFixture[str], more: tuple[object, ...], words: str
):
    assert armid("export", run.folder, "--to", "urdf", "--ensemble", 2, "--out", tmp_path / "new", *more) == 2
    assert words in " ".join(capsys.readouterr().err.split())
    assert not (tmp_path / "new").exists()
