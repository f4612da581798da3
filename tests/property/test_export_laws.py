"""Laws of exports on random trees: what is written is what is read, in every format."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from armid import kernel
from armid.export.catalogue import EXPORTERS
from armid.export.types import Content
from armid.export.write import export_run
from armid.model.dynamics_model import DynamicsModel
from armid.model.motion import Motion
from armid.robot import InertialParameters, Link, Robot, load_robot
from exports import run_of
from trees import random_inertial, random_states, random_tree, robot_of, structured_tree

TOLERANCE = 1e-12
"""Of the largest torque: numbers lose nothing, turning tensors into other frames a few digits' rounding."""


def random_robot(seed: int, n: int) -> Robot:
    rng = np.random.default_rng(seed)
    tree = (random_tree if seed % 2 else structured_tree)(rng, n)
    links = [Link(f"link_{i}", InertialParameters.from_vector(v)) for i, v in enumerate(random_inertial(rng, n))]
    return replace(robot_of(tree), links=tuple(links))


def content_of(robot: Robot, seed: int) -> Content:
    rng = np.random.default_rng(seed)
    terms = ("viscous", "coulomb", "rotor-inertia")
    return Content(robot, {name: dict(zip(terms, rng.uniform(0, 5, 3), strict=True)) for name in robot.joint_names})


def largest(x: np.ndarray) -> float:
    return float(np.abs(x).max())


@pytest.mark.witness
@pytest.mark.parametrize("to", EXPORTERS)
@settings(max_examples=8)
@given(seed=st.integers(0, 2**20), n=st.integers(1, 7))
def test_a_file_of_its_own_gives_the_torque_back(to: str, seed: int, n: int):
    robot, exporter = random_robot(seed, n), EXPORTERS[to]
    content = content_of(robot, seed)
    content = replace(content, joints={k: {t: v[t] for t in exporter.PLACES} for k, v in content.joints.items()})
    data = exporter.write(content).data
    q, dq, ddq = random_states(np.random.default_rng(seed), 5, n)
    wanted = kernel.inverse_dynamics(robot.tree, np.array(robot.inertial_vector), q, dq, ddq)
    found = exporter.read(data, {}).with_gravity(robot.gravity)
    order = [found.joint_index(name) for name in robot.joint_names]
    back = np.argsort(order)
    read = kernel.inverse_dynamics(
        found.tree, np.array(found.inertial_vector), q[:, back], dq[:, back], ddq[:, back]
    )[:, order]
    assert largest(read - wanted) <= TOLERANCE * largest(wanted)
    for witness in exporter.witnesses(data, content, q, dq, ddq):
        if witness.torque is not None:
            assert largest(witness.torque - wanted) <= TOLERANCE * largest(wanted)
        else:
            assert to == "sdf"
        for name, values in witness.joints.items():
            assert values == {term: content.joints[name][term] for term in values}


@pytest.mark.parametrize("to", ["urdf", "mjcf"])
@settings(max_examples=6)
@given(seed=st.integers(0, 2**20), n=st.integers(2, 6), standard=st.booleans(), locks=st.booleans())
def test_an_edited_description_gives_the_torque_of_the_estimate(
    to: str, seed: int, n: int, standard: bool, locks: bool
):
    """Whatever bodies were chosen, and whatever is locked, the file's torque is that of the base values."""
    robot, exporter = random_robot(seed, n), EXPORTERS[to]
    with TemporaryDirectory() as folder:
        source = Path(folder) / f"first{exporter.SUFFIX}"
        source.write_bytes(exporter.write(Content(robot, {})).data)
        locked = {"joint_2": 0.4} if locks else {}
        run = run_of(Path(folder) / "run", source, seed=seed, locked=locked, standard=standard)
        exported = export_run(run, to)
        assert exported.standard in (("estimated", "nearest") if standard else ("nearest",))
        found = load_robot(exported.path, locked=locked).with_gravity(run.robot.gravity)
        theta = np.zeros(len(run.model.parameters))
        theta[run.estimate.base.kept] = run.estimate.fit.values
        motion = Motion(np.arange(5.0), *random_states(np.random.default_rng(seed), 5, run.robot.n))
        said = json.loads(exported.side.read_text())["parameters"]
        beside = np.array([0.0 if each["term"] == "rigid-body" else each["value"] for each in said])
        beside[run.model.inertial_columns] = np.array(found.inertial_vector).ravel()
        wanted = run.model.torque(motion, theta)
        read = DynamicsModel(found, run.model.terms).torque(motion, beside)
        assert largest(read - wanted) <= 1e-9 * largest(wanted)  # of the regrouping, 1e-12 and its condition
