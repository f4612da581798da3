"""Every command and snippet of the guides is executed, in a folder where the files they name lie ready.

The arm is a small one and the recordings are short, so that what a page says is tried and not how long it takes.
Pages whose commands design, simulate or reproduce at full size take minutes and are marked as long.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from armid import DynamicsModel, Excitation, Recording, identify, load_robot, load_study, save_run
from armid.checked_array import Array
from armid.cli import main as cli
from armid.lab.inverse_dynamics_recording import Sensors, record
from armid.lab.known_arms import truth_of as lab_truth
from armid.model.terms import Coulomb, RigidBody, Viscous
from labs import URDF, write_recording
from paged import blocks, follow, pages

pytest.importorskip("mujoco")
pytest.importorskip("plotly")
pytest.importorskip("pyarrow")
pytest.importorskip("sympy")

PAGES = pages()

GUIDES = {
    "certify.md": 2,
    "code.md": 5,
    "doctor.md": 1,
    "export.md": 4,
    "monitor.md": 2,
    "payload.md": 5,
    "recursive.md": 2,
    "report.md": 3,
}
"""Pages that are followed as they stand, and how many blocks that is."""

LONG = {"excitation.md": 2, "lab.md": 5}

STUDY = """
[robot]
description = "arm.urdf"

[[recording]]
path = "run1.csv"

[[recording]]
path = "run2.csv"
role = "validate"

[estimation]
method = "physical"
"""

SPACE = '<collision><origin xyz="0 0 0.12"/><geometry><cylinder radius="0.04" length="0.1"/></geometry></collision>'
"""Collision body of each link."""

GAIN = 10.0
"""Torque over current of the drives [N·m/A]."""

CURRENTS = f"""
[robot]
description = "arm.urdf"

[[recording]]
path = "currents.csv"
drive_gain = [{GAIN}, {GAIN}, {GAIN}]
"""


def arm_of(folder: Path, load: float = 0.0) -> DynamicsModel:
    """The small arm as `arm.urdf` in a folder; its middle joint is the elbow, its last link may carry a load [kg]."""
    path = folder / "arm.urdf"
    text = URDF.replace('"joint_2"', '"elbow"').replace("</inertial></link>", f"</inertial>{SPACE}</link>")
    path.write_text(text, encoding="utf-8")
    robot = load_robot(path)
    last = robot.links[-1]
    assert last.inertial is not None
    heavy = replace(last, inertial=type(last.inertial).from_vector(last.inertial.vector * (1.0 + load)))
    return DynamicsModel(replace(robot, links=(*robot.links[:-1], heavy)), (RigidBody(), Viscous(), Coulomb(0.02)))


def truth_of(model: DynamicsModel, friction: float = 1.0) -> Array:
    """Standard parameters of the arm as the lab has it, and friction."""
    truth = np.full(len(model.parameters), friction)
    truth[model.inertial_columns] = lab_truth(model.robot).inertial.ravel()
    return truth


def record_as(model: DynamicsModel, truth: Array, seed: int, rate: float = 100.0) -> Recording:
    """A motion of its own, twice."""
    rng = np.random.default_rng(seed)
    a, b = rng.normal(0.0, 0.35, (2, model.n, 5))
    low, high = np.clip([joint.position_limits for joint in model.robot.joints], -np.pi, np.pi).T
    motion = Excitation(2.0 * np.pi / 8.0, a, b, 0.5 * (low + high), model.robot.name)
    return record(model, truth, motion, Sensors(1e-6, 0.02, rate), rng, repetitions=2)[0]


@pytest.fixture(scope="module")
def workshop(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Arms, recordings, runs and a plan under the names that the guides give them."""
    folder = tmp_path_factory.mktemp("workshop")
    model = arm_of(folder)
    truth = truth_of(model)
    for seed, name in enumerate(("run1", "run2", "other_tool", "free_1", "free_2"), 1):
        write_recording(record_as(model, truth, seed), folder / f"{name}.csv")
    for seed, name in enumerate(("autumn", "check", "shift"), 11):
        write_recording(record_as(model, truth_of(model, 1.3), seed), folder / f"{name}.csv")
    loaded = arm_of(folder, load=1.0)
    for seed, name in enumerate(("with_load", "picking"), 21):
        write_recording(record_as(loaded, truth_of(loaded), seed), folder / f"{name}.csv")
    (folder / "arm.toml").write_text(STUDY)
    cell = next(block for block in blocks(PAGES["excitation.md"]) if block.text.startswith("# cell.toml"))
    (folder / "cell.toml").write_text(cell.text)
    save_run(identify(load_study(folder / "arm.toml")), folder / "runs" / "today")
    for name in ("last_year", "spring", "arm"):
        shutil.copytree(folder / "runs" / "today", folder / "runs" / name)
    for seed, name, each in ((1, "currents", model), (21, "currents_with_load", loaded)):
        driven = record_as(each, truth_of(each), seed)
        assert driven.effort is not None
        write_recording(replace(driven, effort=driven.effort / GAIN), folder / f"{name}.csv")
    (folder / "currents.toml").write_text(CURRENTS)
    save_run(identify(load_study(folder / "currents.toml")), folder / "runs" / "currents")
    shutil.copy(folder / "arm.urdf", folder / "iiwa14.urdf")
    turned = record_as(model, truth, 31, rate=50.0)
    assert turned.effort is not None
    write_recording(replace(turned, effort=-turned.effort), folder / "samples.parquet", clock=False)
    panda = DynamicsModel(load_robot("panda"), (RigidBody(), Viscous(), Coulomb(0.02)))
    write_recording(record_as(panda, truth_of(panda), 41), folder / "monday.csv")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        terms = ("--terms", "rigid-body,viscous,coulomb", "--no-report")
        armid("identify", "panda", "monday.csv", *terms, "--out", "runs/monday")
        options = ("--gravity", "0", "0", "9.81", "--collision", "--floor", "-1.5", "--budget", "1", "--workers", "0")
        armid("excite", "iiwa14-r820", *options, "--duration", "6", "--harmonics", "2", "--out", "plans/first")
    return folder


def armid(*arguments: str) -> None:
    with pytest.raises(SystemExit) as ended:
        cli.main(list(arguments))
    assert not ended.value.code, arguments


@pytest.fixture
def follow_page(workshop: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[str], int]:
    """Follows a page in a copy of the workshop."""
    shutil.copytree(workshop, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    return lambda page: follow(PAGES[page])


@pytest.mark.collision
@pytest.mark.parametrize("page", GUIDES)
def test_a_guide(page: str, follow_page: Callable[[str], int]):
    assert follow_page(page) == GUIDES[page]


@pytest.mark.collision
@pytest.mark.long
@pytest.mark.parametrize("page", LONG)
def test_a_long_guide(page: str, follow_page: Callable[[str], int]):
    assert follow_page(page) == LONG[page]


def test_no_page_is_forgotten():
    """Pages with commands or Python are followed here, among the tutorials, with the thesis's records, or say so."""
    busy = {page for page, text in PAGES.items() for b in blocks(text) if b.run and b.language in ("bash", "python")}
    elsewhere = {page for page in PAGES if page.startswith("tutorials/")}
    elsewhere |= {"start.md", "extending.md", "thesis.md", "dh.md", "fleet.md"}
    assert busy == {*GUIDES, *LONG} | elsewhere
