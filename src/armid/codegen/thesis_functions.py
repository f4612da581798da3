"""Programs of the functions func_Y, func_Y_b, func_pi and func_pi_b of the thesis [Halper2024].

The vector π of standard parameters contains for each link M MX MY MZ XX XY XZ YY YZ ZZ, then friction. The vector μ
of physical parameters contains for each link mass, centre of mass, inertia about the centre of mass, then friction.
The function π(μ) computes standard parameters, and π_b(π) computes base parameters from standard parameters. The
regressors func_Y and func_Y_b have the columns of π and π_b.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from armid.codegen.graph import Graph, Scalar
from armid.codegen.language_input import FunctionSource
from armid.codegen.program import Argument, Program
from armid.model.dynamics_model import Parameter
from armid.model.terms import RigidBody

ORDER = ("M", "MX", "MY", "MZ", "XX", "XY", "XZ", "YY", "YZ", "ZZ")
PHYSICAL = ("m", "rx", "ry", "rz", "Ixx", "Ixy", "Ixz", "Iyy", "Iyz", "Izz")


def thesis_order(source: FunctionSource) -> list[int]:
    """Indices of the standard parameters in `source.columns`, in the order in which the thesis lists them."""

    def place(k: int) -> tuple[int, int, int]:
        parameter = source.model.parameters[k]
        inertial = parameter.kind == RigidBody.name
        return parameter.number, ORDER.index(parameter.symbol) if inertial else len(ORDER), k

    return sorted(range(len(source.model.parameters)), key=place)


def thesis_programs(source: FunctionSource) -> list[tuple[Program, list[str]]]:
    """Programs of the functions of the thesis, each with comment lines that name the elements of its result.

    The two regressors are included only if `source` contains the programs of regressors.
    """
    order = thesis_order(source)
    rank = {column: k for k, column in enumerate(order)}
    rows = sorted(range(source.base.count), key=lambda k: rank[int(source.base.kept[k])])
    standard = [source.columns[k] for k in order]
    names = [source.parameters[k].name for k in rows]
    programs: list[tuple[Program, list[str]]] = []
    if "regressor" in source.programs:
        program = _reordered(source.programs["regressor"], "func_Y", order)
        programs.append((program, ["Columns, as elements of func_pi:", *_lines(standard)]))
    if "base_regressor" in source.programs:
        program = _reordered(source.programs["base_regressor"], "func_Y_b", rows)
        programs.append((program, ["Columns, as elements of func_pi_b:", *_lines(names)]))
    parameters = source.model.parameters
    programs.append((_pi(source, order), ["mu:", *_lines([_physical(parameters[k]) for k in order])]))
    formulas = [source.parameters[k].note for k in rows]
    programs.append((_pi_b(source, order, rows), ["pi_b:", *(f"  {formula}" for formula in formulas)]))
    return programs


def _reordered(program: Program, name: str, columns: list[int]) -> Program:
    """Program of a regressor with its columns in another order.

    Args:
        program: Program of the regressor.
        name: Name of the new function.
        columns: Index in `program` of each column of the new regressor.
    """
    width = program.shape[1]
    rank = {column: k for k, column in enumerate(columns)}
    entries = {index - index % width + rank[index % width]: x for index, x in program.entries.items()}
    return replace(program, name=name, entries=entries)


def _pi(source: FunctionSource, order: list[int]) -> Program:
    """Program of π(μ): standard parameters from physical parameters; parameters of friction are not changed."""
    parameters = [source.model.parameters[k] for k in order]
    mu = Graph().symbols("mu", len(order))
    entries = dict(enumerate(mu))
    for start in range(len(order)):
        if parameters[start].kind == RigidBody.name and parameters[start].symbol == "M":
            entries.update(_about_origin(start, mu[start : start + len(ORDER)]))
    argument = Argument("mu", len(order), "physical parameters, link by link")
    return Program("func_pi", "Standard parameters", (argument,), (len(order),), entries, "pi_")


def _about_origin(start: int, mu: list[Scalar]) -> Mapping[int, Scalar]:
    """First moments, and inertia about the origin of the link frame, of one link, from its physical parameters.

    Args:
        start: Index of the mass of the link in μ.
        mu: The ten physical parameters of the link.

    Returns:
        Standard parameters; the keys are their indices in π.
    """
    m, x, y, z, xx, xy, xz, yy, yz, zz = mu
    mx, my, mz = m * x, m * y, m * z
    values = [m, mx, my, mz]
    values += [xx + (my * y + mz * z), xy - mx * y, xz - mx * z, yy + (mx * x + mz * z), yz - my * z]
    return dict(enumerate([*values, zz + (mx * x + my * y)], start))


def _pi_b(source: FunctionSource, order: list[int], rows: list[int]) -> Program:
    """Program of π_b(π): base parameters from standard parameters."""
    pi = Graph().symbols("pi_", len(order))
    entries: dict[int, Scalar] = {}
    for place, row in enumerate(rows):
        total: Scalar = 0.0
        for k, column in enumerate(order):
            total = total + float(source.base.regrouping[row, column]) * pi[k]
        entries[place] = total
    argument = Argument("pi_", len(order), "standard parameters, for instance from func_pi")
    return Program("func_pi_b", "Base parameters", (argument,), (len(rows),), entries, "pi_b")


def _physical(parameter: Parameter) -> str:
    """Name of the physical parameter in the place of a standard parameter, for instance `rx_2` for `MX_2`."""
    if parameter.kind == RigidBody.name:
        return f"{PHYSICAL[ORDER.index(parameter.symbol)]}_{parameter.number}"
    return parameter.name


def _lines(names: list[str]) -> list[str]:
    """Lines of text with twelve names each."""
    return [f"  {' '.join(names[k : k + 12])}" for k in range(0, len(names), 12)]
