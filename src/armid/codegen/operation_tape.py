"""Conversion of a program to a tape: a list of operations that the kernel carries out for one sample at a time.

Operations of the same kind that follow each other are stored together as one group.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.codegen.graph import Node, Scalar
from armid.codegen.program import Program
from armid.kernel import _native

Integers = NDArray[np.int32]


@dataclass(frozen=True, eq=False, slots=True)
class TapeRecord:
    """Operations, constants and indices that make up a tape for the kernel.

    All values are stored in one array: the inputs, then the constants, then the results of the operations in order.

    Attributes:
        sizes: Number of elements of each input.
        constants: Constants, which are stored after the inputs.
        runs: For each of g groups of operations of the same kind: code of the operation and number of operations,
            shape (g, 2).
        operands: Indices of the two values that each of m operations uses, shape (m, 2).
        results: Index of the value of each element of the result; -1 for zero.
    """

    sizes: Integers
    constants: Array
    runs: Integers
    operands: Integers
    results: Integers


def make_tape(program: Program, given: Mapping[str, Array]) -> _native.Tape:
    """Converts a program to a tape that the kernel can run.

    Args:
        program: Program of a function of a model.
        given: Values of the inputs that are constant, by name. All other inputs of the program are inputs of the
            tape, in the same order.
    """
    record = record_tape(program, given)
    return _native.Tape(record.sizes, record.constants, record.runs, record.operands, record.results)


def record_tape(program: Program, given: Mapping[str, Array]) -> TapeRecord:
    """Computes the operations and constants from which `make_tape` makes a tape.

    Args:
        program: Program of a function of a model.
        given: Values of the inputs that are constant, by name.
    """
    inputs = [argument for argument in program.arguments if argument.name not in given]
    sizes = [argument.length for argument in inputs]
    starts = dict(zip((a.name for a in inputs), np.cumsum([0, *sizes]).tolist(), strict=False))
    first, places, constants = sum(sizes), dict[float, int](), list[float]()

    def of_number(x: float) -> int:
        if x not in places:
            places[x] = first + len(constants)
            constants.append(x)
        return places[x]

    def outside(x: Scalar) -> int | None:
        """Index at which the tape stores x, if x is an element of an input or a constant.

        The result is `None` if x is an operation.
        """
        if not isinstance(x, Node):
            return of_number(x)
        if x.operation != "symbol":
            return None
        name, index = x.symbol
        return starts[name] + index if name in starts else of_number(float(given[name][index]))

    read = [x for node in program.nodes for x in node.operands] + list(program.results.values())
    for x in read:
        outside(x)  # so that all constants precede the first operation
    order, runs = _in_runs(program)
    made = {node: first + len(constants) + k for k, node in enumerate(order)}

    def place(x: Scalar) -> int:
        index = outside(x)
        return made[x] if index is None and isinstance(x, Node) else int(index or 0)

    operands = [[place(x) for x in (*node.operands, *node.operands)[:2]] for node in order]
    results = np.full(program.size, -1, dtype=np.int32)
    for index, x in program.results.items():
        results[index] = place(x)
    return TapeRecord(
        np.array(sizes, dtype=np.int32),
        np.array(constants, dtype=np.float64),
        np.array(runs, dtype=np.int32).reshape(-1, 2),
        np.array(operands, dtype=np.int32).reshape(-1, 2),
        results,
    )


def _in_runs(program: Program) -> tuple[list[Node], list[tuple[int, int]]]:
    """Orders the operations of a program so that many operations of the same kind follow each other.

    The next kind is the one with the most operations whose operands are already computed. The second value gives code
    of the operation and number of operations for each group.
    """
    codes = {name: code for code, name in enumerate(_native.Tape.operations())}
    waiting = {
        node: sum(isinstance(x, Node) and x.operation != "symbol" for x in node.operands) for node in program.nodes
    }
    readers: dict[Node, list[Node]] = {node: [] for node in program.nodes}
    ready: dict[str, list[Node]] = {}
    for node, missing in waiting.items():
        for x in node.operands:
            if isinstance(x, Node) and x.operation != "symbol":
                readers[x].append(node)
        if not missing:
            ready.setdefault(node.operation, []).append(node)
    order, runs = list[Node](), list[tuple[int, int]]()
    while any(ready.values()):
        kind = max(ready, key=lambda name: len(ready[name]))
        start, group = len(order), ready[kind]
        while group:  # operations of the same kind that become executable follow immediately
            node = group.pop(0)
            order.append(node)
            for reader in readers[node]:
                waiting[reader] -= 1
                if not waiting[reader]:
                    ready.setdefault(reader.operation, []).append(reader)
        runs.append((codes[kind], len(order) - start))
    return order, runs
