"""Earlier runs in the goal of a design: their information about its parameters, and their noise."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from armid.checked_array import Array
from armid.cli.motion.excite_goal import design_model, goal_of, prior_of_run
from armid.dataclass_files import load, save
from armid.excitation.design.objective import CriterionGoal
from armid.information.information import Information
from armid.model.base_parameters import find_base_parameters
from armid.model.dynamics_model import DynamicsModel
from armid.model.memoryless_model import slipping
from armid.runs.run import load_run

RUNS = Path(__file__).parents[2] / "data" / "runs_format_1"

SQUARED = 1e-7
"""Relative to the diagonal; the reference subtracts products of columns whose condition is squared."""


def goal_for(model: DynamicsModel) -> CriterionGoal:
    return CriterionGoal(model, find_base_parameters(model), "d-optimal", np.array([0.5, 1.0, 2.0]), 100.0, 1)


def products_of(folder: Path, goal: CriterionGoal) -> tuple[list[str], Array]:
    """Names (b,) and information (b, b) of all parameters of a run."""
    information = load(Information, folder / "information.npz")
    total = np.zeros((information.count, information.count))
    for joint, noise in zip(information.joints, goal.noise, strict=True):
        rows = np.zeros((joint.R.shape[0] * joint.R.shape[1], information.count))
        rows[:, joint.parameters] = joint.R[:, :, :-1].reshape(len(rows), -1)
        total += rows.T @ rows / noise**2
    return list(information.names), total


def agrees(found: Array, reference: Array) -> None:
    size = np.sqrt(np.diag(reference))
    size[size == 0.0] = 1.0
    np.testing.assert_allclose(found / np.outer(size, size), reference / np.outer(size, size), rtol=0, atol=SQUARED)


@pytest.mark.parametrize("name", ["apart", "memory"])
def test_parameters_that_a_design_lacks_are_unknown_in_what_it_knows_from_a_run(name: str):
    """The information about the others is a Schur complement: `apart` has offsets, `memory` also hysteresis."""
    run = load_run(RUNS / name)
    few = tuple(term for term in run.model.terms if term.name != "offset")
    goal = goal_for(slipping(replace(run.model, terms=few)))
    names, total = products_of(RUNS / name, goal)
    shared = [each for each in goal.base.names if each in names]
    at, absent = [names.index(each) for each in shared], [k for k, each in enumerate(names) if each not in shared]
    assert absent and shared
    inner = total[np.ix_(absent, absent)]
    size = np.sqrt(np.diag(inner))
    inverse = np.linalg.pinv(inner / np.outer(size, size), hermitian=True) / np.outer(size, size)
    across = total[np.ix_(at, absent)]
    reference = np.zeros((goal.base.count, goal.base.count))
    to = [goal.base.names.index(each) for each in shared]
    reference[np.ix_(to, to)] = total[np.ix_(at, at)] - across @ inverse @ across.T
    agrees(prior_of_run(str(RUNS / name), goal), reference)


def test_a_run_tells_a_design_with_its_parameters_all_that_it_knows():
    goal = goal_for(load_run(RUNS / "apart").model)
    names, total = products_of(RUNS / "apart", goal)
    assert names == list(goal.base.names)
    agrees(prior_of_run(str(RUNS / "apart"), goal), total)


def test_an_absent_parameter_without_effect_takes_no_information(tmp_path: Path):
    """Its column is zero, so that no row is needed to find it."""
    folder = Path(shutil.copytree(RUNS / "apart", tmp_path / "run"))
    run = load_run(folder)
    goal = goal_for(replace(run.model, terms=tuple(term for term in run.model.terms if term.name != "offset")))
    information = load(Information, folder / "information.npz")
    joints = []
    for joint in information.joints:
        R = joint.R.copy()
        R[:, :, [k for k, p in enumerate(joint.parameters) if str(information.names[p]).startswith("FO")]] = 0.0
        joints.append(replace(joint, R=R))
    save(replace(information, joints=tuple(joints)), folder / "information.npz")
    names, total = products_of(folder, goal)
    at = [names.index(each) for each in goal.base.names]
    agrees(prior_of_run(str(folder), goal), total[np.ix_(at, at)])


def test_a_design_has_the_noise_of_the_run_that_gives_its_terms():
    """An arm of another geometry with as many joints takes neither."""
    run = load_run(RUNS / "apart")
    first, *rest = run.robot.joints
    placement = first.placement.copy()
    placement[:3, 3] += 0.1
    other = replace(run.robot, joints=(replace(first, placement=placement), *rest))
    options: dict[str, Any] = {
        "terms": None,
        "after": [str(RUNS / "apart")],
        "noise": None,
        "rate": 100.0,
        "repetitions": 1,
        "predict": None,
        "criterion": None,
    }
    assert (goal_of(design_model(run.robot, options), options).noise == run.estimate.fit.noise).all()
    assert (goal_of(design_model(other, options), options).noise == 1.0).all()
