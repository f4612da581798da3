"""The virtual lab and the plans that armid brings along."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from armid.errors import ArmidError
from armid.excitation.fourier import Excitation, load_plan, save_plan
from armid.excitation.thesis_plans import PLANS, builtin_plan
from armid.lab.inverse_dynamics_recording import THESIS_FRICTION, Sensors, record, thesis_truth
from armid.model.dynamics_model import DynamicsModel
from armid.model.terms import Coulomb, Offset, RigidBody, Viscous
from armid.robot import load_robot
from labs import PERIOD, RATE, small_model, small_plan, small_truth

SILENT = Sensors(position=0.0, torque=0.0, rate=RATE)


def test_without_noise_the_motion_is_exact_and_repeats():
    recording, motion, torque = record(
        small_model(), small_truth(), small_plan(1), SILENT, np.random.default_rng(0), repetitions=3
    )
    exact = small_plan(1).sample(RATE)
    np.testing.assert_array_equal(motion.q, exact.q)
    np.testing.assert_array_equal(torque, small_model().torque(exact, small_truth()))
    np.testing.assert_array_equal(recording.q, np.tile(exact.q, (3, 1)))
    np.testing.assert_array_equal(recording.effort, np.tile(torque, (3, 1)))  # pyright: ignore
    assert recording.time is not None and recording.joint_names == small_model().robot.joint_names
    np.testing.assert_allclose(recording.time, np.arange(3 * PERIOD * RATE) / RATE, rtol=0, atol=1e-12)
    assert recording.consecutive and recording.dq is None and recording.source == "virtual small"


def test_a_period_between_samples_goes_on_without_a_jump():
    """8 s at 99.9 Hz are 799.2 samples: the second repetition is sampled elsewhere on the same path."""
    sensors = Sensors(position=0.0, torque=0.0, rate=99.9)
    rng = np.random.default_rng(0)
    recording, motion, torque = record(small_model(), small_truth(), small_plan(1), sensors, rng, repetitions=3)
    assert motion.samples == len(torque) == 799 and recording.samples == 2398
    exact = small_plan(1).at(np.arange(2398) / 99.9)
    np.testing.assert_allclose(recording.q, exact.q, rtol=0, atol=1e-12)
    np.testing.assert_allclose(recording.effort, small_model().torque(exact, small_truth()), rtol=0, atol=1e-9)  # pyright: ignore


def test_noise_is_as_large_as_said_and_new_in_every_repetition():
    sensors = Sensors(position=1e-3, torque=0.5, rate=RATE)
    recording, motion, torque = record(
        small_model(), small_truth(), small_plan(1), sensors, np.random.default_rng(0), repetitions=4
    )
    assert recording.effort is not None
    for noise, deviation in (
        (recording.q - np.tile(motion.q, (4, 1)), 1e-3),
        (recording.effort - np.tile(torque, (4, 1)), 0.5),
    ):
        assert noise.std() == pytest.approx(deviation, rel=0.03)  # 9600 samples
        first, second = noise[:800].ravel(), noise[800:1600].ravel()
        assert abs(np.corrcoef(first, second)[0, 1]) < 0.1


def test_the_digest_is_that_of_the_data():
    def sha256(seed: int) -> str:
        rng = np.random.default_rng(seed)
        return record(small_model(), small_truth(), small_plan(1), Sensors(rate=RATE), rng)[0].sha256

    assert sha256(1) == sha256(1) != sha256(2)


def test_the_truth_of_the_thesis_is_the_description_with_friction_of_table_4_1():
    robot = load_robot("iiwa14-r820")
    model = DynamicsModel(robot, (RigidBody(), Viscous(), Coulomb(), Offset()))
    truth = thesis_truth(model)
    by_name = {parameter.name: value for parameter, value in zip(model.parameters, truth, strict=True)}
    assert (by_name["FV_1"], by_name["FS_7"], by_name["FO_3"]) == (28.404, 3.030, 0.0)
    assert [by_name[f"FV_{j}"] for j in range(1, 8)] == list(THESIS_FRICTION["FV"])
    nominal = model.nominal_parameters()
    assert nominal is not None
    np.testing.assert_array_equal(truth[model.inertial_columns], nominal[model.inertial_columns])


# Plans -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("name", "harmonics"), [("thesis-a1", 10), ("thesis-a2", 5)])
def test_plans_of_the_thesis(name: str, harmonics: int):
    plan = builtin_plan(name)
    assert (plan.n, plan.harmonics) == (7, harmonics) and plan.period == pytest.approx(20.0)
    assert PLANS.get(name)


def test_an_unknown_plan_lists_the_known_ones():
    with pytest.raises(ArmidError, match="no built-in plan 'thesis-a3'") as caught:
        builtin_plan("thesis-a3")
    assert caught.value.possible == "thesis-a1, thesis-a2"


PLAN = {"robot": "arm", "base_frequency": 1.0, "offset": [0.0], "a": [[0.1]], "b": [[0.2]]}


@pytest.mark.parametrize(
    "content",
    [
        "",
        "[1, 2]",
        "3",
        json.dumps({name: value for name, value in PLAN.items() if name != "offset"}),
        json.dumps(PLAN | {"base_frequency": "fast"}),
        json.dumps(PLAN | {"base_frequency": None}),
        json.dumps(PLAN | {"base_frequency": 0.0}),
        json.dumps(PLAN | {"a": "none"}),
        json.dumps(PLAN | {"a": [[0.1], [0.2]]}),
        json.dumps(PLAN | {"b": [[None]]}),
    ],
)
def test_what_is_no_plan_is_refused(tmp_path: Path, content: str):
    path = tmp_path / "plan.json"
    path.write_text(content)
    with pytest.raises(ArmidError):
        load_plan(path)


def test_a_plan_survives_its_file(tmp_path: Path):
    plan = small_plan(1)
    found = load_plan(save_plan(plan, tmp_path / "plan.json"))
    assert isinstance(found, Excitation) and found.robot == "small"
    np.testing.assert_array_equal(found.sample(RATE).ddq, plan.sample(RATE).ddq)
