"""A model is told where it is asked for speeds far beyond those that trained it."""

from __future__ import annotations

import numpy as np

from armid.study.extrapolation import highest_speeds, speed_finding
from problems import lively_motion, one_run, raw
from trees import robot_of, structured_tree


def test_a_joint_far_beyond_its_speeds_is_named_with_both():
    robot = robot_of(structured_tree(np.random.default_rng(1), 3, prismatic=0.0, branching=0.0))
    trained = np.array([1.0, 0.5, 2.0])
    assert speed_finding(robot, trained, 1.2 * trained, "other.csv") is None
    assert speed_finding(robot, None, 9.0 * trained, "other.csv") is None
    found = speed_finding(robot, trained, trained * [1.0, 3.0, 1.0], "other.csv")
    assert found is not None and found.code == "speed-beyond" and found.severity == "warning"
    assert "joint_2 reaches 1.5 rad/s, but only 0.5 rad/s in training" in found.evidence
    assert "other.csv" in found.evidence and "joint_1" not in found.evidence


def test_a_joint_that_rested_may_tremble():
    robot = robot_of(structured_tree(np.random.default_rng(1), 3, prismatic=0.0, branching=0.0))
    rested = np.zeros(3)
    assert speed_finding(robot, rested, np.full(3, 1e-6), "other.csv") is None
    found = speed_finding(robot, rested, np.array([1e-6, 0.1, 0.01]), "other.csv")
    assert found is not None and found.evidence.count("in training") == 1 and "joint_2" in found.evidence


def test_only_rows_that_count_have_trained():
    motion = lively_motion(np.random.default_rng(2), 2, 50.0, 10.0)
    run = one_run(motion, np.zeros_like(motion.q), 50.0, step=2)
    fastest = np.abs(motion.dq[::2]).argmax(axis=0)
    np.testing.assert_array_equal(highest_speeds(raw(run)), np.abs(motion.dq[::2]).max(axis=0))
    run.mask.setflags(write=True)
    run.mask[fastest[0], 0] = False
    assert highest_speeds(raw(run))[0] < np.abs(motion.dq[fastest[0] * 2, 0])
