"""A model called for one sample at a time."""

from __future__ import annotations

import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from armid.codegen.functions import make_programs
from armid.codegen.operation_tape import make_tape, record_tape
from armid.errors import ArmidError
from armid.kernel import _native, in_use
from armid.model.base_parameters import find_base_parameters
from armid.model.dynamics_model import DynamicsModel
from armid.model.motion import Motion
from armid.model.terms import Coulomb, Offset, RigidBody, Viscous
from armid.robot import load_robot
from armid.runs.callable_model import CallableModel
from armid.runs.validation_and_prediction import predict
from coded import ARMS, case
from reports import make_run
from trees import random_states

MICROSECONDS = 10.0
"""Longest time of one call, with friction, on the iiwa [µs]."""


def plain() -> tuple[CallableModel, tuple[np.ndarray, ...]]:
    each = case("iiwa14-r820")
    model = CallableModel(each.model, each.base, each.values)
    return model, (each.motion.q[0], each.motion.dq[0], each.motion.ddq[0])


@pytest.mark.parametrize("name", ARMS)
def test_every_function_along_a_motion(name: str):
    each = case(name)
    model, motion = CallableModel(each.model, each.base, each.values), each.motion
    assert model.joints == each.model.robot.joint_names
    found: dict[str, list[np.ndarray]] = {x: [] for x in each.expected if x not in ("regressor", "base_regressor")}
    if "ddq" in each.arguments.get("forward_dynamics", ()):
        del found["forward_dynamics"]  # friction here is larger than the load, so that iterations diverge
    memory = model.memory(motion.q[0])
    for k, (q, dq, ddq) in enumerate(zip(motion.q, motion.dq, motion.ddq, strict=True)):
        memory.update(q)
        tau, dq_r, ddq_r = (each.inputs[name][k] for name in ("tau", "dq_r", "ddq_r"))
        if "forward_dynamics" in found:
            found["forward_dynamics"].append(model.acceleration(q, dq, tau, memory))
        found["coriolis_torque"].append(model.coriolis(q, dq))
        found["bias_torque"].append(model.bias(q, dq))
        found["coriolis_matrix"].append(model.coriolis_matrix(q, dq))
        found["slotine_li_regressor"].append(model.slotine_li_regressor(q, dq, dq_r, ddq_r, memory))
        found["inverse_dynamics"].append(model.torque(q, dq, ddq, memory))
        found["gravity_torque"].append(model.gravity(q))
        found["mass_matrix"].append(model.mass_matrix(q))
        found["friction"].append(model.friction(q, dq, ddq, memory))
    arrays = {x: np.array(results) for x, results in found.items()}
    each.compare({**each.expected, **arrays})


def test_what_is_no_array_of_doubles_is_converted():
    model, (q, dq, ddq) = plain()
    expected = model.torque(q, dq, ddq)
    assert (model.torque(q.tolist(), dq, tuple(ddq)) == expected).all()
    assert (model.torque(np.repeat(q, 2)[::2], dq, ddq) == expected).all()
    single = q.astype(np.float32)
    assert (model.torque(single, dq, ddq) == model.torque(single.astype(float), dq, ddq)).all()


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        (np.zeros(6), "dq must have shape"),
        (np.zeros((7, 1)), "dq"),
        (np.array([0.0] * 6 + [np.nan]), "dq must be finite"),
        (np.array([np.inf] + [0.0] * 6), "dq must be finite"),
        ([0.0] * 8, "dq"),
        ([0.0] * 6 + [float("nan")], "dq"),
        ("seven", "dq"),
        (None, "dq"),
    ],
)
def test_bad_input_is_refused_by_name(wrong: object, message: str):
    model, (q, _, ddq) = plain()
    with pytest.raises(ArmidError, match=message):
        model.torque(q, wrong, ddq)  # pyright: ignore[reportArgumentType]


def test_results_are_the_callers_own():
    model, state = plain()
    first = model.torque(*state)
    kept = first.copy()
    first[:] = 0.0
    assert (model.torque(*state) == kept).all()


def test_memory_is_asked_for_and_kept_apart():
    each = case("tree-1")
    model = CallableModel(each.model, each.base, each.values)
    q, dq, ddq = each.motion.q, each.motion.dq[0], each.motion.ddq[0]
    with pytest.raises(ArmidError, match="no memory was given"):
        model.torque(q[0], dq, ddq)
    one, other = model.memory(q[0]), model.memory(q[0])
    one.update(q[1])
    assert (one.state != other.state).any()
    before = one.state.copy()
    with pytest.raises(ArmidError, match="q must be finite"):
        one.update(np.full(5, np.nan))
    assert (one.state == before).all()


def test_threads_share_a_model():
    model, (q, dq, ddq) = plain()
    inputs = [(q + 0.01 * k, dq, ddq) for k in range(500)]
    expected = [model.torque(*each) for each in inputs]
    with ThreadPoolExecutor(4) as pool:
        found = list(pool.map(lambda each: [model.torque(*each) for _ in range(5)], inputs))
    assert all((x == y).all() for results, y in zip(found, expected, strict=True) for x in results)


@pytest.mark.skipif(in_use() == "numpy", reason="speed is the compiled kernel's")
def test_a_call_takes_microseconds():
    model = DynamicsModel(load_robot("iiwa14-r820"), (RigidBody(), Viscous(), Coulomb(0.02), Offset()))
    base = find_base_parameters(model)
    quick, state = CallableModel(model, base, np.ones(base.count)), np.ones((3, 7))
    q, dq, ddq = state
    best = np.inf
    for _ in range(5):  # the machine may be busy: the best of five
        began = time.thread_time()
        for _ in range(1000):
            quick.torque(q, dq, ddq)
        best = min(best, time.thread_time() - began)
    assert best / 1000 * 1e6 < MICROSECONDS


def test_a_loaded_run_predicts_as_before(tmp_path: Path):
    run = make_run(tmp_path)
    model, rng = CallableModel.of(run), np.random.default_rng(0)
    motion = Motion.of_states(*random_states(rng, 20, run.robot.n))
    found = np.array([model.torque(*state) for state in zip(motion.q, motion.dq, motion.ddq, strict=True)])
    expected = predict(run, motion)
    np.testing.assert_allclose(found, expected, atol=1e-12 * np.abs(expected).max())


def test_the_kernel_refuses_a_tape_that_reads_ahead():
    each = case("ur5e")
    (program,) = make_programs(each.model, each.base, ["gravity_torque"])
    record = record_tape(program, {"parameters": each.values})
    ahead = record.operands.copy()
    ahead[0, 0] = int(record.sizes.sum()) + len(record.constants)  # the first operation itself
    with pytest.raises(ValueError, match="before what reads it"):
        _native.Tape(record.sizes, record.constants, record.runs, ahead, record.results)
    out = np.empty(6)
    assert make_tape(program, {"parameters": each.values}).run(out, each.motion.q[0]) == 0
    np.testing.assert_allclose(out, each.expected["gravity_torque"][0], atol=1e-12 * np.abs(out).max())
