"""Rests of single joints: found by creep, left out while other joints move, and no evidence for hysteresis."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from armid.checked_array import Array
from armid.information.hysteresis_states import with_hysteresis_states, without_creep
from armid.information.joint_rests import resting_rows, rests
from armid.measurement.observations import ObservedRun
from armid.model.dynamics_model import DynamicsModel
from armid.model.motion import Motion
from armid.model.terms import Hysteresis
from problems import one_run, raw
from trees import random_tree, robot_of

RATE, SECONDS = 100.0, 12.0
BEGIN, END = 400, 550
"""Samples between which the second joint creeps by 0.01 rad/s, of 0.9 rad/s."""


def creeping() -> ObservedRun:
    """Two joints at about 1 rad/s, of which the second creeps for 1.5 s, and both rest at the end."""
    time = np.arange(int(SECONDS * RATE)) / RATE
    dq = np.column_stack([np.cos(3.0 * time), np.cos(5.0 * time)])
    dq[BEGIN:END, 1] = 0.01
    dq[1000:] = 0.0
    q = np.cumsum(dq, axis=0) / RATE
    motion = Motion(time, q, dq, np.gradient(dq, time, axis=0))
    return one_run(motion, np.zeros_like(q), RATE)


def marked(run: ObservedRun, mask: Array) -> set[int]:
    return set(run.rows[np.flatnonzero(mask)].tolist())


def test_creep_is_a_rest():
    found = rests(creeping())
    assert [each.tolist() for each in found] == [[[1000, 1200]], [[BEGIN, END], [1000, 1200]]]


def test_rows_of_a_joint_that_creeps_while_another_moves_are_left_out():
    run = creeping()
    (left,) = without_creep(raw(run)).runs
    gone = run.mask & ~left.mask
    assert not gone[:, 0].any() and marked(run, gone[:, 1]) == set(range(BEGIN, END)) & set(run.rows.tolist())
    separate = replace(run, consecutive=False)
    assert not resting_rows(separate, raw(run).band).any()


def test_memory_is_unknown_from_a_rest_until_the_joint_has_moved_on():
    run, width = creeping(), 0.03
    model = DynamicsModel(robot_of(random_tree(np.random.default_rng(4), 2, prismatic=0.0)), (Hysteresis((width,)),))
    known = with_hysteresis_states(model, run, raw(run).band)
    gone = run.mask & ~known.mask
    moved = np.abs(run.motion.q[END - 1 :, 1] - run.motion.q[END - 1, 1]) > 2.0 * width
    again = END - 1 + int(np.argmax(moved))
    assert END < again < END + 100
    unknown = marked(run, gone[:, 1])
    assert set(range(BEGIN, again)) & set(run.rows.tolist()) <= unknown
    assert not unknown & set(range(again, 1000))
    assert marked(run, gone[:, 0]) >= set(range(1000, 1200)) & set(run.rows.tolist())  # the rest at the end
