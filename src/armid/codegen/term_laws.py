"""Symbolic evaluation of the laws of torque terms and their hysteresis states."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from armid.codegen.graph import Scalar, call
from armid.errors import ModelError
from armid.model.dynamics_model import DynamicsModel
from armid.model.hysteresis_memory import Coordinate, MemoryNode
from armid.model.terms import Law
from armid.model.torque_law_expression import Expression, derivative, number, symbols


def carried_out(expression: Expression, environment: Mapping[str, Scalar]) -> Scalar:
    """Value of an expression, whose symbols have given scalar values.

    Raises:
        ModelError: The expression contains a function for which no code can be generated.
    """
    head, arguments = expression.head, expression.arguments
    if not isinstance(head, str):
        return float(head)
    if not arguments:
        return environment[head]
    values = [carried_out(argument, environment) for argument in arguments]
    if head == "add":
        return values[0] + values[1]
    if head == "mul":
        return values[0] * values[1]
    if head not in KNOWN:
        raise ModelError(
            f"A torque term contains the function {head!r}, for which no code can be generated.",
            possible=", ".join(sorted(KNOWN)),
            remedy="use one of these, or add the function to armid.codegen.graph.FUNCTIONS and to each language.",
        )
    return call(head, *values)


KNOWN = frozenset({"add", "mul", "pow", "sign", "tanh", "abs", "exp", "sin", "cos", "max", "min"})


def uses(model: DynamicsModel, name: str) -> bool:
    """Tests whether a law of the model depends on the symbol `name`: `load` or `state`."""
    return any(name in symbols(law.expression) for _, law in model.laws)


def is_inertia(law: Law) -> bool:
    """Tests whether a law is proportional to the acceleration, so that it is a part of the mass matrix."""
    return derivative(law.expression, "ddq") != number(0.0)


def law_value(model: DynamicsModel, law: Law, inputs: Mapping[str, Sequence[Scalar]]) -> Scalar:
    """Value of a law, without its parameter and weight.

    Args:
        model: Model that contains the law.
        law: Law of a torque term.
        inputs: `q`, `dq`, `ddq` and `load` by joint, and `state` by hysteresis node, as far as the law needs them.
    """
    return carried_out(law.expression, _environment(model, law, inputs))


def rotor_matrix(
    model: DynamicsModel, theta: Mapping[int, Scalar], q: Sequence[Scalar]
) -> dict[tuple[int, int], Scalar]:
    """Part of the mass matrix from laws that are proportional to the acceleration, for parameters given by column."""
    zero: list[Scalar] = [0.0] * model.n
    inputs = {"q": q, "dq": zero, "ddq": zero}
    matrix: dict[tuple[int, int], Scalar] = {}
    for column, (_, law) in zip(model.law_columns.tolist(), model.laws, strict=True):
        if not is_inertia(law) or column not in theta:
            continue
        per_acceleration = derivative(law.expression, "ddq")
        inertia = theta[column] * carried_out(per_acceleration, _environment(model, law, inputs))
        for i, w_i in law.coordinate:
            for j, w_j in law.coordinate:
                matrix[i, j] = matrix.get((i, j), 0.0) + (w_i * w_j) * inertia
    return matrix


def updated(node: MemoryNode, q: Sequence[Scalar], state: Scalar) -> Scalar:
    """Next state of a hysteresis node, from its last state and the new positions."""
    return carried_out(node.memory.update, {"q": combined(node.coordinate, q), "state": state})


def combined(coordinate: Coordinate, values: Sequence[Scalar]) -> Scalar:
    """Weighted sum Σ w_j x_j of values x_j with the weights w_j of a coordinate."""
    total: Scalar = 0.0
    for j, weight in coordinate:
        total = total + weight * values[j]
    return total


def _environment(model: DynamicsModel, law: Law, inputs: Mapping[str, Sequence[Scalar]]) -> dict[str, Scalar]:
    """Values of the symbols that a law contains."""
    wanted = symbols(law.expression) | symbols(derivative(law.expression, "ddq"))
    values = {name: combined(law.coordinate, inputs[name]) for name in wanted if name in inputs and name != "state"}
    if "state" in wanted and "state" in inputs:
        matches = [node.coordinate == law.coordinate and node.memory == law.memory for node in model.nodes]
        values["state"] = inputs["state"][matches.index(True)]
    return values
