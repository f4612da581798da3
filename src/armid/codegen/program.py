"""Program of a function of a model: the operations that compute the result, in the order of computation."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from armid.checked_array import Array
from armid.codegen.graph import Graph, Node, Scalar

STATE_FUNCTIONS = ("state_start", "state_update")
"""Names of the functions that compute the hysteresis state."""


@dataclass(frozen=True, slots=True)
class Argument:
    """Input vector of a function.

    Attributes:
        name: Name of the input, for instance `parameters`, `q`, `dq`, `ddq` or `state`.
        length: Number of elements.
        meaning: Description of the input, with its unit.
    """

    name: str
    length: int
    meaning: str


@dataclass(frozen=True, eq=False)
class Program:
    """Function of vectors, given by a list of operations without branches or loops.

    Attributes:
        name: Name of the function.
        summary: Description of the result in one line, for comments in generated code.
        arguments: Inputs of the function.
        shape: Shape of the result: (n,) or (rows, columns).
        entries: Elements of the result that are not zero. The keys are indices into the result flattened row by row.
        output: Name of the result.
    """

    name: str
    summary: str
    arguments: tuple[Argument, ...]
    shape: tuple[int, ...]
    entries: Mapping[int, Scalar]
    output: str

    @property
    def size(self) -> int:
        """Number of elements of the result."""
        return math.prod(self.shape)

    @cached_property
    def results(self) -> dict[int, Scalar]:
        """The elements of `entries` with fewer operations: -(a - b) becomes b - a if a - b is used nowhere else."""
        return _without_signs({k: x for k, x in sorted(self.entries.items()) if isinstance(x, Node) or x != 0.0})

    @cached_property
    def nodes(self) -> tuple[Node, ...]:
        """Operations that the result needs, without symbols; operands come before the operations that use them."""
        return tuple(node for node in _reached(self.results.values()) if node.operation != "symbol")

    @cached_property
    def uses(self) -> Counter[Node]:
        """Number of times that operations and elements of the result use each node."""
        read = [x for node in self.nodes for x in node.operands] + list(self.results.values())
        return Counter(x for x in read if isinstance(x, Node))

    @property
    def operations(self) -> Counter[str]:
        """Number of operations of each kind (`add`, `mul`, `sin` …) in one call of the function."""
        return Counter(node.operation for node in self.nodes)

    @property
    def reads(self) -> frozenset[str]:
        """Names of the inputs on which the result depends."""
        return frozenset(x.symbol[0] for x in _reached(self.results.values()) if x.operation == "symbol")

    def evaluate(self, inputs: Mapping[str, ArrayLike]) -> Array:
        """Computes the numeric result of the function; generated code must give the same values.

        Args:
            inputs: Values of each input by name, shape (…, length), where … are any leading dimensions.

        Returns:
            The result, shape (…, n) or (…, rows, columns).
        """
        given = {name: np.asarray(x, dtype=np.float64) for name, x in inputs.items()}
        leading = np.broadcast_shapes(*(given[a.name].shape[:-1] for a in self.arguments))
        values: dict[Node, Array] = {}

        def value(x: Scalar) -> Array | float:
            if not isinstance(x, Node):
                return x
            return given[x.symbol[0]][..., x.symbol[1]] if x.operation == "symbol" else values[x]

        for node in self.nodes:
            values[node] = np.asarray(_NUMPY[node.operation](*(value(x) for x in node.operands)))
        out = np.zeros((*leading, self.size))
        for index, x in self.results.items():
            out[..., index] = value(x)
        return out.reshape(*leading, *self.shape)


_NUMPY: dict[str, Callable[..., Any]] = {
    "add": np.add,
    "sub": np.subtract,
    "mul": np.multiply,
    "div": np.divide,
    "neg": np.negative,
    "sin": np.sin,
    "cos": np.cos,
    "tanh": np.tanh,
    "exp": np.exp,
    "sqrt": np.sqrt,
    "pow": np.power,
    "abs": np.abs,
    "sign": np.sign,
    "max": np.maximum,
    "min": np.minimum,
}


def _reached(results: Iterable[Scalar]) -> list[Node]:
    """Nodes on which the given scalars depend, in the order in which the nodes were created."""
    needed: set[Node] = set()
    waiting = [x for x in results if isinstance(x, Node)]
    while waiting:
        node = waiting.pop()
        if node not in needed:
            needed.add(node)
            waiting.extend(x for x in node.operands if isinstance(x, Node))
    return sorted(needed, key=lambda node: node.number)


def _without_signs(results: dict[int, Scalar]) -> dict[int, Scalar]:
    """Copies results to a new graph, with -(a - b) replaced by b - a if a - b is used nowhere else."""
    nodes = _reached(results.values())
    readers = Counter(x for node in nodes for x in node.operands if isinstance(x, Node))
    readers.update(x for x in results.values() if isinstance(x, Node))
    graph, made = Graph(), dict[Node, Scalar]()

    def again(x: Scalar) -> Scalar:
        return made[x] if isinstance(x, Node) else x

    for node in nodes:
        inner = node.operands[0] if node.operation == "neg" else None
        if node.operation == "symbol":
            made[node] = graph.symbol(*node.symbol)
        elif isinstance(inner, Node) and inner.operation == "sub" and readers[inner] == 1:
            made[node] = graph.node("sub", (again(inner.operands[1]), again(inner.operands[0])))
        else:
            made[node] = graph.node(node.operation, tuple(again(x) for x in node.operands))
    return {index: again(x) for index, x in results.items()}
