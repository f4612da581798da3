"""Generation of C99: a header and a source file without allocation, recursion and global state.

The only loops in the generated code set results to zero.
"""

from __future__ import annotations

from armid.codegen.code_printer import Notation, body
from armid.codegen.language_input import FunctionSource
from armid.codegen.program import Argument, Program

FUNCTIONS = {
    "sin": "sin({})",
    "cos": "cos({})",
    "tanh": "tanh({})",
    "exp": "exp({})",
    "sqrt": "sqrt({})",
    "pow": "pow({}, {})",
    "abs": "fabs({})",
    "sign": "sign({})",
    "max": "larger({}, {})",
    "min": "smaller({}, {})",
}

HELPERS = {
    "sign": "static double sign(double x) { return (double)((x > 0.0) - (x < 0.0)); }",
    "max": "static double larger(double a, double b) { return a > b ? a : b; }",
    "min": "static double smaller(double a, double b) { return a < b ? a : b; }",
}


def write(source: FunctionSource) -> dict[str, str]:
    """Generates the texts of the files `NAME.h` and `NAME.c`; the keys of the result are the paths."""
    return {f"{source.name}.h": _header(source), f"{source.name}.c": _code(source)}


def _header(source: FunctionSource) -> str:
    name, guard = source.name, f"ARMID_{source.name.upper()}_H"
    lines = [*_comment(source.about()), f"#ifndef {guard}", f"#define {guard}", ""]
    lines += ["#ifdef __cplusplus", 'extern "C" {', "#endif", ""]
    lines += [f"enum {{ {name}_joints = {source.n}, {name}_parameter_count = {len(source.parameters)} }};", ""]
    lines += ["/* Base parameters of the estimate. */"]
    lines += [f"extern const double {name}_parameters[{len(source.parameters)}];", ""]
    if source.widths:
        lines += ["/* State of the hysteresis. */"]
        lines += [f"typedef struct {{ double z[{len(source.widths)}]; }} {name}_state;", ""]
    for program in source.programs.values():
        lines += [*_comment(_note(source, program)), f"{_signature(source, program)};", ""]
    lines += ["#ifdef __cplusplus", "}", "#endif", "", "#endif", ""]
    return "\n".join(lines)


def _code(source: FunctionSource) -> str:
    lines = [f"/* See {source.name}.h. No branches, no allocation, no recursion, no state. */"]
    lines += [f'#include "{source.name}.h"', "", "#include <math.h>", ""]
    used = {node.operation for program in source.programs.values() for node in program.nodes}
    helpers = [line for operation, line in HELPERS.items() if operation in used]
    lines += [*helpers, ""] if helpers else []
    lines += [f"const double {source.name}_parameters[{len(source.parameters)}] = {{"]
    lines += [f"  {p.value!r}, /* {p.note} */" for p in source.parameters]
    lines += ["};", "", *functions(source)]
    return "\n".join(lines)


def functions(source: FunctionSource) -> list[str]:
    """Generates the lines of the definitions of all functions; they do not depend on the parameter values."""
    return [line for program in source.programs.values() for line in _function(source, program)]


def _function(source: FunctionSource, program: Program) -> list[str]:
    output = "state->z" if program.output == "next" else program.output
    notation = Notation(
        lambda name, k: f"{'state->z' if name == 'state' else name}[{k}]",
        FUNCTIONS,
        "const double {} = {};",
        [p.variable for p in source.parameters],
    )
    statements, results = body(program, notation)
    lines = [f"{_signature(source, program)} {{"]
    unread = [argument for argument in program.arguments if argument.name not in program.reads]
    lines += [f"  (void){argument.name};" for argument in unread]
    lines += [f"  {statement}" for statement in statements]
    if len(results) < program.size:
        lines += [f"  for (int k = 0; k < {program.size}; ++k) {output}[k] = 0.0;"]
    lines += [f"  {output}[{index}] = {text};" for index, text in results.items()]
    return [*lines, "}", ""]


def _signature(source: FunctionSource, program: Program) -> str:
    arguments = [_argument(source, a, program) for a in program.arguments]
    if program.name == "state_start":
        arguments.append(f"{source.name}_state *state")
    elif program.name != "state_update":
        arguments.append(f"double {program.output}[{program.size}]")
    return f"void {source.name}_{program.name}({', '.join(arguments)})"


def _argument(source: FunctionSource, argument: Argument, program: Program) -> str:
    if argument.name != "state":
        return f"const double {argument.name}[{argument.length}]"
    constant = "" if program.name == "state_update" else "const "
    return f"{constant}{source.name}_state *state"


def _note(source: FunctionSource, program: Program) -> list[str]:
    """Comment lines that describe the result of a function, and the names of its columns if it is a regressor."""
    lines = [f"{program.summary}."]
    if len(program.shape) == 2:
        rows, columns = program.shape
        lines += [f"{program.output} is {rows} x {columns}, row by row."]
    if program.name == "regressor":
        lines += _wrapped("Columns: ", source.columns)
    if program.name == "base_regressor":
        lines += _wrapped("Columns: ", [p.name for p in source.parameters])
    return lines


def _wrapped(start: str, names: tuple[str, ...] | list[str]) -> list[str]:
    """Lines of text with twelve names each."""
    return [f"{start if k == 0 else '  '}{' '.join(names[k : k + 12])}" for k in range(0, len(names), 12)]


def _comment(lines: list[str]) -> list[str]:
    if len(lines) == 1:
        return [f"/* {lines[0]} */"]
    return [f"/* {lines[0]}", *(f" * {line}".rstrip() for line in lines[1:]), " */"]
