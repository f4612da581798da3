"""Generation of MATLAB and GNU Octave: a package folder, with one file for each function.

The functions of the thesis are generated, too, and examples: a closed-loop simulation and Simulink blocks.
"""

from __future__ import annotations

from collections.abc import Sequence

from armid.codegen.code_printer import Notation, body
from armid.codegen.language_input import FunctionSource
from armid.codegen.program import Program
from armid.codegen.texts.matlab_examples import matlab_examples
from armid.codegen.thesis_functions import thesis_programs

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
    """Generates the texts of `+NAME/FUNCTION.m` for each function, of the functions of the thesis, and of examples.

    The keys of the result are the paths of the files. The values of the base parameters are the result of one of
    these functions. The functions of the thesis and the examples are next to the folder `+NAME`.
    """
    variables = [p.variable for p in source.parameters]
    files = {f"+{source.name}/parameters.m": _parameters(source)}
    for program in source.programs.values():
        files[f"+{source.name}/{program.name}.m"] = _function(program, variables, _columns(source, program))
    for program, notes in thesis_programs(source):
        files[f"{program.name}.m"] = _function(program, variables, notes)
    return {**files, **matlab_examples(source)}


def _parameters(source: FunctionSource) -> str:
    count = len(source.parameters)
    lines = ["function p = parameters()", f"% Base parameters of the estimate, {count} x 1."]
    lines += ["%", *(f"% {line}".rstrip() for line in source.about())]
    lines += ["p = [", *(f"  {p.value!r}; % {p.note}" for p in source.parameters), "];", "end", ""]
    return "\n".join(lines)


def _function(program: Program, variables: Sequence[str], notes: Sequence[str]) -> str:
    notation = Notation(lambda name, k: f"{name}({k + 1})", FUNCTIONS, "{} = {};", variables)
    statements, results = body(program, notation)
    names = ", ".join(argument.name for argument in program.arguments)
    rows, columns = (*program.shape, 1)[:2]
    lines = [f"function {program.output} = {program.name}({names})", f"% {program.summary}, {rows} x {columns}."]
    lines += [f"%   {a.name}: {a.meaning}, {a.length} elements" for a in program.arguments]
    lines += [f"% {line}".rstrip() for line in notes]
    lines += [*statements, f"{program.output} = zeros({rows}, {columns});"]
    lines += [
        f"{program.output}({index // columns + 1}, {index % columns + 1}) = {text};"
        for index, text in results.items()
    ]
    return "\n".join([*lines, "end", ""])


def _columns(source: FunctionSource, program: Program) -> list[str]:
    """Comment lines with the names of the columns of a regressor; no lines for other functions."""
    names = {"regressor": source.columns, "base_regressor": tuple(p.name for p in source.parameters)}
    columns = names.get(program.name, ())
    return [f"  {' '.join(columns[k : k + 12])}" for k in range(0, len(columns), 12)]
