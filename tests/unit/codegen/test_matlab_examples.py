"""The closed loop and the Simulink blocks beside generated MATLAB code, run by GNU Octave."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import numpy as np
import pytest

from armid.codegen.generation import generate
from armid.codegen.language_input import identifier
from armid.model.base_parameters import find_base_parameters
from armid.model.dynamics_model import DynamicsModel
from armid.model.terms import Coulomb, Hysteresis, LoadCoulomb, Offset, RigidBody, RotorInertia, Viscous
from coded import OCTAVE, write_files
from trees import random_inertial, random_tree, robot_of

RUN_BY_OCTAVE = pytest.mark.skipif(OCTAVE is None, reason="GNU Octave (octave-cli) is not installed")

REACHED = 1e-3
"""Largest error [rad or m] after half a second: it began at 0.05 and falls by exp(-10) · 11, and a torque that is
held for a millisecond adds to it."""

PLAIN = (RigidBody(), Viscous(), Coulomb(0.1), Offset(), RotorInertia())
DEPENDENT = (RigidBody(), Viscous(), Hysteresis((0.1,)), LoadCoulomb(0.1))


def small_arm(terms: tuple) -> tuple[DynamicsModel, np.ndarray]:
    """A tree of three joints with friction as small as that of arms."""
    rng = np.random.default_rng(12)
    model = DynamicsModel(robot_of(random_tree(rng, 3)), terms, random_inertial(rng, 3))
    theta = 0.05 * np.abs(rng.normal(size=len(model.parameters)))
    theta[model.inertial_columns] = random_inertial(rng, 3).ravel()
    return model, theta


def octave(folder: Path, statements: str) -> str:
    (folder / "try.m").write_text(f"{statements}\n")
    done = subprocess.run([str(OCTAVE), "try.m"], cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


@RUN_BY_OCTAVE
@pytest.mark.parametrize("terms", [PLAIN, DEPENDENT], ids=["plain", "hysteresis and load"])
def test_the_closed_loop_follows_its_reference(terms: tuple, tmp_path: Path):
    model, theta = small_arm(terms)
    base = find_base_parameters(model)
    write_files(generate(model, base, base.values_of(theta), "matlab"), tmp_path)
    name = identifier(model.robot.name)
    told = octave(tmp_path, f"closed_loop(); [t, e] = closed_loop(0.2, 0.7 * {name}.parameters()); disp(size(e));")
    errors = [float(x) for x in re.findall(r"last half: (\S+) rad", told)]
    assert len(errors) == 2 and errors[0] <= REACHED < errors[1]
    assert re.search(r"3\s+201", told)


@RUN_BY_OCTAVE
def test_the_closed_loop_refuses_bodies_that_cannot_exist(tmp_path: Path):
    model, theta = small_arm(PLAIN)
    base = find_base_parameters(model)
    write_files(generate(model, base, -base.values_of(theta), "matlab"), tmp_path)
    with pytest.raises(AssertionError, match="not positive definite"):
        octave(tmp_path, "closed_loop(0.01);")


@RUN_BY_OCTAVE
@pytest.mark.parametrize("terms", [PLAIN, DEPENDENT], ids=["plain", "hysteresis and load"])
def test_the_blocks_are_the_functions(terms: tuple, tmp_path: Path):
    model, theta = small_arm(terms)
    base = find_base_parameters(model)
    files = write_files(generate(model, base, base.values_of(theta), "matlab"), tmp_path)
    assert (
        (files / "inverse_dynamics_block.m")
        .read_text()
        .startswith("function tau = inverse_dynamics_block(q, dq, ddq)")
    )
    load = ", ddq" if terms is DEPENDENT else ""
    told = octave(
        tmp_path,
        "q = [0.3; -0.2; 0.1]; dq = [1; 2; -1]; ddq = [3; -2; 4];\n"
        f"for k = 1:3, tau = inverse_dynamics_block(q, dq, ddq); a = forward_dynamics_block(q, dq, tau{load});\n"
        "printf('%.3g\\n', max(abs(a - ddq))); q = q + 0.3; end",
    )
    assert len(told.split()) == 3 and max(map(float, told.split())) <= 1e-9


def test_without_masses_there_is_no_simulation():
    model = DynamicsModel(small_arm(PLAIN)[0].robot, (Viscous(), Coulomb(0.1)))
    base = find_base_parameters(model)
    files = generate(model, base, np.ones(base.count), "matlab")
    assert "inverse_dynamics_block.m" in files and not {"closed_loop.m", "forward_dynamics_block.m"} & set(files)
