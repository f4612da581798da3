"""Generation of Python: one module that imports only `math`."""

from __future__ import annotations

from armid.codegen.code_printer import Notation, body, matrix_rows
from armid.codegen.language_input import FunctionSource
from armid.codegen.program import Program

FUNCTIONS = {
    "sin": "sin({})",
    "cos": "cos({})",
    "tanh": "tanh({})",
    "exp": "exp({})",
    "sqrt": "sqrt({})",
    "pow": "pow({}, {})",
    "abs": "abs({})",
    "sign": "_sign({})",
    "max": "max({}, {})",
    "min": "min({}, {})",
}

IMPORTED = ("cos", "exp", "pow", "sin", "sqrt", "tanh")


def write(source: FunctionSource) -> dict[str, str]:
    """Generates the text of the file `NAME.py`; the key of the result is the path."""
    used = {node.operation for program in source.programs.values() for node in program.nodes}
    about = source.about()
    lines = [f'"""{about[0]}', *about[1:], '"""', ""]
    imported = [name for name in IMPORTED if name in used]
    lines += [f"from math import {', '.join(imported)}", ""] if imported else []
    lines += ["PARAMETERS = (", *(f"    {p.value!r},  # {p.note}" for p in source.parameters), ")"]
    lines += ['"""Base parameters of the estimate."""', ""]
    lines += [f"PARAMETER_NAMES = {tuple(p.name for p in source.parameters)!r}"]
    lines += [f"STANDARD_NAMES = {source.columns!r}", ""]
    if "sign" in used:
        lines += ["", "def _sign(x):", "    return (x > 0.0) - (x < 0.0)", ""]
    for program in source.programs.values():
        lines += ["", *_function(source, program)]
    return {f"{source.name}.py": "\n".join(lines)}


def _function(source: FunctionSource, program: Program) -> list[str]:
    variables = [p.variable for p in source.parameters]
    statements, results = body(program, Notation(lambda name, k: f"{name}[{k}]", FUNCTIONS, "{} = {}", variables))
    names = [argument.name for argument in program.arguments if argument.name != "parameters"]
    names += ["parameters=PARAMETERS"] if len(names) < len(program.arguments) else []
    lines = [f"def {program.name}({', '.join(names)}):", f'    """{program.summary}."""']
    lines += [f"    {statement}" for statement in statements]
    elements = [results.get(k, "0.0") for k in range(program.size)]
    if len(program.shape) == 1:
        return [*lines, "    return [", *(f"        {x}," for x in elements), "    ]", ""]
    rows = [f"        [{', '.join(elements[k] for k in row)}]," for row in matrix_rows(program)]
    return [*lines, "    return [", *rows, "    ]", ""]
