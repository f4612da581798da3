"""Generation of C++17: a header with a class that calls the generated C code with arrays of fixed size."""

from __future__ import annotations

from armid.codegen.language_input import FunctionSource
from armid.codegen.languages import c
from armid.codegen.program import STATE_FUNCTIONS, Program


def write(source: FunctionSource) -> dict[str, str]:
    """Generates the texts of the files `NAME.hpp`, `NAME.h` and `NAME.c`; the keys of the result are the paths."""
    return {**c.write(source), f"{source.name}.hpp": _header(source)}


def _header(source: FunctionSource) -> str:
    lines = [f"// The functions of {source.name}.h with arrays of checked size. Compile {source.name}.c, too."]
    lines += ["#pragma once", "", "#include <array>", "", f'#include "{source.name}.h"', ""]
    lines += [f"namespace {source.name} {{", ""]
    lines += [f"using Joints = std::array<double, {source.n}>;"]
    lines += [f"using Parameters = std::array<double, {len(source.parameters)}>;"]
    matrices = [program for program in source.programs.values() if len(program.shape) == 2]
    lines += [f"using {_matrix(p)} = std::array<double, {p.size}>;  // {_rows(p)}" for p in matrices]
    if source.widths:
        lines += _memory(source)
    lines += ["", "// A model with its parameters. Its functions may be called from several threads at once."]
    lines += ["class Model {", " public:", "  Model() noexcept {"]
    lines += [
        f"    for (int k = 0; k < {len(source.parameters)}; ++k) parameters_[k] = ::{source.name}_parameters[k];"
    ]
    lines += ["  }", "  explicit Model(const Parameters& parameters) noexcept : parameters_(parameters) {}", ""]
    lines += ["  const Parameters& parameters() const noexcept { return parameters_; }", ""]
    for program in source.programs.values():
        if program.name not in STATE_FUNCTIONS:
            lines += _method(source, program)
    lines += [" private:", "  Parameters parameters_{};", "};", "", f"}}  // namespace {source.name}", ""]
    return "\n".join(lines)


def _memory(source: FunctionSource) -> list[str]:
    """Lines of C++ code that define the class of the hysteresis state."""
    return [
        "",
        "// State of the hysteresis: constructed at the start of the motion, then updated once at every sample.",
        "class Memory {",
        " public:",
        f"  explicit Memory(const Joints& q) noexcept {{ ::{source.name}_state_start(q.data(), &state_); }}",
        f"  void update(const Joints& q) noexcept {{ ::{source.name}_state_update(q.data(), &state_); }}",
        f"  const ::{source.name}_state* state() const noexcept {{ return &state_; }}",
        "",
        " private:",
        f"  ::{source.name}_state state_;",
        "};",
    ]


def _method(source: FunctionSource, program: Program) -> list[str]:
    kind = _matrix(program) if len(program.shape) == 2 else "Joints"
    given, passed = list[str](), list[str]()
    for argument in program.arguments:
        if argument.name == "parameters":
            passed.append("parameters_.data()")
        elif argument.name == "state":
            given.append("const Memory& memory")
            passed.append("memory.state()")
        else:
            given.append(f"const Joints& {argument.name}")
            passed.append(f"{argument.name}.data()")
    return [
        f"  // {program.summary}.",
        f"  {kind} {program.name}({', '.join(given)}) const noexcept {{",
        f"    {kind} {program.output};",
        f"    ::{source.name}_{program.name}({', '.join([*passed, f'{program.output}.data()'])});",
        f"    return {program.output};",
        "  }",
        "",
    ]


def _matrix(program: Program) -> str:
    """Name of the C++ type of a matrix, for instance `BaseRegressor` for `base_regressor`."""
    return "".join(word.capitalize() for word in program.name.split("_"))


def _rows(program: Program) -> str:
    rows, columns = program.shape
    return f"{rows} x {columns}, row by row"
