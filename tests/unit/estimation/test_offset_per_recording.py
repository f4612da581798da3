"""Offsets that differ between recordings: told apart from friction and bodies, estimated, and said."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from armid.estimation.estimate_record import torque_parameters
from armid.estimation.estimators import Ridge, WeightedLeastSquares
from armid.estimation.friction.selection import choose_friction
from armid.estimation.friction_per_recording import contrasted, offset_names, separate_by_recording
from armid.estimation.problem import EstimationProblem, standard_of
from armid.information.accumulate import accumulate_information
from armid.information.information import stack
from armid.information.residuals import compare
from armid.measurement.observations import Observations
from armid.model.base_parameters import find_base_parameters
from armid.model.dynamics_model import DynamicsModel
from armid.model.terms import Coulomb, Hysteresis, Offset, RigidBody, Viscous
from armid.study.plausibility.estimate_findings import drift_finding
from problems import lively_motion, one_run, raw
from trees import random_inertial, robot_of, structured_tree

RATE = 50.0

SAME = 1e-9
"""Relative difference of two ways to solve one well-conditioned least-squares problem."""

NOISE = 0.05
"""Of the torque [N·m]."""

OFFSETS = np.array([[0.9, -0.2, 0.0], [-0.7, 0.1, 0.3], [0.1, 0.3, -0.4]])
"""Of three recordings, three joints each [N·m]; their spread is ten times the noise."""

NEAR = 0.03
"""Error of an offset [N·m]: 24 s of noise leave some 0.005, and the prior a little more."""

ALIKE = 0.02
"""Relative change of a held-out ratio through offsets: a weak prior on them is all that knows of their size."""


def arm(*more: object) -> DynamicsModel:
    tree = structured_tree(np.random.default_rng(2), 3, prismatic=0.0, branching=0.0)
    return DynamicsModel(robot_of(tree), (RigidBody(), Viscous(), Coulomb(0.02), Offset(), *more))  # pyright: ignore[reportArgumentType]


def recorded(offsets: np.ndarray, *, seconds: float = 24.0, truth: DynamicsModel | None = None) -> Observations:
    """Recordings of one arm with hysteresis, each with its offsets."""
    truth = truth or arm(Hysteresis((0.01,)))
    theta = np.random.default_rng(4).uniform(0.3, 0.8, len(truth.parameters))
    theta[truth.inertial_columns] = random_inertial(np.random.default_rng(4), truth.n).ravel()
    place = {parameter.name: k for k, parameter in enumerate(truth.parameters)}
    runs = []
    for r, own in enumerate(offsets):
        rng = np.random.default_rng(10 + r)
        theta[[place[name] for name in offset_names(truth)]] = own
        motion = lively_motion(rng, truth.n, RATE, seconds)
        torque = truth.torque(truth.remember(motion), theta) + NOISE * rng.normal(size=motion.q.shape)
        runs.append(replace(one_run(motion, torque, RATE, step=2, block_rows=25), recording=r))
    return raw(*runs)


def test_a_mean_and_contrasts_are_the_values_of_each_recording():
    model, observations = arm(), recorded(OFFSETS)
    base = find_base_parameters(model)
    information = accumulate_information(model, base, observations)
    own = np.isin(information.names, offset_names(model))
    wide, apart = contrasted(information, offset_names(model)), separate_by_recording(information, own)
    assert wide.names[: information.count] == information.names
    assert wide.names[-2:] == ("FO_3~1", "FO_3~2") and wide.count == apart.count == information.count + 6
    mean = dict(zip(wide.names, np.linalg.lstsq(*stack(wide), rcond=None)[0], strict=True))
    each = dict(zip(apart.names, np.linalg.lstsq(*stack(apart), rcond=None)[0], strict=True))
    for j in (1, 2, 3):
        copies = [each[f"FO_{j}[{r}]"] for r in (1, 2, 3)]
        assert mean[f"FO_{j}"] == pytest.approx(np.mean(copies), rel=SAME)
        assert mean[f"FO_{j}"] + mean[f"FO_{j}~1"] == pytest.approx(copies[0], rel=SAME)
        assert mean[f"FO_{j}"] - mean[f"FO_{j}~1"] - mean[f"FO_{j}~2"] == pytest.approx(copies[2], rel=SAME)
    assert mean["FV_1"] == pytest.approx(each["FV_1"], rel=SAME)


def test_one_recording_has_nothing_to_contrast():
    model, observations = arm(), recorded(OFFSETS[:1])
    information = accumulate_information(model, find_base_parameters(model), observations)
    assert contrasted(information, offset_names(model)) is information
    assert (
        contrasted(accumulate_information(model, find_base_parameters(model), recorded(OFFSETS)), ()).count
        == information.count
    )


def test_what_is_chosen_does_not_depend_on_offsets_between_recordings():
    """Offsets ten times the noise are taken out exactly, so the evidence is what it is without them.

    And of the widths that are tried together, those that bring nothing are let go of but for the widest.
    """
    model = arm()
    still, drifting = (choose_friction(model, recorded(scale * OFFSETS)) for scale in (0.0, 1.0))
    assert still.offset_per_recording and drifting.offset_per_recording
    assert drifting.added == still.added == (Hysteresis((0.01, 0.03), model.robot.joint_names),)
    np.testing.assert_allclose(drifting.ratio, still.ratio, rtol=ALIKE)


def test_each_offset_is_found_and_the_mean_stands_for_another_recording():
    model, observations = arm(Hysteresis((0.01,))), recorded(OFFSETS)
    base = find_base_parameters(model)
    information = accumulate_information(model, base, observations)
    apart = separate_by_recording(information, np.isin(information.names, offset_names(model)))
    fit = Ridge(weight=1.0).solve(EstimationProblem(apart, standard_of(model, base), model, base))
    found = dict(zip(fit.names, fit.values, strict=True))
    for r, own in enumerate(OFFSETS):
        assert np.abs([found[f"FO_{j + 1}[{r + 1}]"] - own[j] for j in range(3)]).max() < NEAR
    theta = torque_parameters(base, fit)
    (unseen,) = recorded(OFFSETS.mean(axis=0)[None]).runs
    left = compare(model, theta, unseen, observations.band)
    assert np.sqrt(np.mean(left.residual[left.mask] ** 2)) < NOISE + NEAR
    together = WeightedLeastSquares().solve(EstimationProblem(information))
    assert together.residual_rms.max() > 5.0 * fit.residual_rms.max()
    said = drift_finding(model, fit)
    assert said is not None and said.code == "offset-drift" and "FO_1 0.9" in said.evidence
    assert drift_finding(model, together) is None


def test_offsets_that_agree_are_not_remarked():
    model, observations = arm(Hysteresis((0.01,))), recorded(np.zeros((2, 3)))
    base = find_base_parameters(model)
    information = accumulate_information(model, base, observations)
    apart = separate_by_recording(information, np.isin(information.names, offset_names(model)))
    assert drift_finding(model, WeightedLeastSquares().solve(EstimationProblem(apart))) is None


def test_recordings_that_cannot_show_an_offset_share_one():
    model = arm()
    assert not choose_friction(model, recorded(OFFSETS[:1])).offset_per_recording
    seconds, whole = recorded(OFFSETS[1:2], seconds=1.0).runs[0], recorded(OFFSETS[:1]).runs[0]
    assert not choose_friction(model, raw(whole, replace(seconds, recording=1))).offset_per_recording
    long = recorded(OFFSETS[:2]).runs
    mask = long[1].mask.copy()
    mask[:, 2] = False  # a joint that does not count in one of them
    assert not choose_friction(model, raw(long[0], replace(long[1], mask=mask))).offset_per_recording
    without = DynamicsModel(model.robot, model.terms[:3])
    assert not choose_friction(without, recorded(OFFSETS)).offset_per_recording
