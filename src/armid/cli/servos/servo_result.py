"""Printed result of an identification of servos: closed-loop errors, gains with intervals, what the data show."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rich.markup import escape
from rich.table import Table

from armid.cli.console import output_console

if TYPE_CHECKING:
    from armid.runs.servos.stored_servo import StoredServo
    from armid.servo.estimate_table import EstimatedValue

MARKS = {
    "identified": "",
    "weakly identified": " w",
    "prior-dominated": " p",
    "not identifiable": " n",
    "given": " g",
}
"""Mark behind a value, by its origin."""


def print_servo_result(stored: StoredServo) -> None:
    """Print the closed-loop errors and the parameters with their intervals."""
    console = output_console()
    console.print(errors_table(stored))
    console.print(_parameters(stored))
    console.print(
        "values with 95 % intervals, which are lower limits (docs/servo.md); w: weakly identified, p: dominated by "
        "the prior, n: not identifiable from these recordings, g: given"
    )
    for each in stored.values:
        if each.origin == "not identifiable" and each.kind == "stiffness":
            joint = escape(stored.robot.joint_names[each.joint])
            console.print(f"stiffness of {joint}: {escape(each.reason)}")
    console.print(f"{stored.seconds:.1f} s from recordings to result")


def errors_table(stored: StoredServo) -> Table:
    """Table of closed-loop errors, joint by joint."""
    from armid.servo.quantities import POSITION_ERROR

    errors, score, joints = stored.errors, stored.errors.score, stored.robot.joints
    table = Table(
        title=f"{escape(stored.robot.name)}: closed-loop position error, RMS in {POSITION_ERROR.units(joints)}"
    )
    table.add_column("joint")
    rows = [("training", errors.training), ("left-out parts", errors.left_out)]
    if score is not None:
        rows += [("validation", score.model), ("command = position", score.command)]
        rows += [] if score.described is None else [("description", score.described)]
    for name, _ in rows:
        table.add_column(name, justify="right")
    table.add_column("95 % band", justify="right")
    scale = POSITION_ERROR.scale
    for j, joint in enumerate(stored.robot.joint_names):
        numbers = (f"{scale * error.joints[j]:.2f}" for _, error in rows)
        table.add_row(escape(joint), *numbers, f"±{scale * errors.band[j]:.2f}")
    table.add_section()
    inside = "" if score is None else f"{100.0 * score.coverage.mean():.0f} % inside"
    table.add_row("all", *(f"{scale * error.total:.2f}" for _, error in rows), inside)
    return table


def _parameters(stored: StoredServo) -> Table:
    """Table of the parameters of each joint."""
    from armid.servo.quantities import QUANTITIES, quantity_of

    kinds = [kind for kind in QUANTITIES if any(each.kind == kind for each in stored.values)]
    kinds += sorted({each.kind for each in stored.values} - set(QUANTITIES))
    table = Table(title="servos and friction")
    table.add_column("joint")
    for kind in kinds:
        quantity = quantity_of(kind)
        table.add_column(f"{quantity.title}\n{quantity.units(stored.robot.joints)}", justify="right")
    for j, joint in enumerate(stored.robot.joint_names):
        own = stored.joint_values(j)
        table.add_row(escape(joint), *(_cell(own[kind]) if kind in own else "" for kind in kinds))
    return table


def _cell(value: EstimatedValue) -> str:
    from armid.servo.quantities import quantity_of

    scale = quantity_of(value.kind).scale
    middle, low, high = (f"{scale * x:.3g}" for x in (value.value, value.low, value.high))
    interval = "" if value.origin == "given" else f"\n{low} … {high}"
    return f"{middle}{MARKS[value.origin]}{interval}"
