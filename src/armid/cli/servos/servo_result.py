"""Printed result of an identification of servos: closed-loop errors, gains with intervals, what the data show."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rich.markup import escape
from rich.table import Table

from armid.cli.console import output_console

if TYPE_CHECKING:
    from armid.servo.estimate_table import EstimatedValue
    from armid.study.servos.identification import ServoResult

COLUMNS = {
    "stiffness": "stiffness\nN·m/rad",
    "damping": "damping\nN·m·s/rad",
    "FV": "viscous\nN·m·s/rad",
    "FS": "Coulomb\nN·m",
    "rotor_inertia": "rotor inertia\nkg·m²",
    "offset": "offset\nmrad",
    "delay": "delay\nms",
}
"""Headings of the columns of the table of parameters, by kind."""

SCALES = {"offset": 1e3, "delay": 1e3}
MARKS = {
    "identified": "",
    "weakly identified": " w",
    "prior-dominated": " p",
    "not identifiable": " n",
    "given": " g",
}
"""Mark behind a value, by its origin."""


def print_servo_result(result: ServoResult) -> None:
    """Print the closed-loop errors and the parameters with their intervals."""
    console = output_console()
    console.print(_errors(result))
    console.print(_parameters(result))
    console.print(
        "values with 95 % intervals, which are lower limits (docs/servo.md); w: weakly identified, p: dominated by "
        "the prior, n: not identifiable from these recordings, g: given"
    )
    for each in result.values:
        if each.origin == "not identifiable" and each.kind == "stiffness":
            joint = escape(result.robot.joint_names[each.joint])
            console.print(f"stiffness of {joint}: {escape(each.reason)}")
    console.print(f"{result.seconds:.1f} s from recordings to result")


def _errors(result: ServoResult) -> Table:
    """Table of closed-loop errors, joint by joint."""
    score = result.score
    table = Table(
        title=f"{escape(result.robot.name)}: closed-loop position error, RMS in mrad (mm for sliding joints)"
    )
    table.add_column("joint")
    rows = [("training", result.estimate.training), ("left-out parts", result.estimate.left_out[0])]
    if score is not None:
        rows += [("validation", score.model), ("command = position", score.command)]
        rows += [] if score.described is None else [("description", score.described)]
    for name, _ in rows:
        table.add_column(name, justify="right")
    for j, joint in enumerate(result.robot.joint_names):
        table.add_row(escape(joint), *(f"{1e3 * error.joints[j]:.2f}" for _, error in rows))
    table.add_section()
    table.add_row("all", *(f"{1e3 * error.total:.2f}" for _, error in rows))
    return table


def _parameters(result: ServoResult) -> Table:
    """Table of the parameters of each joint."""
    kinds = [kind for kind in COLUMNS if any(each.kind == kind for each in result.values)]
    kinds += sorted({each.kind for each in result.values} - set(COLUMNS))
    table = Table(title="servos and friction")
    table.add_column("joint")
    for kind in kinds:
        table.add_column(COLUMNS.get(kind, kind), justify="right")
    for j, joint in enumerate(result.robot.joint_names):
        own = {each.kind: each for each in result.values if each.joint == j}
        table.add_row(escape(joint), *(_cell(own[kind]) if kind in own else "" for kind in kinds))
    return table


def _cell(value: EstimatedValue) -> str:
    scale = SCALES.get(value.kind, 1.0)
    middle, low, high = (f"{scale * x:.3g}" for x in (value.value, value.low, value.high))
    interval = "" if value.origin == "given" else f"\n{low} … {high}"
    return f"{middle}{MARKS[value.origin]}{interval}"
