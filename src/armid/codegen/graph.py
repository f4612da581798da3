"""Symbolic arithmetic: a graph of operations in which equal operations exist only once.

A scalar is a number or a `Node`. Nodes are combined with the usual operators. Simplifications are made at once: zeros
and ones are removed, operations on numbers are carried out, and signs are moved outwards so that a - b and b - a use
the same node. Equal operations on equal operands are the same node, so no other search for common subexpressions is
needed.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from typing import Any, TypeAlias

Scalar: TypeAlias = "Node | float"
"""Type of a scalar: a number, or a node of a graph."""


def _sign(x: float) -> float:
    return math.copysign(1.0, x) if x else 0.0


def _larger(x: float, y: float) -> float:
    return max(x, y)


def _smaller(x: float, y: float) -> float:
    return min(x, y)


FUNCTIONS: dict[str, Callable[..., float]] = {
    "sin": math.sin,
    "cos": math.cos,
    "tanh": math.tanh,
    "exp": math.exp,
    "sqrt": math.sqrt,
    "pow": math.pow,
    "abs": math.fabs,
    "sign": _sign,
    "max": _larger,
    "min": _smaller,
}
"""Functions that can be applied to nodes, each with the function that computes its value for numbers. In addition,
nodes have the operations add, sub, mul, div and neg."""

ODD = frozenset({"sin", "tanh", "sign"})
EVEN = frozenset({"cos", "abs"})
SYMMETRIC = frozenset({"add", "mul", "max", "min"})


class Node:
    """Operation on scalars, or a symbol, which stands for an element of an input vector.

    Attributes:
        graph: Graph to which the node belongs.
        number: Index in this graph; the operands have smaller indices.
        operation: Name of the operation: `add`, `sub`, `mul`, `div`, `neg`, a function of `FUNCTIONS`, or `symbol`.
        operands: Operands of the operation.
        symbol: Name of the input and index of the element; ("", 0) for an operation.
    """

    __slots__ = ("graph", "number", "operands", "operation", "symbol")

    def __init__(
        self, graph: Graph, number: int, operation: str, operands: tuple[Scalar, ...], symbol: tuple[str, int]
    ) -> None:
        self.graph = graph
        self.number = number
        self.operation = operation
        self.operands = operands
        self.symbol = symbol

    def __repr__(self) -> str:
        if self.operation == "symbol":
            return f"{self.symbol[0]}[{self.symbol[1]}]"
        return f"{self.operation}({', '.join(map(repr, self.operands))})"

    def __neg__(self) -> Scalar:
        return _negative(self)

    # NumPy handles arrays of scalars and calls these methods element by element.

    def __add__(self, other: Any) -> Any:
        return _sum(self, other) if isinstance(other, _SCALARS) else NotImplemented

    def __radd__(self, other: Any) -> Any:
        return _sum(other, self) if isinstance(other, _SCALARS) else NotImplemented

    def __sub__(self, other: Any) -> Any:
        return _difference(self, other) if isinstance(other, _SCALARS) else NotImplemented

    def __rsub__(self, other: Any) -> Any:
        return _difference(other, self) if isinstance(other, _SCALARS) else NotImplemented

    def __mul__(self, other: Any) -> Any:
        return _product(self, other) if isinstance(other, _SCALARS) else NotImplemented

    def __rmul__(self, other: Any) -> Any:
        return _product(other, self) if isinstance(other, _SCALARS) else NotImplemented


_SCALARS = (Node, float)


class Graph:
    """Graph of operations in which each operation on given operands is one node."""

    def __init__(self) -> None:
        self._known: dict[object, Node] = {}

    def symbols(self, name: str, count: int) -> list[Scalar]:
        """Nodes that stand for the `count` elements of an input vector."""
        return [self.symbol(name, index) for index in range(count)]

    def symbol(self, name: str, index: int) -> Node:
        """Node that stands for one element of an input vector."""
        return self._node("symbol", (), (name, index))

    def node(self, operation: str, operands: tuple[Scalar, ...]) -> Node:
        """Node for an operation on operands; the operation is not simplified."""
        if operation in SYMMETRIC:
            operands = tuple(sorted(operands, key=_place))
        return self._node(operation, operands, ("", 0))

    def _node(self, operation: str, operands: tuple[Scalar, ...], symbol: tuple[str, int]) -> Node:
        key = (operation, symbol, *(x.number if isinstance(x, Node) else (x,) for x in operands))
        node = self._known.get(key)
        if node is None:
            node = self._known[key] = Node(self, len(self._known), operation, operands, symbol)
        return node


def call(function: str, *arguments: Scalar) -> Scalar:
    """Applies a function of `FUNCTIONS` to its arguments.

    The result is a node of the graph if an argument is a node, otherwise a number.
    """
    graph = _graph(arguments)
    if graph is None:
        return FUNCTIONS[function](*arguments)
    if function == "pow":
        return _power(graph, *arguments)
    first = arguments[0]
    if function in ODD | EVEN and isinstance(first, Node) and first.operation == "neg":
        inner = call(function, first.operands[0])
        return -inner if function in ODD else inner
    return graph.node(function, arguments)


def _graph(arguments: Iterable[Scalar]) -> Graph | None:
    return next((x.graph for x in arguments if isinstance(x, Node)), None)


def _place(x: Scalar) -> tuple[int, float]:
    """Sort key for the operands of symmetric operations: numbers come before nodes."""
    return (1, x.number) if isinstance(x, Node) else (0, x)


def _inside_negative(x: Scalar) -> Scalar | None:
    """The value -x, if x is a negated node or a negative number; otherwise `None`."""
    if isinstance(x, Node):
        return x.operands[0] if x.operation == "neg" else None
    return -x if x < 0.0 else None


def _negative(x: Scalar) -> Scalar:
    if not isinstance(x, Node):
        return -x
    return x.operands[0] if x.operation == "neg" else x.graph.node("neg", (x,))


def _sum(a: Scalar, b: Scalar) -> Scalar:
    if not isinstance(a, Node):
        a, b = b, a
    if not isinstance(a, Node):
        return a + b
    if not isinstance(b, Node) and b == 0.0:
        return a
    if a is b:
        return _product(2.0, a)
    negative = _inside_negative(b)
    if negative is not None:
        return _difference(a, negative)
    negative = _inside_negative(a)
    if negative is not None:
        return _difference(b, negative)
    return a.graph.node("add", (a, b))


def _difference(a: Scalar, b: Scalar) -> Scalar:
    graph = _graph((a, b))
    if graph is None or not isinstance(b, Node):
        return _sum(a, -b) if isinstance(b, Node) or b <= 0.0 or graph is None else graph.node("sub", (a, b))
    if a is b:
        return 0.0
    if not isinstance(a, Node) and a == 0.0:
        return _negative(b)
    negative = _inside_negative(b)
    if negative is not None:
        return _sum(a, negative)
    negative = _inside_negative(a)
    if negative is not None:
        return _negative(_sum(negative, b))
    if isinstance(a, Node) and a.number > b.number:
        return _negative(graph.node("sub", (b, a)))
    return graph.node("sub", (a, b))


def _product(a: Scalar, b: Scalar) -> Scalar:
    if isinstance(a, Node) and not isinstance(b, Node):
        a, b = b, a
    if not isinstance(b, Node):
        return a * b  # both are numbers now
    if not isinstance(a, Node):
        if a == 0.0 or a == 1.0:
            return b if a else 0.0
        if a < 0.0:
            return _negative(_product(-a, b))
    negative = _inside_negative(a)
    if negative is not None:
        return _negative(_product(negative, b))
    negative = _inside_negative(b)
    if negative is not None:
        return _negative(_product(a, negative))
    if not isinstance(a, Node) and b.operation == "mul" and not isinstance(b.operands[0], Node):
        return _product(a * b.operands[0], b.operands[1])
    return b.graph.node("mul", (a, b))


def _power(graph: Graph, base: Scalar, exponent: Scalar) -> Scalar:
    """Power of a base; for some exponents, faster operations such as products or `sqrt` are used instead of `pow`."""
    if exponent == 1.0:
        return base
    if exponent == 2.0:
        return _product(base, base)
    if exponent == 3.0:
        return _product(base, _product(base, base))
    if exponent == 0.5:
        return graph.node("sqrt", (base,))
    if exponent == -0.5:
        return graph.node("div", (1.0, graph.node("sqrt", (base,))))
    if exponent == -1.0:
        return graph.node("div", (1.0, base))
    return graph.node("pow", (base, exponent))
