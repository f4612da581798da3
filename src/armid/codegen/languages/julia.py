"""Generation of Julia: one module with two forms of each function.

One fills a given array, one returns a new array.
"""

from __future__ import annotations

from armid.codegen.code_printer import Notation, body
from armid.codegen.language_input import FunctionSource
from armid.codegen.program import Program

FUNCTIONS = {
    "sin": "sin({})",
    "cos": "cos({})",
    "tanh": "tanh({})",
    "exp": "exp({})",
    "sqrt": "sqrt({})",
    "pow": "({})^({})",
    "abs": "abs({})",
    "sign": "sign({})",
    "max": "max({}, {})",
    "min": "min({}, {})",
}


def write(source: FunctionSource) -> dict[str, str]:
    """Generates the text of the file `NAME.jl`; the key of the result is the path."""
    names = [f"{name}{mark}" for name in source.programs for mark in ("", "!")]
    lines = [f"# {line}".rstrip() for line in source.about()]
    lines += [
        f"module {source.name}",
        "",
        f"export PARAMETERS, PARAMETER_NAMES, STANDARD_NAMES, {', '.join(names)}",
        "",
    ]
    lines += ["# Base parameters of the estimate."]
    lines += ["const PARAMETERS = (", *(f"    {p.value!r},  # {p.note}" for p in source.parameters), ")", ""]
    lines += [f"const PARAMETER_NAMES = ({' '.join(f'{_quoted(p.name)},' for p in source.parameters)})", ""]
    lines += [f"const STANDARD_NAMES = ({' '.join(f'{_quoted(name)},' for name in source.columns)})", ""]
    for program in source.programs.values():
        lines += _function(source, program)
    return {f"{source.name}.jl": "\n".join([*lines, f"end  # module {source.name}", ""])}


def _function(source: FunctionSource, program: Program) -> list[str]:
    notation = Notation(
        lambda name, k: f"{name}[{k + 1}]", FUNCTIONS, "{} = {}", [p.variable for p in source.parameters]
    )
    statements, results = body(program, notation)
    names = ", ".join(argument.name for argument in program.arguments)
    output = program.output
    lines = [f'"""    {program.name}!({output}, {names})', "", f'{program.summary}."""']
    lines += [f"function {program.name}!({output}, {names})", *(f"    {statement}" for statement in statements)]
    lines += [f"    fill!({output}, 0.0)"] if len(results) < program.size else []
    lines += [f"    {output}[{_place(program, index)}] = {text}" for index, text in results.items()]
    lines += [f"    return {output}", "end", ""]
    shape = ", ".join(map(str, program.shape))
    lines += [f"{program.name}({names}) = {program.name}!(zeros({shape}), {names})", ""]
    return lines


def _place(program: Program, index: int) -> str:
    """Text of the index of an element of the result, counted from 1: `3` for a vector, `2, 3` for a matrix."""
    if len(program.shape) == 1:
        return str(index + 1)
    row, column = divmod(index, program.shape[1])
    return f"{row + 1}, {column + 1}"


def _quoted(name: str) -> str:
    return f'"{name}"'
