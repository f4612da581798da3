"""Generated code, compiled or run, against the kernel: five arms, random trees, every torque term."""

from __future__ import annotations

import ast
import subprocess
from pathlib import Path

import numpy as np
import pytest

from armid.codegen.catalogue import LANGUAGES
from armid.codegen.functions import make_programs
from armid.codegen.generation import generate
from armid.codegen.language_input import identifier
from armid.model.base_formulas import base_formulas
from coded import (
    ARMS,
    CC,
    CXX,
    OCTAVE,
    SAMPLES,
    STRICT,
    Case,
    case,
    is_julia,
    julia_as_python,
    run_c,
    run_module,
    run_octave,
    write_files,
)

EACH = pytest.mark.parametrize("name", ARMS)
MATH = {"sin", "cos", "sincos", "tanh", "exp", "sqrt", "pow", "fabs", "_GLOBAL_OFFSET_TABLE_"}


def generated(name: str, language: str) -> tuple[Case, dict[str, str], str]:
    each = case(name)
    return each, generate(each.model, each.base, each.values, language), identifier(each.model.robot.name)


@EACH
def test_programs(name: str):
    """The list of operations itself, before any language."""
    each = case(name)
    inputs = {"parameters": each.values, **each.inputs}
    if each.motion.memory is not None:
        inputs["state"] = each.motion.memory
    programs = make_programs(each.model, each.base, list(each.expected))
    each.compare({program.name: program.evaluate(inputs) for program in programs})


@EACH
@pytest.mark.skipif(CC is None, reason="there is no gcc")
def test_c(name: str, tmp_path: Path):
    each, files, prefix = generated(name, "c")
    write_files(files, tmp_path)
    command = [str(CC), "-std=c99", *STRICT, "-fPIC"]
    subprocess.run([*command, "-c", f"{prefix}.c", "-o", "code.o"], cwd=tmp_path, check=True)
    # Nothing but mathematics is called from outside: no heap, no input or output.
    outside = subprocess.run(["nm", "-u", "code.o"], cwd=tmp_path, check=True, capture_output=True, text=True)
    assert {line.split()[-1] for line in outside.stdout.splitlines()} <= MATH
    subprocess.run([str(CC), "-shared", "code.o", "-o", "code.so", "-lm"], cwd=tmp_path, check=True)
    each.compare(run_c(each, tmp_path / "code.so", prefix))


MAIN = """
#include <cstdio>
#include <type_traits>
#include "{p}.hpp"
template <class T> void put(const T& x) {{ std::fwrite(x.data(), sizeof(double), x.size(), stdout); }}
int main() {{
  static_assert(std::is_trivially_copyable<{p}::Model>::value, "a model holds numbers alone");
  const {p}::Model model;
  {start}
  for (int k = 0; k < {samples}; ++k) {{
    {p}::Joints {vectors};
    for ({p}::Joints* x : {{{pointers}}})
      if (std::fread(x->data(), sizeof(double), x->size(), stdin) != x->size()) return 1;
    {update}
    {calls}
  }}
}}
"""


@EACH
@pytest.mark.skipif(CXX is None or CC is None, reason="there is no g++")
def test_cpp(name: str, tmp_path: Path):
    each, files, prefix = generated(name, "cpp")
    memory = bool(each.model.nodes)
    given = {
        name: [x.replace("state", "memory") for x in each.arguments[name] if x != "parameters"]
        for name in each.expected
    }
    calls = [f"put(model.{name}({', '.join(arguments)}));" for name, arguments in given.items()]
    start = f"{prefix}::Memory memory({prefix}::Joints{{}});" if memory else ""
    update = f"if (k == 0) memory = {prefix}::Memory(q); else memory.update(q);" if memory else ""
    vectors, pointers = ", ".join(each.inputs), ", ".join(f"&{name}" for name in each.inputs)
    texts = {"vectors": vectors, "pointers": pointers, "start": start, "update": update}
    main = MAIN.format(p=prefix, samples=SAMPLES, calls="\n    ".join(calls), **texts)
    write_files({**files, "main.cpp": main}, tmp_path)
    subprocess.run([str(CC), "-std=c99", "-c", f"{prefix}.c"], cwd=tmp_path, check=True)
    command = [str(CXX), "-std=c++17", *STRICT, "main.cpp", f"{prefix}.o", "-o", "main"]
    subprocess.run(command, cwd=tmp_path, check=True)
    motion = np.stack(list(each.inputs.values()), 1)
    done = subprocess.run([str(tmp_path / "main")], input=motion.tobytes(), capture_output=True, check=True)
    out = np.frombuffer(done.stdout).reshape(SAMPLES, -1)
    ends = np.cumsum([0, *(x[0].size for x in each.expected.values())])
    each.compare(
        {
            f: out[:, a:b].reshape(x.shape)
            for (f, x), a, b in zip(each.expected.items(), ends[:-1], ends[1:], strict=True)
        }
    )


@EACH
def test_python(name: str):
    each, files, prefix = generated(name, "python")
    module: dict[str, object] = {}
    exec(compile(files[f"{prefix}.py"], f"{prefix}.py", "exec"), module)
    assert module["PARAMETERS"] == tuple(each.values)
    assert module["PARAMETER_NAMES"] == each.base.names
    imports = [node for node in ast.walk(ast.parse(files[f"{prefix}.py"])) if isinstance(node, ast.ImportFrom)]
    assert {node.module for node in imports} <= {"math"} and "\nimport " not in files[f"{prefix}.py"]
    each.compare(run_module(each, module, parameters_first=False))


@EACH
def test_julia_statements(name: str):
    each, files, prefix = generated(name, "julia")
    text = files[f"{prefix}.jl"]
    assert is_julia(text)
    assert not is_julia(text.replace("\nend\n", "\n", 1)) and not is_julia(text.replace("] = ", "] = = ", 1))
    each.compare(run_module(each, julia_as_python(text), parameters_first=True))


@EACH
@pytest.mark.skipif(OCTAVE is None, reason="GNU Octave (octave-cli) is not installed")
def test_octave(name: str, tmp_path: Path):
    each, files, prefix = generated(name, "matlab")
    each.compare(run_octave(each, write_files(files, tmp_path), prefix))


@pytest.mark.parametrize("language", LANGUAGES)
def test_names_and_formulas_stand_in_the_comments(language: str):
    each, files, _ = generated("ur5e", language)
    text = "\n".join(files.values())
    formulas = [formula for formula in base_formulas(each.base) if "+" in formula]
    assert len(formulas) > 10 and all(formula in text for formula in formulas) and "[kg·m²]" in text
    assert all(name in text for name in each.base.names)
    assert generate(each.model, each.base, each.values, language) == files  # the same again
