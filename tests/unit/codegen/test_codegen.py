"""Arithmetic on symbols, programs, names, and the functions of the thesis."""

from __future__ import annotations

import ast
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from armid.codegen.functions import make_programs
from armid.codegen.generation import generate
from armid.codegen.graph import Graph, Node, call
from armid.codegen.language_input import identifier, make_source
from armid.codegen.program import Argument, Program
from armid.codegen.term_laws import carried_out
from armid.codegen.thesis_functions import thesis_order, thesis_programs
from armid.errors import ModelError, OutputError
from armid.model.base_parameters import find_base_parameters
from armid.model.dynamics_model import DynamicsModel
from armid.model.motion import Motion
from armid.model.terms import Coulomb, LoadViscous, RigidBody, Viscous
from armid.model.torque_law_expression import Expression, symbol
from armid.robot import load_robot
from coded import CC, OCTAVE, STRICT, write_files
from trees import random_inertial, random_states, robot_of


def symbols(count: int = 3):
    return Graph().symbols("x", count)


def test_what_is_known_of_numbers_is_done_at_once():
    a, b, _ = symbols()
    assert isinstance(0.0 * a, float) and 0.0 * a == 0.0
    assert 1.0 * a is a and a + 0.0 is a and 0.0 - (0.0 - a) is a and a - a == 0.0
    assert 2.0 * (3.0 * a) is 6.0 * a
    assert a + a is 2.0 * a
    assert call("cos", 0.0) == 1.0 and call("pow", a, 2.0) is a * a and call("pow", a, 1.0) is a
    assert b * a is a * b and b + a is a + b


def test_signs_stand_in_front():
    a, b, _ = symbols()
    negative = -a
    assert -negative is a
    assert b - a is -(a - b) and a + -b is a - b and -a - b is -(a + b)
    assert (-a) * b is -(a * b) and (-2.0) * a is -(2.0 * a) and (-a) * (-b) is a * b
    assert call("sin", -a) is -call("sin", a) and call("cos", -a) is call("cos", a)


def test_operations_on_the_same_are_the_same():
    a, b, c = symbols()
    assert (a + b) * c is (b + a) * c
    assert call("tanh", a * b) is call("tanh", b * a)
    assert call("max", a, b) is call("max", b, a)
    assert a - 1.0 is not 1.0 - a


def test_a_difference_is_turned_round_where_only_its_negative_is_read():
    a, b, c = symbols()
    argument = Argument("x", 3, "")
    program = Program("f", "", (argument,), (1,), {0: c * (b - a)}, "y")
    assert dict(program.operations) == {"sub": 1, "mul": 1, "neg": 1}  # the sign of a product stands in front
    program = Program("f", "", (argument,), (1,), {0: b - a}, "y")
    assert dict(program.operations) == {"sub": 1}
    both = Program("f", "", (argument,), (2,), {0: b - a, 1: call("exp", a - b)}, "y")
    assert dict(both.operations) == {"sub": 1, "neg": 1, "exp": 1}
    np.testing.assert_allclose(both.evaluate({"x": [1.0, 3.0, 0.0]}), [2.0, np.exp(-2.0)])


def test_only_what_the_result_needs_is_done():
    a, b, _ = symbols()
    unused = a * b
    assert isinstance(unused, Node)
    program = Program("f", "", (Argument("x", 3, ""),), (2,), {0: 0.0, 1: a + b}, "y")
    assert dict(program.operations) == {"add": 1} and program.reads == {"x"}
    assert program.evaluate({"x": np.ones((4, 3))}).tolist() == [[0.0, 2.0]] * 4


def test_base_parameters_cost_less_than_standard_ones():
    """Zero and removed columns cost nothing, and gravity costs less than the whole."""
    model = DynamicsModel(load_robot("iiwa14-r820"), (RigidBody(),))
    base = find_base_parameters(model)
    counts = {program.name: program.operations.total() for program in make_programs(model, base)}
    assert counts["inverse_dynamics"] <= 640
    assert counts["gravity_torque"] < counts["mass_matrix"] < counts["inverse_dynamics"] < counts["base_regressor"]
    assert counts["base_regressor"] < 0.85 * counts["regressor"]


def test_an_unknown_function_of_a_law_is_refused():
    with pytest.raises(ModelError, match="contains the function 'arctan'"):
        carried_out(Expression("arctan", (symbol("q"),)), {"q": 1.0})


def test_unknown_names_are_refused():
    model = DynamicsModel(load_robot("ur5e"), (Viscous(),))
    base = find_base_parameters(model)
    with pytest.raises(OutputError, match="'fortran'"):
        generate(model, base, np.ones(6), "fortran")
    with pytest.raises(ModelError, match="'hessian'"):
        make_programs(model, base, ["hessian"])


def test_a_load_that_is_not_known_is_refused():
    model = DynamicsModel(load_robot("ur5e"), (RigidBody(), LoadViscous()))
    base = find_base_parameters(model)
    with pytest.raises(ModelError, match="depends on the load"):
        make_programs(model, base, ["friction"])


@pytest.mark.parametrize(
    ("name", "plain"),
    [
        ("iiwa14-r820", "iiwa14_r820"),
        ("7dof arm", "arm_7dof_arm"),
        ("class", "arm_class"),
        ("Ä", "arm"),
        ("end", "arm_end"),
    ],
)
def test_names_of_code(name: str, plain: str):
    assert identifier(name) == plain


@pytest.mark.parametrize("language", ["c", "cpp", "python"])
def test_names_from_a_description_stay_in_comments(language: str, tmp_path: Path):
    """A joint may be called anything; none of it becomes code."""
    tree = load_robot("ur5e").tree
    wild = 'x*/ int hidden; /* """ \\\n int more; ?\u003f/'
    robot = robot_of(tree)
    robot = replace(robot, name=wild, joints=(replace(robot.joints[0], name=wild), *robot.joints[1:]))
    model = DynamicsModel(robot, (Viscous(),))
    files = generate(model, find_base_parameters(model), np.ones(6), language, heading=(wild,))
    write_files(files, tmp_path)
    if language == "python":
        (text,) = files.values()
        assert {type(node).__name__ for node in ast.parse(text).body} <= {"Expr", "Assign", "FunctionDef"}
    elif CC is not None:
        name = next(file for file in files if file.endswith(".c"))
        subprocess.run([CC, "-std=c99", *STRICT, "-c", name], cwd=tmp_path, check=True)
        assert not any("*/ int" in text for text in files.values())


def thesis_case():
    model = DynamicsModel(load_robot("iiwa14-r820"), (RigidBody(), Viscous(), Coulomb()))
    base = find_base_parameters(model)
    rng = np.random.default_rng(2)
    theta = rng.normal(size=len(model.parameters))
    theta[model.inertial_columns] = random_inertial(rng, 7).ravel()
    return model, base, theta


def physical(inertial: np.ndarray) -> np.ndarray:
    """m, r, and Ixx Ixy Ixz Iyy Iyz Izz about the centre of mass, by the parallel axes."""
    m, r = inertial[0], inertial[1:4] / inertial[0]
    xx, xy, yy, xz, yz, zz = inertial[4:]
    about = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) - m * (r @ r * np.eye(3) - np.outer(r, r))
    return np.array([m, *r, *about[np.triu_indices(3)]])


def test_functions_of_the_thesis():
    model, base, theta = thesis_case()
    source = make_source(model, base, base.values_of(theta))
    programs = {program.name: program for program, _ in thesis_programs(source)}
    names = [source.columns[k] for k in thesis_order(source)]
    assert " ".join(names[12:24]) == "M_2 MX_2 MY_2 MZ_2 XX_2 XY_2 XZ_2 YY_2 YZ_2 ZZ_2 FV_2 FS_2"
    assert {name: program.shape for name, program in programs.items()} == {
        "func_Y": (7, 84), "func_Y_b": (7, 57), "func_pi": (84,), "func_pi_b": (57,),
    }  # fmt: skip
    friction = theta[model.law_columns].reshape(7, 2)
    links = zip(theta[model.inertial_columns].reshape(7, 10), friction, strict=True)
    mu = np.concatenate([[*physical(body), *own] for body, own in links])
    q, dq, ddq = random_states(np.random.default_rng(3), 9, 7)
    states = {"q": q, "dq": dq, "ddq": ddq}
    pi = programs["func_pi"].evaluate({"mu": mu})
    torque = model.torque(Motion.of_states(q, dq, ddq), theta)
    scale = np.abs(torque).max()
    np.testing.assert_allclose(programs["func_Y"].evaluate(states) @ pi, torque, atol=1e-12 * scale)
    pi_b = programs["func_pi_b"].evaluate({"pi_": pi})
    np.testing.assert_allclose(programs["func_Y_b"].evaluate(states) @ pi_b, torque, atol=1e-12 * scale)


@pytest.mark.skipif(OCTAVE is None, reason="GNU Octave (octave-cli) is not installed")
def test_functions_of_the_thesis_in_octave(tmp_path: Path):
    model, base, theta = thesis_case()
    write_files(generate(model, base, base.values_of(theta), "matlab"), tmp_path)
    q, dq, ddq = random_states(np.random.default_rng(3), 1, 7)
    friction = theta[model.law_columns].reshape(7, 2)
    links = zip(theta[model.inertial_columns].reshape(7, 10), friction, strict=True)
    mu = np.concatenate([[*physical(body), *own] for body, own in links])
    np.concatenate([q[0], dq[0], ddq[0], mu]).tofile(tmp_path / "in.bin")
    script = (
        "f = fopen('in.bin'); x = fread(f, Inf, 'double'); fclose(f); q = x(1:7); dq = x(8:14); ddq = x(15:21);\n"
        "pi_ = func_pi(x(22:end)); f = fopen('out.bin', 'w');\n"
        "fwrite(f, [func_Y(q, dq, ddq) * pi_, func_Y_b(q, dq, ddq) * func_pi_b(pi_)], 'double'); fclose(f);\n"
    )
    (tmp_path / "compare.m").write_text(script)
    subprocess.run([str(OCTAVE), "compare.m"], cwd=tmp_path, capture_output=True, check=False)
    out = np.fromfile(tmp_path / "out.bin").reshape(2, 7)
    torque = model.torque(Motion.of_states(q, dq, ddq), theta)[0]
    np.testing.assert_allclose(out, [torque, torque], atol=1e-12 * np.abs(torque).max())
