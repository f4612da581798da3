"""Generation of a ROS 2 package (ament_cmake) with a plugin of `inverse_dynamics_solver::InverseDynamicsSolver`.

The package contains the generated C code. A solver reads the parameter values from a YAML file when it is
initialised, so a later estimate of the same model needs no build.
"""

from __future__ import annotations

import re
from dataclasses import replace

from armid.codegen.functions import make_programs
from armid.codegen.language_input import FunctionSource
from armid.codegen.languages import c
from armid.codegen.program import STATE_FUNCTIONS
from armid.codegen.term_laws import is_inertia
from armid.codegen.texts.ros2_texts import CMAKE, HEADER, LICENSE, PACKAGE, PLUGIN, README, SOLVER, YAML
from armid.hashes import digest
from armid.model.torque_law_expression import symbols

NEEDED = ("inverse_dynamics", "gravity_torque", "coriolis_torque", "mass_matrix", "friction", "velocity_friction")
"""Names of the functions that the plugin calls, except those of the hysteresis state."""


def write(source: FunctionSource) -> dict[str, str]:
    """Generates the texts of the files of the package; the keys of the result are the paths."""
    missing = [name for name in (*NEEDED, *STATE_FUNCTIONS) if name not in source.programs]
    more = {program.name: program for program in make_programs(source.model, source.base, missing)}
    source = replace(source, programs={**source.programs, **more})
    code, package, values = c.write(source), f"{source.name}_inverse_dynamics_solver", _values(source)
    return {
        "package.xml": _filled(PACKAGE, values),
        "CMakeLists.txt": _filled(CMAKE, values),
        f"{package}.xml": _filled(PLUGIN, values),
        "README.md": _filled(README, values),
        "LICENSE": LICENSE,
        "config/parameters.yaml": _filled(YAML, values),
        f"include/{package}/{source.name}.h": code[f"{source.name}.h"],
        f"include/{package}/solver.hpp": _filled(HEADER, values),
        f"src/{source.name}.c": code[f"{source.name}.c"],
        "src/solver.cpp": _filled(SOLVER, values),
    }


def _values(source: FunctionSource) -> dict[str, str]:
    """Text that replaces each placeholder of the files; the keys are the names of the placeholders."""
    about = [line for line in source.about() if line]
    dependent = _not_of_velocity(source)
    return {
        "name": source.name,
        "package": f"{source.name}_inverse_dynamics_solver",
        "joints": str(source.n),
        "count": str(len(source.parameters)),
        "digest": digest(*c.functions(source)),
        "about_cpp": "\n".join(f"// {line}" for line in about),
        "about_yaml": "\n".join(f"# {line}" for line in about),
        "about_text": "\n".join(f"    {line}" for line in about),
        "values": "\n".join(f"        - {_decimal(p.value)}  # {p.note}" for p in source.parameters),
        "left_out": f"all but: {', '.join(dependent)}" if dependent else "all",
        **_state_texts(source),
        **_calls(source),
    }


def _not_of_velocity(source: FunctionSource) -> list[str]:
    """Names of the terms of friction that depend on other quantities than velocities, in the order of the model."""
    laws = [(name, law) for name, law in source.model.laws if not is_inertia(law)]
    return list(dict.fromkeys(name for name, law in laws if not symbols(law.expression) <= {"dq"}))


def _state_texts(source: FunctionSource) -> dict[str, str]:
    """Texts about the hysteresis state, which are empty for a model without hysteresis."""
    if not source.widths:
        return {
            "state_member": "",
            "state_reset": "",
            "state_update": "",
            "threads": "Several threads may use a solver after its initialisation.",
        }
    name = source.name
    return {
        "state_member": f"  mutable {name}_state state_{{}};\n  mutable bool started_ = false;\n",
        "state_reset": "  started_ = false;\n",
        "state_update": f"  if (started_) {{\n    {name}_state_update(q, &state_);\n  }} else {{\n"
        f"    {name}_state_start(q, &state_);\n    started_ = true;\n  }}\n",
        "threads": "The friction of this model depends on earlier motion (hysteresis), which getTorques and"
        " computeTorques follow\n// through the positions that they are given: call one of them at every sample of"
        " one motion, from one thread.\n// initialize begins a new motion.",
    }


def _calls(source: FunctionSource) -> dict[str, str]:
    """Arguments with which the solver calls the C functions `inverse_dynamics` and `friction`, by placeholder."""
    texts = {"parameters": "parameters_.data()", "state": "&state_"}
    return {
        f"{name}_arguments": ", ".join(texts.get(a.name, a.name) for a in source.programs[name].arguments)
        for name in ("inverse_dynamics", "friction")
    }


def _decimal(value: float) -> str:
    """Text of a number with a decimal point, so that every reader of YAML takes it as floating point."""
    mantissa, _, exponent = repr(value).partition("e")
    point = "" if "." in mantissa else ".0"
    return f"{mantissa}{point}{'e' + exponent if exponent else ''}"


def _filled(text: str, values: dict[str, str]) -> str:
    """Text in which each placeholder such as `@name@` is replaced by its value."""
    return re.sub(r"@(\w+)@", lambda match: values[match[1]], text)
