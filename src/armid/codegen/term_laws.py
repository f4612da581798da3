"""Symbolic evaluation of the laws of torque terms and of the update of hysteresis states."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from armid.codegen.graph import Scalar, call
from armid.errors import ModelError
from armid.model.dynamics_model import DynamicsModel
from armid.model.hysteresis_memory import Coordinate, MemoryNode
from armid.model.terms import Law
from armid.model.torque_law_expression import Expression, derivative, number, symbols


def carried_out(expression: Expression, environment: Mapping[str, Scalar]) -> Scalar:
    """Value of the expression of a law.

    Args:
        expression: Expression of a torque term.
        environment: Scalar value of each symbol in the expression.

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
            remedy="use only the possible functions in the term, or add the function to "
            "armid.codegen.graph.FUNCTIONS and to each module in armid.codegen.languages.",
        )
    return call(head, *values)


KNOWN = frozenset({"add", "mul", "pow", "sign", "tanh", "abs", "exp", "sin", "cos", "max", "min"})


def uses(model: DynamicsModel, name: str) -> bool:
    """True if a law of the model depends on the symbol `name`, which is `load` or `state`."""
    return any(name in symbols(law.expression) for _, law in model.laws)


def is_inertia(law: Law) -> bool:
    """True if a law is proportional to the acceleration, so that it contributes to the mass matrix."""
    return derivative(law.expression, "ddq") != number(0.0)


def law_value(model: DynamicsModel, law: Law, inputs: Mapping[str, Sequence[Scalar]]) -> Scalar:
    """Value of the expression of a law, not yet multiplied by the parameter and the weights of the law.

    Args:
        model: Model that contains the law.
        law: Law of a torque term.
        inputs: Values of the inputs `q`, `dq`, `ddq` and `load` (one for each joint) and `state` (one for each
            hysteresis node). Inputs that the law does not use may be absent.
    """
    return carried_out(law.expression, _environment(model, law, inputs))


def rotor_matrix(
    model: DynamicsModel, theta: Mapping[int, Scalar], q: Sequence[Scalar]
) -> dict[tuple[int, int], Scalar]:
    """Contribution to the mass matrix of the laws that are proportional to the acceleration, such as rotor inertia.

    Args:
        model: Arm and torque terms.
        theta: Parameters that are not zero; the keys are the columns of the standard parameters.
        q: Joint positions.

    Returns:
        Elements of the matrix that are not zero, by row and column.
    """
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
    """Value of each symbol in the expression of a law."""
    wanted = symbols(law.expression) | symbols(derivative(law.expression, "ddq"))
    values = {name: combined(law.coordinate, inputs[name]) for name in wanted if name in inputs and name != "state"}
    if "state" in wanted and "state" in inputs:
        matches = [node.coordinate == law.coordinate and node.memory == law.memory for node in model.nodes]
        values["state"] = inputs["state"][matches.index(True)]
    return values
