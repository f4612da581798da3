"""Ensembles: possible arms whose torque spreads as the estimate says."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from armid.errors import OutputError
from armid.estimation.consistency.cones import smallest_eigenvalues
from armid.estimation.estimate_record import collapse, torque_parameters
from armid.estimation.problem import standard_of
from armid.export.ensemble.draws import Draws, draw_bodies
from armid.export.ensemble.write import PARAMETERS, RECORD, export_ensemble
from armid.model.motion import Motion
from armid.robot import load_robot
from armid.runs.run import Run, load_run
from armid.validation.prediction_interval import parameter_covariance
from command_line import exit_code as armid
from labs import STUDY, write_recordings, write_study

DRAWS = 400

SAMPLING = 4.0 / np.sqrt(2.0 * DRAWS)
"""Four standard deviations of a standard deviation from so many draws, relative."""

CONE = 0.05
"""Change of the spread of the torque by the cone of real bodies, relative."""


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    folder = tmp_path_factory.mktemp("ensemble")
    write_recordings(folder)
    study = write_study(folder, f'{STUDY}\n[estimation]\nmethod = "physical"\n')
    assert armid("identify", study, "--out", folder / "run", "--no-report") == 0
    return load_run(folder / "run")


@pytest.fixture(scope="module")
def draws(run: Run) -> Draws:
    return draw_bodies(run, centre_of(run), DRAWS, seed=1)


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
    rng = np.random.default_rng(3)
    q, dq, ddq = rng.uniform(-1.5, 1.5, (3, 60, run.model.n))
    motion = Motion(np.arange(60.0), q, dq, ddq)
    base, covariance = run.estimate.base, parameter_covariance(run.estimate)
    rows = run.model.regressor(motion)[:, :, base.kept]
    spread = np.std(rows @ draws.base.T, axis=2)
    expected = np.sqrt(np.einsum("njb,bc,njc->nj", rows, covariance, rows))
    ratio = np.sqrt(np.mean(spread**2, axis=0) / np.mean(expected**2, axis=0))
    assert (np.abs(ratio - 1.0) < SAMPLING + CONE).all()
    centre = np.mean(rows @ draws.base.T, axis=2) - rows @ collapse(base.names, run.estimate.fit)
    # The mean of so many draws is off by a twentieth of their spread, and the cone moves it, too.
    assert (np.sqrt(np.mean(centre**2, axis=0)) < 0.25 * np.sqrt(np.mean(expected**2, axis=0))).all()


def test_draws_inside_the_cone_are_not_changed(run: Run, draws: Draws):
    """A draw is replaced only where no real bodies have it; the others have the base parameters that were drawn."""
    inside = draws.distance <= 0.01
    assert 0.0 <= draws.replaced < 1.0 and inside.any()
    assert draws.replaced == pytest.approx(1.0 - inside.mean())


def test_the_seed_decides(run: Run):
    one, same, other = (draw_bodies(run, centre_of(run), 3, seed=seed) for seed in (5, 5, 6))
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
    ("more", "words"), [(("--ensemble", 0), "at least one draw"), (("--to", "c"), "Unknown format")]
)
def test_wrong_requests_are_refused(
    run: Run, tmp_path: Path, capsys: pytest.CaptureFixture[str], more: tuple[object, ...], words: str
):
    assert armid("export", run.folder, "--to", "urdf", "--ensemble", 2, "--out", tmp_path / "new", *more) == 2
    assert words in " ".join(capsys.readouterr().err.split())
    assert not (tmp_path / "new").exists()
