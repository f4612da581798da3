"""Conversion of a program to lines of text in a programming language.

A value that is used several times becomes a variable.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from armid.codegen.graph import Node, Scalar
from armid.codegen.program import Program

LONGEST = 7
"""Largest number of operations in one statement of generated code; more would not fit on a line of text."""

INFIX = {"add": (" + ", 1), "sub": (" - ", 1), "mul": (" * ", 2), "div": (" / ", 2)}
"""Infix operators and their precedence."""

NEGATIVE, ATOM = 3, 4


@dataclass(frozen=True, slots=True)
class Notation:
    """Notation of a programming language for expressions and statements.

    Attributes:
        element: Function that gives the text of an element of an input, from its name and its index from 0.
        functions: Pattern of the call of each function, with `{}` for each argument, by name of the function.
        declare: Pattern of a statement that assigns a value to a new variable.
        variables: Names of the variables for the elements of the input `parameters`.
    """

    element: Callable[[str, int], str]
    functions: Mapping[str, str]
    declare: str
    variables: Sequence[str]

    def local(self, symbol: tuple[str, int]) -> str:
        """Name of the variable for an element of an input.

        `symbol` is the name of the input and the index of the element.
        """
        name, index = symbol
        if name == "parameters":
            return self.variables[index]
        return f"{'z' if name == 'state' else name}{index + 1}"


@dataclass(frozen=True, slots=True)
class _Text:
    """Text of an expression in a programming language.

    Attributes:
        text: The text.
        binding: Precedence of the operator that is applied last.
        size: Number of operations in the expression.
    """

    text: str
    binding: int = ATOM
    size: int = 0

    def inside(self, binding: int) -> str:
        """Text of the expression, in brackets if its precedence is lower than `binding`."""
        return self.text if self.binding >= binding else f"({self.text})"


def body(program: Program, notation: Notation) -> tuple[list[str], dict[int, str]]:
    """Statements of a program, and the expression of each element of the result.

    Each element of an input is read once, before all computations. The output may therefore be the same array as an
    input.
    """
    symbols = {x for node in program.nodes for x in node.operands if isinstance(x, Node) and x.operation == "symbol"}
    symbols |= {x for x in program.results.values() if isinstance(x, Node) and x.operation == "symbol"}
    order = [argument.name for argument in program.arguments]
    lines: list[str] = []
    written: dict[Node, _Text] = {}
    for node in sorted(symbols, key=lambda x: (order.index(x.symbol[0]), x.symbol[1])):
        name = notation.local(node.symbol)
        lines.append(notation.declare.format(name, notation.element(*node.symbol)))
        written[node] = _Text(name)
    count = 0
    for node in program.nodes:
        text = _write(node, written, notation)
        if program.uses[node] == 1 and text.size <= LONGEST and node.operation not in ("sin", "cos"):
            written[node] = text
            continue
        name = _trigonometric(node, notation)
        if name is None:
            count += 1
            name = f"t{count}"
        lines.append(notation.declare.format(name, text.text))
        written[node] = _Text(name)
    return lines, {index: _operand(x, written).text for index, x in program.results.items()}


def matrix_rows(program: Program) -> list[list[int]]:
    """Indices of the elements of each row of a result matrix, in the matrix flattened row by row."""
    rows, columns = program.shape
    return [list(range(columns * i, columns * (i + 1))) for i in range(rows)]


def _trigonometric(node: Node, notation: Notation) -> str | None:
    """Name such as `s3` for the sine or `c3` for the cosine of q3; `None` for other operations."""
    inner = node.operands[0]
    if node.operation in ("sin", "cos") and isinstance(inner, Node) and inner.symbol[0] == "q":
        return f"{node.operation[0]}{inner.symbol[1] + 1}"
    return None


def _operand(x: Scalar, written: Mapping[Node, _Text]) -> _Text:
    if isinstance(x, Node):
        return written[x]
    return _Text(repr(float(x)), NEGATIVE if x < 0.0 else ATOM)


def _write(node: Node, written: Mapping[Node, _Text], notation: Notation) -> _Text:
    operands = [_operand(x, written) for x in node.operands]
    size = 1 + sum(x.size for x in operands)
    if node.operation == "neg":
        return _Text(f"-{operands[0].inside(ATOM)}", NEGATIVE, size)
    if node.operation not in INFIX:
        return _Text(notation.functions[node.operation].format(*(x.text for x in operands)), ATOM, size)
    sign, binding = INFIX[node.operation]
    # The right operand is bracketed even in a sum of sums, to keep the order of operations.
    return _Text(f"{operands[0].inside(binding)}{sign}{operands[1].inside(binding + 1)}", binding, size)
