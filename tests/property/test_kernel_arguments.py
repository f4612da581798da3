"""Bindings of the kernel refuse arguments of wrong sizes, types, strides and indices, on every build."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from armid import kernel
from armid.errors import ArmidError
from armid.kernel import LawPrograms, ServoJoints, _native
from armid.kernel.dispatch import compiled_arm
from armid.model.terms.law_programs import law_programs
from armid.model.terms.term import Law
from armid.model.torque_law_expression import symbol, tanh
from problems import COMPILED, random_problem
from trees import random_inertial, random_tree

N, JOINTS, WINDOWS = 24, 3, 2
"""Samples, at least the lanes of the widest build; joints; windows of a roll-out."""

Arguments = dict[str, Any]


def refused(function: Callable[..., object], arguments: Arguments, **changed: Any) -> None:
    with pytest.raises((TypeError, ValueError)):
        function(*{**arguments, **changed}.values())


def laws() -> LawPrograms:
    dq = symbol("dq")
    one, two = Law("F", 0, "", ((0, 1.0),), tanh(3.0 * dq)), Law("F", 1, "", ((1, 1.0), (2, -0.5)), dq)
    return law_programs([one, two])


def servo_arrays() -> Arguments:
    of = laws()
    gains = np.array([[20.0] * JOINTS, [1.0] * JOINTS, [np.inf] * JOINTS, [0.2] * JOINTS])
    names = ("first", "operation", "constant", "link", "joint", "weight")
    return {"gains": gains, **{name: getattr(of, name) for name in names}, "value": np.ones(of.count)}


def parameter_arrays() -> Arguments:
    tree = random_tree(np.random.default_rng(1), JOINTS)
    links = 10 * JOINTS
    layout = kernel.make_layout(tree, np.arange(links), np.zeros(0, dtype=int), np.zeros(0, dtype=int))
    i4 = np.int32
    return {
        "count": links + 1,
        "offset": layout.offset,
        "target": layout.target,
        "parameter": layout.parameter,
        "law": np.full(2, -1, i4),
        "joint": np.full((4, JOINTS), -1, i4),
        "input_joint": np.zeros(1, i4),
        "input_parameter": np.full(1, links, i4),
        "input": np.ones((1, N)),
    }


def calls() -> dict[str, Arguments]:
    """Valid arguments of each function of the bindings, by name; the build is added."""
    rng = np.random.default_rng(1)
    tree = random_tree(rng, JOINTS)
    problem = random_problem(rng, tree, N)
    layout, arm, inertial = problem.layout, compiled_arm(tree), random_inertial(rng, JOINTS)
    q, dq, ddq = (np.array(x) for x in problem.state)
    state = {"arm": arm, "q": q, "dq": dq, "ddq": ddq}
    columns = {"arm": arm, "offset": layout.offset, "target": layout.target}
    terms = {"term": layout.term}
    data = {"torque": problem.torque, "terms": problem.terms}
    whole = {**columns, **terms, "q": q, "dq": dq, "ddq": ddq, **data}
    size = int((layout.widths.astype(int) ** 2).sum())
    chosen = 1 + max(int(own.max(initial=0)) for own in layout.parameters)
    known = {**columns, **terms, "parameter": layout.parameter, "q": q, "dq": dq, "ddq": ddq}
    weighed = {**known, "terms": problem.terms, "weight": np.ones(JOINTS)}
    command = rng.normal(0.0, 0.1, (WINDOWS, N, JOINTS))
    states = {"q": np.zeros((WINDOWS, N + 1, JOINTS)), "dq": np.zeros((WINDOWS, N + 1, JOINTS))}
    servos = {"inertial": inertial, "servos": _native.ServoArrays(**servo_arrays()), "step": 1e-3, "steep": 1e-5}
    derived = _native.ParameterArrays(**parameter_arrays())
    start = {"S_q": np.zeros((JOINTS, 10 * JOINTS + 1)), "S_dq": np.zeros((JOINTS, 10 * JOINTS + 1))}
    one = {"position": command[0], "torque": np.zeros((N, JOINTS)), "q": states["q"][0], "dq": states["dq"][0]}
    gradients = {"q_bar": np.empty_like(q), "dq_bar": np.empty_like(q), "ddq_bar": np.empty_like(q)}
    bounds = {"bounds": np.array([0, 10, N])}
    own = np.array([0, 2, 4], np.int32), np.array([0, 1, 0, 1], np.int32)
    products = {"products": np.tile(np.eye(3).ravel(), 2), "sign": np.ones(2), "rows": np.full(2, 30.0)}
    return {
        "regressor": {**state, "out": np.empty((N, JOINTS, 10 * JOINTS))},
        "columns": {**whole, "out": np.empty((layout.columns, N))},
        "inverse_dynamics": {"arm": arm, "inertial": inertial, "q": q, "dq": dq, "ddq": ddq, "out": np.empty_like(q)},
        "mass_matrix": {"arm": arm, "inertial": inertial, "q": q, "out": np.empty((N, JOINTS, JOINTS))},
        "factor": {
            **whole, "mask": np.ones((N, JOINTS), np.uint8), **bounds, "by_gram": False, "threads": 2,
            "out": np.empty((2, size)),
        },
        "factor_columns": {"x": rng.normal(size=(4, N)), **bounds, "out": np.empty((2, 4, 4))},
        "decimate": {**whole, "taps": np.ones(5), "step": 2, "first": 0, "out": np.zeros((layout.columns, 8))},
        "play": {
            "x": rng.normal(size=(N, 2)), "column": np.array([0, 1, 1], np.int32), "width": np.ones(3),
            "out": np.empty((N, 3)), "known": np.zeros(3, np.int64),
        },
        "columns_adjoint": {
            **columns, "q": q, "dq": dq, "ddq": ddq, "cotangent": np.ones((layout.columns, N)), **gradients,
        },
        "information": {**weighed, "out": np.empty((chosen, chosen))},
        "information_adjoint": {
            **weighed, "slopes": np.ones((chosen, chosen)), **gradients, "terms_bar": np.empty_like(problem.terms),
        },
        "reweighted": {
            "offset": own[0], "parameter": own[1], **products, "passes": 5, "settled": 1e-8, "floor": 1e-9,
            "ridge": 0.0, "x": np.zeros(2), "sigma": np.zeros(2),
        },
        "roll_out": {"arm": arm, **servos, "position": command, "torque": np.zeros_like(command), **states},
        "roll_out_sensitivities": {
            "arm": arm, **servos, "parameters": derived, **one, **start, "every": 4,
            "out": np.empty((N // 4, JOINTS, 10 * JOINTS + 1)),
        },
    }  # fmt: skip


FUNCTIONS = tuple(calls())

OF_ANY_LENGTH = {("decimate", "taps"), ("reweighted", "x")}
"""Arrays that may have one element less: a shorter filter; parameters are checked by their numbers."""

OPTIONAL = {"mask", "torque", "term", "target"}
"""Arrays that may be empty where a function does without them."""

INDICES = ("offset", "term", "bounds", "column", "parameter")


@pytest.mark.parametrize("build", COMPILED)
@pytest.mark.parametrize("name", FUNCTIONS)
def test_wrong_arrays_are_refused(name: str, build: str):
    arguments = {"isa": build, **calls()[name]}
    function = getattr(_native, name)
    function(*arguments.values())
    for key, given in arguments.items():
        if not isinstance(given, np.ndarray):
            refused(function, arguments, **{key: None})
            continue
        other = np.float32 if given.dtype == np.float64 else np.float64
        refused(function, arguments, **{key: np.ones(given.shape, other)})
        refused(function, arguments, **{key: np.repeat(given, 2, axis=-1)[..., ::2]})
        refused(function, arguments, **{key: given.astype(object)})
        refused(function, arguments, **{key: given.tolist()})
        if (name, key) not in OF_ANY_LENGTH:
            refused(function, arguments, **{key: given.ravel()[:-1].copy()})
        if key not in OPTIONAL:
            refused(function, arguments, **{key: given.ravel()[:0].copy()})
        if key in INDICES:
            for place in (0, -1):
                for value in (-7, 10**6):
                    wrong = given.copy()
                    wrong.flat[place] = value
                    refused(function, arguments, **{key: wrong})
        if key == "target":
            refused(function, arguments, **{key: np.full_like(given, 10**6)})


@pytest.mark.parametrize("name", FUNCTIONS)
def test_outputs_that_cannot_be_written_are_refused(name: str):
    arguments = {"isa": COMPILED[0], **calls()[name]}
    outputs = {"out", "known", "x", "sigma", "q_bar", "dq_bar", "ddq_bar", "terms_bar"}
    outputs = {"q", "dq"} if name == "roll_out" else outputs - ({"x"} if name != "reweighted" else set())
    found = outputs & arguments.keys()
    assert found
    for key in found:
        locked = arguments[key].copy()
        locked.setflags(write=False)
        refused(getattr(_native, name), arguments, **{key: locked})


@pytest.mark.parametrize("name", FUNCTIONS)
def test_a_build_that_is_not_there_is_refused(name: str):
    refused(getattr(_native, name), {"isa": "altivec", **calls()[name]})


@pytest.mark.parametrize(
    ("made", "values"),
    [(_native.ServoArrays, servo_arrays), (_native.ParameterArrays, parameter_arrays)],
    ids=["servos", "parameters"],
)
def test_wrong_servos_and_parameters_are_refused(made: type, values: Callable[[], Arguments]):
    """Types are refused when the arrays are collected; sizes and indices, when they are used."""
    for key, given in values().items():
        if not isinstance(given, np.ndarray):
            continue
        other = np.float32 if given.dtype == np.float64 else np.int64
        with pytest.raises(TypeError):
            made(**{**values(), key: np.ones(given.shape, other)})
        shorter = made(**{**values(), key: given.ravel()[:-1].copy()})
        _refused_in_use(shorter)
        if given.dtype == np.int32:
            for value in (-7, 10**6):
                for place in (0, -1):
                    wrong = given.copy()
                    wrong.flat[place] = value
                    if key != "target" or value > 0:
                        _refused_in_use(made(**{**values(), key: wrong}))


def _refused_in_use(made: object) -> None:
    arguments = {"isa": COMPILED[0], **calls()["roll_out_sensitivities"]}
    key = "servos" if isinstance(made, _native.ServoArrays) else "parameters"
    refused(_native.roll_out_sensitivities, arguments, **{key: made})


def test_wrong_numbers_are_refused():
    every = calls()
    for name, key, values in (
        ("decimate", "step", (0, -1, 2**62, "1")),
        ("decimate", "first", (2**62, -(2**62))),
        ("roll_out", "step", (0.0, -1.0, np.nan, "x")),
        ("roll_out", "steep", (0.0, np.nan)),
        ("roll_out_sensitivities", "every", (0, -1)),
    ):
        for value in values:
            refused(getattr(_native, name), {"isa": COMPILED[0], **every[name]}, **{key: value})


@pytest.mark.parametrize("count", [0, -1, 2**30])
def test_a_wrong_number_of_parameters_is_refused(count: int):
    _refused_in_use(_native.ParameterArrays(**{**parameter_arrays(), "count": count}))


def test_trees_that_are_none_are_refused():
    tree = random_tree(np.random.default_rng(0), 3)
    names = ("parent", "prismatic", "axis", "rotation", "translation", "gravity")
    whole = {name: getattr(tree, name) for name in names}
    for name, given in whole.items():
        with pytest.raises(TypeError):
            _native.Arm(**{**whole, name: given.astype(np.float32)})
        with pytest.raises(ValueError, match="one entry a joint"):
            _native.Arm(**{**whole, name: given.ravel()[:-1].copy()})
    for parent in ([0, 0, 1], [-1, 2, 1], [-2, 0, 1], [-1, 0, 2**30]):
        with pytest.raises(ValueError, match="before their children"):
            _native.Arm(**{**whole, "parent": np.array(parent, np.int32)})


def test_numbers_that_are_not_finite_are_refused_where_arms_and_servos_are_made():
    tree = random_tree(np.random.default_rng(0), 3)
    for name in ("axis", "rotation", "translation", "gravity"):
        with pytest.raises(ArmidError, match="finite"):
            kernel.Tree(
                **{
                    each: np.full_like(getattr(tree, each), np.nan) if each == name else getattr(tree, each)
                    for each in ("parent", "prismatic", "axis", "rotation", "translation", "gravity")
                }
            )
    gains = {"stiffness": [1.0], "damping": [0.0], "limit": [1.0], "armature": [0.1]}
    none = {"laws": law_programs([]), "values": [], "step": 1e-3}
    for name in ("stiffness", "damping", "armature", "limit"):
        with pytest.raises(ArmidError):
            ServoJoints(**{**gains, name: [np.nan]}, **none)
    with pytest.raises(ArmidError):
        ServoJoints(**gains, **{**none, "step": np.nan})


def test_motions_that_are_not_finite_are_refused_by_the_roll_out():
    tree = random_tree(np.random.default_rng(0), 1)
    servos = ServoJoints([1.0], [0.0], [1.0], [0.1], law_programs([]), [], 1e-3)
    good = {
        "command": np.zeros((1, 4, 1)),
        "torque": np.zeros((1, 4, 1)),
        "q": np.zeros((1, 1)),
        "dq": np.zeros((1, 1)),
    }
    for name, given in good.items():
        with pytest.raises(ArmidError, match="finite"):
            kernel.roll_out(tree, np.ones((1, 10)), servos, **{**good, name: np.full_like(given, np.nan)})
    with pytest.raises(ArmidError, match="finite"):
        kernel.roll_out(tree, np.full((1, 10), np.nan), servos, **good)


@pytest.mark.parametrize(
    ("arrays", "match"),
    [
        ({"sizes": [-1]}, "length"),
        ({"runs": [[99, 1]]}, "operation"),
        ({"runs": [[0, 5]]}, "too long"),
        ({"runs": np.zeros((0, 2))}, "too short"),
        ({"operands": [[0, 7]]}, "before"),
        ({"operands": [[-1, 0]]}, "before"),
        ({"results": [9]}, "result"),
        ({"results": [-2]}, "result"),
        ({"runs": [0]}, "pairs"),
    ],
    ids=str,
)
def test_tapes_that_read_elsewhere_are_refused(arrays: Arguments, match: str):
    i4 = np.int32
    good = {"sizes": [2], "constants": np.ones(1), "runs": [[0, 1]], "operands": [[0, 1]], "results": [3]}
    made = {
        key: np.asarray(each, np.float64 if key == "constants" else i4) for key, each in {**good, **arrays}.items()
    }
    with pytest.raises(ValueError, match=match):
        _native.Tape(**made)
