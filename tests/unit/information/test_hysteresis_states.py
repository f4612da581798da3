"""Models that remember, along runs: states once a run, unknown rows left out, what cannot be remembered refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from armid.errors import ArmidError, ModelError
from armid.information.accumulate import accumulate_information
from armid.information.base_regressor_layout import column_source
from armid.information.filtered_rows import all_rows
from armid.information.hysteresis_states import memory_findings, with_hysteresis_states
from armid.information.residuals import compare
from armid.maths.signals.zero_phase_filters import edge_samples, low_pass
from armid.measurement.low_pass_band import Band
from armid.measurement.observations import Observations
from armid.model.base_parameters import find_base_parameters
from armid.model.dynamics_model import DynamicsModel
from armid.model.hysteresis_memory import Play
from armid.model.motion import Motion
from armid.model.terms import Hysteresis, LoadCoulomb, Offset, RigidBody, Viscous
from informed import RATE, dense, filtered, solved
from memories import dragged, joints_known_from
from problems import lively_motion, one_run, raw
from trees import random_inertial, random_tree, robot_of

WIDTHS = (0.02, 0.3)
PAD = Band("butterworth", 5.0, 4, "pad")

LEAK = 2e-2
"""Of the unknown state that a filter carries on: a hundredth of its kernel in the first row that counts, of a column
that may be wrong by 2."""


@pytest.fixture(scope="module")
def arm():
    """Two joints with hysteresis of two elements on the second; base parameters and their true values."""
    robot = robot_of(random_tree(np.random.default_rng(4), 2, prismatic=0.0, branching=0.0))
    model = DynamicsModel(robot, (RigidBody(), Viscous(), Offset(), Hysteresis(WIDTHS, ("joint_2",))))
    base = find_base_parameters(model)
    return model, base, np.random.default_rng(5).normal(size=base.count)


@pytest.fixture(scope="module")
def recorded(arm):
    """A motion, and the torque of an arm whose hysteresis began somewhere that nobody knows."""
    model, base, truth = arm
    motion = lively_motion(np.random.default_rng(6), 2, RATE, 12.0)
    q = motion.q[:, 1]
    past = np.column_stack([dragged(q, r, q[0] + share * r) for r, share in zip(WIDTHS, (1.0, -0.9), strict=True)])
    return motion, model.regressor(motion.with_memory(past))[:, :, base.kept] @ truth


def test_a_motion_keeps_its_memory(arm, recorded):
    model, motion = arm[0], model_motion(arm, recorded)
    assert motion.memory is not None and motion.memory.shape == (motion.samples, 2)
    part = motion[slice(30, 400, 7)]
    assert part.memory is not None and np.array_equal(part.memory, motion.memory[30:400:7])
    Y = model.regressor(motion)
    assert np.array_equal(model.regressor(part), Y[30:400:7])
    assert np.array_equal(model.regressor(recorded[0]), Y)  # a motion without memory is one run
    assert not np.array_equal(model.regressor(recorded[0][slice(30, 400, 7)]), Y[30:400:7])
    theta = np.arange(float(Y.shape[2]))
    assert np.array_equal(model.torque(motion, theta), model.torque(recorded[0], theta))
    assert recorded[0].memory is None


def model_motion(arm, recorded) -> Motion:
    return arm[0].remember(recorded[0])


def test_columns_without_memory_are_refused(arm, recorded):
    model, motion = arm[0], recorded[0]
    with pytest.raises(
        ModelError, match=r"'hysteresis' needs .* with 2 hysteresis states; the given motion has none"
    ):
        model.term_columns(motion)
    with pytest.raises(ModelError, match="has 1"):
        model.regressor(motion.with_memory(motion.q[:, :1]))
    assert len(model.term_columns(motion, np.arange(2)).values) == 2  # terms that remember nothing
    with pytest.raises(ArmidError, match="memory must have shape"):
        motion.with_memory(motion.q[:-1])


def test_nodes_are_shared_by_laws_of_one_coordinate(arm):
    twice = DynamicsModel(arm[0].robot, (Hysteresis((0.1, 0.2)), Viscous()))
    assert [(n.coordinate, n.memory, n.term) for n in twice.nodes] == [
        (((j, 1.0),), Play(r), "hysteresis") for j in range(2) for r in (0.1, 0.2)
    ]
    assert not DynamicsModel(arm[0].robot, (Viscous(),)).nodes


def test_what_remembers_nothing_is_left_alone(arm, recorded):
    plain = DynamicsModel(arm[0].robot, (RigidBody(), Viscous()))
    run = one_run(*recorded, RATE)
    assert with_hysteresis_states(plain, run, PAD) is run
    assert plain.remember(run.motion) is run.motion
    once = with_hysteresis_states(arm[0], run, PAD)
    assert with_hysteresis_states(arm[0], once, PAD) is once


@pytest.mark.parametrize(
    "band", [Band(), PAD, Band("butterworth", 5.0, 4, "periodic"), Band("fir", 5.0, columns=False)]
)
def test_rows_that_an_unknown_state_reaches_do_not_count(arm, recorded, band):
    model = arm[0]
    run = one_run(*recorded, RATE, step=3, offset=1)
    kept = with_hysteresis_states(model, run, band).mask
    since = joints_known_from(model, run.motion)
    assert since[0] == 0 < since[1] < 200
    assert kept[:, 0].all()
    reach = edge_samples(low_pass(band.family, band.order, band.cutoff, RATE)) if band.columns and band.cutoff else 0
    last = run.motion.samples - (reach if band.edges == "periodic" else 0)
    assert np.array_equal(kept[:, 1], (run.rows >= since[1] + reach) & (run.rows < last))


def test_the_truth_comes_back_whatever_the_arm_remembered_before(arm, recorded):
    model, base, truth = arm
    run = one_run(*recorded, RATE)
    assert solved(accumulate_information(model, base, raw(run))) == pytest.approx(truth, abs=1e-9)
    states = model.remember(run.motion)  # its mask is not touched, so the guess at the beginning counts
    fooled = solved(accumulate_information(model, base, raw(replace(run, motion=states))))
    assert np.abs(fooled - truth).max() > 1e-3
    theta = np.zeros(len(model.parameters))
    theta[base.kept] = truth
    for band, tolerance in ((Band(), 1e-9), (PAD, LEAK)):
        found = compare(model, theta, run, band)
        residual = np.where(found.mask, found.residual, 0.0)
        assert not found.mask.all() and np.abs(residual).max() <= tolerance
        assert np.abs(found.residual_raw).max() > 0.1


def test_second_passes_see_the_same_rows(arm, recorded):
    model, base, _ = arm
    run = one_run(*recorded, RATE, step=2)
    source = column_source(model, base)
    for band in (Band(), PAD):
        x = all_rows(source, run, band)
        rows = filtered(arm, run, band) if band.cutoff else dense(arm, run)[run.rows]
        for j, parameters in enumerate(source.layout.parameters):
            own = x[source.layout.offset[j] : source.layout.offset[j + 1]]
            assert np.abs(own.T - rows[:, j][:, [*parameters, base.count]]).max() <= 1e-7 * np.abs(rows[:, j]).max()
        assert np.array_equal(x, all_rows(source, with_hysteresis_states(model, run, band), band))


def test_samples_that_do_not_follow_each_other_are_refused(arm, recorded):
    model, base, _ = arm
    theta = np.zeros(len(model.parameters))
    loose = replace(one_run(*recorded, RATE), consecutive=False, recording=2)
    for call in (
        lambda: accumulate_information(model, base, raw(loose)),
        lambda: compare(model, theta, loose, PAD),
        lambda: all_rows(column_source(model, base), loose, PAD),
    ):
        with pytest.raises(ArmidError, match=r"'hysteresis'.* recording 3 are not consecutive"):
            call()


def test_a_joint_that_does_not_move_far_enough_is_named(arm, recorded):
    _, base, _ = arm
    robot = arm[0].robot
    motion, torque = recorded
    model = DynamicsModel(robot, (RigidBody(), Hysteresis((0.1, 40.0), ("joint_2",))))
    run = one_run(motion, torque, RATE)
    base = find_base_parameters(model)
    with pytest.raises(ArmidError, match=r"No row of joint_2 remains.* 80 rad"):
        accumulate_information(model, base, raw(run))
    (finding,) = memory_findings(model, raw(run))
    assert (finding.code, finding.severity, finding.channel) == ("memory-unknown", "warning", "joint_2")
    assert f"{motion.samples} of {motion.samples} rows" in finding.evidence
    assert memory_findings(arm[0], raw(run)) == ()
    assert memory_findings(DynamicsModel(robot, (Viscous(),)), raw(run)) == ()


def test_a_run_in_which_a_joint_rests_leaves_the_others_their_say(arm, recorded):
    model, base, _ = arm
    motion, torque = recorded
    still = motion.q * [1.0, 0.0]
    resting = Motion(motion.time, still, motion.dq * [1.0, 0.0], motion.ddq * [1.0, 0.0])
    runs = Observations((one_run(motion, torque, RATE), one_run(resting, 0.0 * torque, RATE)), Band())
    information = accumulate_information(model, base, runs)
    assert information.rows[information.run == 1].sum(axis=0).tolist() == [motion.samples, 0]


# Load ----------------------------------------------------------------------------------------------------------


def test_the_load_is_the_torque_of_the_bodies_of_an_earlier_estimate(arm, recorded):
    robot, (motion, _) = arm[0].robot, recorded
    bodies = random_inertial(np.random.default_rng(0), 2)
    model = DynamicsModel(robot, (RigidBody(), LoadCoulomb(0.1)), bodies)
    theta = np.zeros(len(model.parameters))
    theta[model.law_columns] = [0.3, 0.2]
    load = DynamicsModel(robot, (RigidBody(),)).torque(motion, bodies.ravel())
    assert model.torque(motion, theta) == pytest.approx(
        np.abs(load) * np.tanh(motion.dq / 0.1) * [0.3, 0.2], rel=1e-12
    )


def test_a_load_that_is_not_known_is_asked_for(arm, recorded):
    model = DynamicsModel(arm[0].robot, (RigidBody(), LoadCoulomb()))
    base = find_base_parameters(model)  # the structure needs no load
    with pytest.raises(ModelError, match="'load-coulomb' depends on the load") as caught:
        accumulate_information(model, base, raw(one_run(*recorded, RATE)))
    assert "first identify without 'load-coulomb'" in caught.value.remedy
    with pytest.raises(ArmidError, match="load_parameters must have shape"):
        replace(model, load_parameters=np.zeros((3, 10)))
