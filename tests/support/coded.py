"""Models that code is generated for, what their functions give along a motion, and ways to run generated code."""

from __future__ import annotations

import ctypes
import re
import shutil
import subprocess
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import tree_sitter
import tree_sitter_julia

from armid.checked_array import Array
from armid.codegen.functions import make_programs
from armid.model.base_parameters import BaseParameters, find_base_parameters
from armid.model.dynamics_model import DynamicsModel
from armid.model.equations_of_motion import slotine_li_regressor
from armid.model.motion import Motion
from armid.model.terms import TERMS, Coulomb, Hysteresis, LoadCoulomb, Offset, RigidBody, RotorInertia, Viscous
from armid.robot import builtin_arms, load_robot
from trees import random_inertial, random_states, random_tree, robot_of, structured_tree

SAMPLES = 12

CC, CXX = shutil.which("gcc"), shutil.which("g++")
OCTAVE, CMAKE = shutil.which("octave-cli"), shutil.which("cmake")
STRICT = ("-Wall", "-Wextra", "-Werror", "-pedantic")


@dataclass(frozen=True, eq=False)
class Case:
    """A model with values of its base parameters, and what its functions give along a contiguous motion.

    Jumps of the motion are wider than any memory, which is known from sample `known` on. `inputs` are the vectors of
    each sample by the names that the functions give them, but for parameters and state; `arguments` are these names.
    """

    model: DynamicsModel
    base: BaseParameters
    values: Array
    motion: Motion
    known: int
    expected: Mapping[str, Array]
    inputs: Mapping[str, Array]
    arguments: Mapping[str, tuple[str, ...]]

    @property
    def n(self) -> int:
        return self.model.n

    def compare(self, found: Mapping[str, Array], tolerance: float = 1e-12) -> None:
        """Every function, along the part of the motion where its memory is known."""
        assert set(found) == set(self.expected)
        scale = np.abs(self.expected["inverse_dynamics"]).max()
        for name, expected in self.expected.items():
            error = np.abs(found[name] - expected)[self.known :].max()
            bound = max(scale, np.abs(expected).max()) if name == "friction" else np.abs(expected).max()
            if name == "forward_dynamics":  # a linear system, as exact as its matrix is conditioned
                bound *= np.linalg.cond(self.expected["mass_matrix"]).max()
            assert error <= tolerance * bound, (name, error / bound)


def arms() -> dict[str, Callable[[], DynamicsModel]]:
    """The built-in arms, and trees with sliding joints, branches and every term there is."""
    usual = (RigidBody(), Viscous(), Coulomb(0.02), Offset(), RotorInertia())

    def builtin(name: str) -> Callable[[], DynamicsModel]:
        return lambda: DynamicsModel(load_robot(name), usual)

    def every_term() -> DynamicsModel:
        rng = np.random.default_rng(4)
        robot = robot_of(random_tree(rng, 4, prismatic=0.0), "every term")
        coupling = TERMS["coupling"](joints={"joint_2": 1.0, "joint_4": -2.0}, width=0.1)
        terms = [coupling if name == "coupling" else kind() for name, kind in TERMS.items()]
        return DynamicsModel(robot, tuple(terms), random_inertial(rng, 4))

    def tree(seed: int, make: Callable[..., Any]) -> Callable[[], DynamicsModel]:
        def made() -> DynamicsModel:
            rng = np.random.default_rng(seed)
            robot = robot_of(make(rng, 5, prismatic=0.5, branching=0.4), f"tree {seed}")
            terms = (RigidBody(), Viscous(), Hysteresis((0.1, 0.2)), LoadCoulomb(0.1))
            return DynamicsModel(robot, terms, random_inertial(rng, 5))

        return made

    trees = {"tree-1": tree(1, random_tree), "tree-2": tree(2, structured_tree), "tree-3": tree(3, structured_tree)}

    def friction_alone() -> DynamicsModel:
        return DynamicsModel(load_robot("ur5e"), (Viscous(), Coulomb()))

    more = {"every-term": every_term, "friction-alone": friction_alone}
    return {name: builtin(name) for name in builtin_arms()} | trees | more


ARMS = arms()


@cache
def case(name: str) -> Case:
    model, rng = ARMS[name](), np.random.default_rng(7)
    base = find_base_parameters(model)
    theta = rng.normal(size=len(model.parameters))
    if model.has_rigid_bodies:
        theta[model.inertial_columns] = random_inertial(rng, model.n).ravel()
    theta[[k for k, p in enumerate(model.parameters) if p.nonnegative]] **= 2
    motion, known = Motion.of_states(*random_states(rng, SAMPLES, model.n)), 0
    if model.nodes:
        motion, since = model.remembered(motion)
        known = int(since.max())
        assert known < SAMPLES // 2
    values = base.values_of(theta)
    placed = np.zeros_like(theta)
    placed[base.kept] = values
    Y, torque = model.regressor(motion), model.torque(motion, theta)
    M, gravity = model.mass_matrix(motion.q, theta), model.gravity_torque(motion.q, placed)
    # What is neither of the links nor of rotors: the torque of all other terms.
    rest = placed.copy()
    inertia = [k for k, p in enumerate(model.parameters) if p.symbol in ("IA", "IAM")]
    rest[[*model.inertial_columns, *inertia]] = 0.0
    reference = random_states(rng, SAMPLES, model.n)
    C = model.coriolis_matrix(motion.q, motion.dq, theta)
    coriolis = np.einsum("nij,nj->ni", C, motion.dq)
    Y_r = slotine_li_regressor(model, motion, reference[1], reference[2])
    expected = {
        "regressor": Y,
        "base_regressor": Y[:, :, base.kept],
        "slotine_li_regressor": Y_r[:, :, base.kept],
        "inverse_dynamics": torque,
        "forward_dynamics": motion.ddq,
        "gravity_torque": gravity,
        "coriolis_torque": coriolis,
        "bias_torque": coriolis + gravity,
        "coriolis_matrix": C,
        "mass_matrix": M,
        "friction": Y @ rest,
    }
    if not model.has_rigid_bodies:
        del expected["forward_dynamics"]
    inputs = {"q": motion.q, "dq": motion.dq, "ddq": motion.ddq, "tau": torque}
    inputs |= {"dq_r": reference[1], "ddq_r": reference[2]}
    programs = make_programs(model, base, [*expected, "state_start", "state_update"])
    arguments = {program.name: tuple(a.name for a in program.arguments) for program in programs}
    return Case(model, base, values, motion, known, expected, inputs, arguments)


def write_files(files: Mapping[str, str], folder: Path) -> Path:
    for name, text in files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    return folder


def along(each: Case, call: Callable[[str, Mapping[str, Array]], Array]) -> dict[str, Array]:
    """Return what a function `call(name, inputs)` gives along the motion, for the vectors that it reads."""
    found: dict[str, list[Array]] = {name: [] for name in each.expected}
    for k in range(each.motion.samples):
        sample = {name: values[k] for name, values in each.inputs.items()}
        if each.model.nodes:
            call("state_start" if k == 0 else "state_update", {"q": sample["q"]})
        for name, results in found.items():
            results.append(np.asarray(call(name, {x: sample[x] for x in each.arguments[name] if x in sample})))
    return {name: np.array(results).reshape(each.expected[name].shape) for name, results in found.items()}


def run_c(each: Case, library: Path, prefix: str) -> dict[str, Array]:
    """Functions of a shared library along the motion."""
    loaded = ctypes.CDLL(str(library))
    more = {"parameters": np.array(each.values), "state": np.empty(len(each.model.nodes))}
    sizes = {name: int(np.prod(x.shape[1:])) for name, x in each.expected.items()}

    def pointer(x: Array) -> Any:
        return x.ctypes.data_as(ctypes.POINTER(ctypes.c_double))

    def call(name: str, inputs: Mapping[str, Array]) -> Array:
        given = [np.ascontiguousarray({**more, **inputs}[x]) for x in each.arguments[name]]
        out = more["state"] if name.startswith("state_") else np.full(sizes[name], np.nan)
        written = [] if name == "state_update" else [out]
        getattr(loaded, f"{prefix}_{name}")(*map(pointer, [*given, *written]))
        return out

    return along(each, call)


def run_module(each: Case, module: Mapping[str, Any], *, parameters_first: bool) -> dict[str, Array]:
    """Functions of a Python module along the motion."""
    more: dict[str, Any] = {"parameters": each.values.tolist()}

    def call(name: str, inputs: Mapping[str, Array]) -> Array:
        given = {**more, **{x: vector.tolist() for x, vector in inputs.items()}}
        names = [x for x in each.arguments[name] if parameters_first or x != "parameters"]
        result = module[name](*(given[x] for x in names))
        if name.startswith("state_"):
            more["state"] = result
        return np.array(result)

    return along(each, call)


def is_julia(text: str) -> bool:
    """Tell whether a text keeps the grammar of Julia."""
    language = tree_sitter.Language(tree_sitter_julia.language())
    return not tree_sitter.Parser(language).parse(text.encode()).root_node.has_error


def julia_as_python(text: str) -> dict[str, Any]:
    """Functions of a Julia module, run as Python: the statements are of a kind that both read alike.

    Indices are moved by one. What Julia alone would refuse is not seen here, but for its grammar: `is_julia`.
    """
    lines = ["from math import *", "def sign(x): return (x > 0) - (x < 0)"]
    for name, arguments, statements in re.findall(r"function (\w+)!\((.*?)\)\n(.*?)\n    return", text, re.DOTALL):
        output, *rest = arguments.split(", ")
        shape = re.search(rf"{name}!\(zeros\((.*?)\)", text)
        assert shape
        lines += [f"def {name}({', '.join(rest)}):", f"    {output} = {{}}"]
        for statement in statements.splitlines():
            if statement.strip().startswith("fill!"):
                continue
            moved = re.sub(r"\[(\d+)\]", lambda m: f"[{int(m[1]) - 1}]", statement.strip())
            moved = re.sub(r"\[(\d+), (\d+)\]", lambda m: f"[{int(m[1]) - 1}, {int(m[2]) - 1}]", moved)
            lines.append(f"    {moved.replace('^', '**')}")
        lines += ["    import numpy", f"    filled = numpy.zeros(({shape[1]},))"]
        lines += [f"    for k, x in {output}.items(): filled[k] = x", "    return filled.tolist()"]
    scope: dict[str, Any] = {}
    exec("\n".join(lines), scope)
    return scope


def run_octave(each: Case, folder: Path, prefix: str) -> dict[str, Array]:
    """Functions of a package folder along the motion, in GNU Octave."""
    assert OCTAVE is not None
    np.concatenate([x.ravel() for x in each.inputs.values()]).tofile(folder / "in.bin")
    memory = bool(each.model.nodes)
    texts = {"parameters": "p", "state": "z"}
    calls = {name: ", ".join(texts.get(x, x) for x in each.arguments[name]) for name in each.expected}
    script = [
        "f = fopen('in.bin'); x = fread(f, Inf, 'double'); fclose(f);",
        f"x = reshape(x, {each.n}, {SAMPLES}, {len(each.inputs)});",
        f"p = {prefix}.parameters(); f = fopen('out.bin', 'w');",
        f"for k = 1:{SAMPLES}",
        *(f"  {name} = x(:, k, {i});" for i, name in enumerate(each.inputs, 1)),
        f"  if k == 1, z = {prefix}.state_start(q); else z = {prefix}.state_update(q, z); end" if memory else "",
        *(f"  fwrite(f, {prefix}.{name}({calls[name]}).', 'double');" for name in each.expected),
        "end",
        "fclose(f);",
    ]
    (folder / "along.m").write_text("\n".join(script) + "\n")
    subprocess.run([OCTAVE, "along.m"], cwd=folder, capture_output=True, check=False)
    out = np.fromfile(folder / "out.bin").reshape(SAMPLES, -1)
    ends = np.cumsum([0, *(x[0].size for x in each.expected.values())])
    return {
        name: out[:, a:b].reshape(x.shape)
        for (name, x), a, b in zip(each.expected.items(), ends[:-1], ends[1:], strict=True)
    }
