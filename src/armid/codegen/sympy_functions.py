"""Conversion of functions of a model to SymPy expressions, in which symbols can stand for lengths and directions."""

from __future__ import annotations

import importlib
import operator
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from armid.codegen.functions import Maker
from armid.codegen.graph import Graph, Node, Scalar
from armid.codegen.program import Program
from armid.codegen.rigid_bodies import Geometry, numbers
from armid.errors import MissingExtraError
from armid.model.base_parameters import BaseParameters
from armid.model.dynamics_model import DynamicsModel


@dataclass(frozen=True, eq=False, slots=True)
class Symbolic:
    """Function of a model as SymPy expressions.

    Attributes:
        result: Result as a SymPy matrix, (n, 1) or (rows, columns), in terms of `definitions`.
        definitions: Pairs of a symbol and the expression that it stands for. An expression may contain symbols of
            earlier pairs.
        geometry: Numeric value of each symbol that stands for a length, a direction or gravity.
        inputs: Symbols of the elements of each input.
    """

    result: Any
    definitions: tuple[tuple[Any, Any], ...]
    geometry: Mapping[Any, float]
    inputs: Mapping[str, tuple[Any, ...]]

    def expanded(self) -> Any:
        """Result as an expression of the symbols of inputs and geometry only; this expression can be very large."""
        values: dict[Any, Any] = {}
        for symbol, expression in self.definitions:
            values[symbol] = expression.xreplace(values)
        return self.result.xreplace(values)


def make_symbolic(model: DynamicsModel, base: BaseParameters, name: str, *, geometry: bool = True) -> Symbolic:
    """Converts a function of a model to SymPy expressions.

    Args:
        model: Arm and torque terms.
        base: Base parameters of the model.
        name: Name of the function, one of `armid.codegen.PROGRAMS`.
        geometry: True to use symbols for lengths, gravity and directions that are not along an axis, false to use
            numbers.

    Raises:
        MissingExtraError: SymPy is not installed.
    """
    try:
        sympy: Any = importlib.import_module("sympy")
    except ImportError:
        raise MissingExtraError("sympy", "Symbolic expressions", "symbolic") from None
    graph = Graph()
    tree, given = numbers(model.tree), dict[str, float]()
    if geometry:
        tree, given = _named(tree, graph)
    program = Maker(model, base, graph, tree).make(name)
    symbols_by_name = {key: sympy.Symbol(key, real=True) for key in given}
    inputs = {
        argument.name: tuple(sympy.Symbol(_name(argument.name, k, base), real=True) for k in range(argument.length))
        for argument in program.arguments
    }
    result, definitions = _expressed(program, sympy, symbols_by_name, inputs)
    return Symbolic(result, definitions, {symbols_by_name[key]: value for key, value in given.items()}, inputs)


def _named(tree: Geometry, graph: Graph) -> tuple[Geometry, dict[str, float]]:
    """Replaces each number of a geometry except -1, 0 and 1 by a symbol; also returns the values of the symbols."""
    given: dict[str, float] = {}

    def symbols(values: NDArray[Any], name: str) -> NDArray[Any]:
        named = values.copy()
        for index in np.ndindex(values.shape):
            value = float(values[index])
            if value in (-1.0, 0.0, 1.0):
                continue
            key = f"{name}{index[0] + 1}{''.join('xyz'[k] for k in index[1:])}"
            given[key] = value
            named[index] = graph.symbol(key, 0)
        return named

    gravity = tree.gravity.copy()
    for k in range(3):
        if tree.gravity[k] != 0.0:
            given[f"g{'xyz'[k]}"] = float(tree.gravity[k])
            gravity[k] = graph.symbol(f"g{'xyz'[k]}", 0)
    named = replace(
        tree,
        axis=symbols(tree.axis, "a"),
        rotation=symbols(tree.rotation, "R"),
        translation=symbols(tree.translation, "d"),
        gravity=gravity,
    )
    return named, given


def _name(argument: str, k: int, base: BaseParameters) -> str:
    if argument == "parameters":
        return re.sub(r"\W", "_", base.names[k])
    return f"{'z' if argument == 'state' else argument}{k + 1}"


def _expressed(
    program: Program, sympy: Any, symbols_by_name: Mapping[str, Any], inputs: Mapping[str, tuple[Any, ...]]
) -> tuple[Any, tuple[tuple[Any, Any], ...]]:
    """Converts a program to SymPy expressions: result, and definitions of symbols for shared expressions."""
    functions: dict[str, Callable[..., Any]] = {
        "add": operator.add,
        "sub": operator.sub,
        "mul": operator.mul,
        "div": operator.truediv,
        "neg": operator.neg,
        "pow": operator.pow,
        "abs": sympy.Abs,
        "max": sympy.Max,
        "min": sympy.Min,
        **{name: getattr(sympy, name) for name in ("sin", "cos", "tanh", "exp", "sqrt", "sign")},
    }
    written: dict[Node, Any] = {}
    definitions: list[tuple[Any, Any]] = []

    def value(x: Scalar) -> Any:
        if not isinstance(x, Node):
            return sympy.Integer(int(x)) if x == int(x) else sympy.Float(x, 17)
        if x.operation != "symbol":
            return written[x]
        name, index = x.symbol
        return inputs[name][index] if name in inputs else symbols_by_name[name]

    for node in program.nodes:
        expression = functions[node.operation](*(value(x) for x in node.operands))
        if program.uses[node] > 1:
            symbol = sympy.Symbol(f"t{len(definitions) + 1}", real=True)
            definitions.append((symbol, expression))
            expression = symbol
        written[node] = expression
    rows, columns = (*program.shape, 1)[:2]
    elements = [value(program.results.get(k, 0.0)) for k in range(rows * columns)]
    return sympy.Matrix(rows, columns, elements), tuple(definitions)
