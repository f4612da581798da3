"""Input for the module of a programming language: functions of a model, base parameters, and names."""

from __future__ import annotations

import keyword
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from numpy.typing import ArrayLike

from armid.checked_array import Array, array
from armid.codegen.functions import PROGRAMS, make_programs
from armid.codegen.program import Program
from armid.model.base_formulas import base_formulas
from armid.model.base_parameters import BaseParameters
from armid.model.dynamics_model import DynamicsModel

RESERVED = frozenset(
    """auto bool break case catch char class const continue default delete do double else enum explicit export extern
    float for friend function goto if inline int long mutable namespace new operator private protected public register
    restrict return short signed sizeof static struct switch template this throw try typedef union unsigned using
    virtual void volatile while begin end module baremodule local global let quote macro elseif otherwise parfor
    persistent spmd math std armid controller deviation estimate reference samples seconds state step torque wanted q
    dq ddq tau""".split()
)
"""Reserved words of the languages, and variables of the examples; the names of generated modules must differ from
them."""


HELD_IN_A_LINE = 3
"""Number of locked joints on one line of a comment."""


@dataclass(frozen=True, slots=True)
class NamedValue:
    """Base parameter as it is written into generated code.

    Attributes:
        name: Name of the base parameter, for instance `ZZR_2`.
        variable: Name of the variable in the code.
        unit: Unit of the parameter.
        value: Estimated value.
        formula: Formula of the base parameter in terms of standard parameters.
    """

    name: str
    variable: str
    unit: str
    value: float
    formula: str

    @property
    def note(self) -> str:
        """Text of a comment: formula and unit of the base parameter."""
        alone = self.formula == f"{self.name} = {self.name}"
        return f"{self.name if alone else self.formula} [{self.unit}]"


@dataclass(frozen=True, eq=False, slots=True)
class FunctionSource:
    """Model prepared for code generation.

    Attributes:
        name: Name of the file or module, and prefix of functions.
        heading: Lines for the head of the files, which state the data from which the code was made.
        joints: Names of the joints.
        parameters: Base parameters, in the order of the columns of the base regressor.
        columns: Names of the standard parameters, in the order of the columns of the regressor.
        programs: Programs of the functions, by name.
        widths: For each hysteresis state, its coordinate and half-width, as text for comments.
        model: Model for which the code is generated.
        base: Base parameters of the model.
    """

    name: str
    heading: tuple[str, ...]
    joints: tuple[str, ...]
    parameters: tuple[NamedValue, ...]
    columns: tuple[str, ...]
    programs: Mapping[str, Program]
    widths: tuple[str, ...]
    model: DynamicsModel
    base: BaseParameters

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.joints)

    def about(self) -> list[str]:
        """Lines of text for the head of the generated files: data source, joints, units, gravity, hysteresis."""
        lines = [
            *map(_harmless, self.heading),
            "",
            f"Joints: {_harmless(', '.join(self.joints))}. SI units throughout: rad, m, s, kg, N, N m.",
            f"{len(self.parameters)} base parameters replace {len(self.columns)} standard parameters. Inertia is"
            " about the origins of the link frames.",
            f"Gravity, built in: acceleration {_numbers(self.model.robot.gravity)} m/s2 in the base frame.",
            *self._locked(),
        ]
        if self.widths:
            lines += [
                "The torque depends on earlier motion (hysteresis). Initialise the state at the start of the motion,",
                "and update it once at every sample, before the torque is computed. Each element of the state",
                "follows one coordinate, from which it differs by at most its half-width:",
                *(f"  {k + 1}: {width}" for k, width in enumerate(self.widths)),
                "An element does not depend on its initial value any more as soon as its coordinate has covered a",
                "range of more than two half-widths.",
            ]
        return lines

    def _locked(self) -> list[str]:
        """Lines of text that state the positions at which joints of the description are locked."""
        held = [f"{_harmless(each.name)} = {each.position:.10g} {each.unit}" for each in self.model.robot.held]
        if not held:
            return []
        rows = [", ".join(held[k : k + HELD_IN_A_LINE]) for k in range(0, len(held), HELD_IN_A_LINE)]
        return ["Locked joints; the model contains the bodies that they carry:", *(f"  {row}" for row in rows)]


def make_source(
    model: DynamicsModel,
    base: BaseParameters,
    values: ArrayLike,
    *,
    name: str = "",
    heading: Sequence[str] = (),
    wanted: Sequence[str] = PROGRAMS,
) -> FunctionSource:
    """Prepares a model for the module of a programming language.

    Args:
        model: Arm and torque terms.
        base: Base parameters of the model.
        values: Values of the base parameters, shape (b,).
        name: Name of the generated module and prefix of its functions; if empty, the name of the robot is used.
        heading: Lines for the head of the files, which state the data from which the code was made.
        wanted: Names of the functions, from `PROGRAMS`.
    """
    numbers = array(values, (base.count,), "base parameters")
    parameters = tuple(
        NamedValue(symbol, re.sub(r"\W", "_", symbol), unit, float(value), formula)
        for symbol, unit, value, formula in zip(base.names, base.units, numbers, base_formulas(base), strict=True)
    )
    widths = tuple(
        f"{_coordinate(node.coordinate)}, half-width {node.memory.width:g} rad or m ({node.term})"
        for node in model.nodes
    )
    programs = {program.name: program for program in make_programs(model, base, wanted)}
    return FunctionSource(
        identifier(name or model.robot.name),
        tuple(heading) or (f"Dynamic model of {model.robot.name}, generated by armid.",),
        model.robot.joint_names,
        parameters,
        tuple(p.name for p in model.parameters),
        programs,
        widths,
        model,
        base,
    )


def identifier(name: str) -> str:
    """Changes a name so that it is a valid identifier in every language: `iiwa14-r820` gives `iiwa14_r820`."""
    plain = re.sub(r"[^0-9A-Za-z]+", "_", name).strip("_").lower()
    if not plain or plain[0].isdigit() or plain in RESERVED or keyword.iskeyword(plain):
        plain = f"arm_{plain}".rstrip("_")
    return plain


def _numbers(vector: Array) -> str:
    """Writes a vector as text, with enough digits to distinguish 9.8, 9.81 and 9.80665 m/s²."""
    return f"({', '.join(f'{x + 0.0:.10g}' for x in vector)})"


def _harmless(text: str) -> str:
    """Replaces characters of a text that could end a comment, a string or a line in generated code."""
    return re.sub(r"[^\w .,:;()/+=-]", "_", text)


def _coordinate(coordinate: Sequence[tuple[int, float]]) -> str:
    """Writes a weighted sum of joint positions as text, for instance `q3` or `q5 + q6`."""
    parts = [f"q{j + 1}" if weight == 1.0 else f"{weight:g} q{j + 1}" for j, weight in coordinate]
    return " + ".join(parts)
