"""`armid base`: base parameters of an arm, which are the parameters that its torques determine."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from enum import StrEnum
from typing import TYPE_CHECKING, Annotated

import typer

from armid.cli.options import (
    BASE_TERMS,
    Gravity,
    Json,
    Lock,
    Only,
    Package,
    RobotName,
    Terms,
    TipLink,
    model_choice,
    robot_choice,
)

if TYPE_CHECKING:
    from armid.model.base_parameters import BaseParameters


class Style(StrEnum):
    """Notation in which the formulas of base parameters are printed."""

    text = "text"
    latex = "latex"


def base(
    robot: RobotName,
    gravity: Gravity = None,
    lock: Lock = None,
    only: Only = None,
    tip: TipLink = None,
    package: Package = None,
    terms: Terms = None,
    style: Annotated[Style, typer.Option(help="Notation of the formulas.")] = Style.text,
    columns: Annotated[
        bool,
        typer.Option(
            "--columns", help="Also print each removed column of the regressor as a combination of kept columns."
        ),
    ] = False,
    json: Json = False,
) -> None:
    """Count and name the base parameters of an arm, and print the formula of each grouping.

    Examples:
        armid base iiwa14-r820 --gravity 0 0 9.81

        armid base panda.urdf --lock panda_finger_joint1 --lock panda_finger_joint2 --style latex
    """
    from armid.cli.console import output_console, print_findings
    from armid.model.base_formulas import base_formulas, base_record, column_formulas
    from armid.model.base_parameters import find_base_parameters
    from armid.model.parameter_counts import count_text
    from armid.study.config import build_model, load_choice
    from armid.study.storage.records import to_json

    arm = load_choice(robot_choice(robot, gravity, lock, only, tip, package))
    base_parameters = find_base_parameters(build_model(arm, model_choice(terms, default=BASE_TERMS)))
    if json:
        sys.stdout.write(to_json(base_record(base_parameters)) + "\n")
        print_findings(arm.findings)
        return
    formulas = base_formulas(base_parameters, style.value)
    dependencies = ("", *column_formulas(base_parameters, style.value)) if columns else ()
    if style is Style.latex:
        lines: Sequence[str] = formulas
    else:
        zero = [base_parameters.standard_names[k] for k in base_parameters.zero_columns]
        output_console().print(
            f"[bold]{arm.name}[/]: {base_parameters.count} base parameters "
            f"({count_text(base_parameters.names)}) of {len(base_parameters.standard_names)} standard parameters, "
            f"{len(zero)} of them without effect on the torque" + (f" ({', '.join(zero)})" if zero else "")
        )
        lines = _group_by_joint(base_parameters, formulas, arm.joint_names)
    sys.stdout.write("\n".join((*lines, *dependencies)) + "\n")
    print_findings(arm.findings)


def _group_by_joint(base_parameters: BaseParameters, formulas: Sequence[str], joints: Sequence[str]) -> list[str]:
    """Lines to print for each joint: formulas of its base parameters that are sums, then names of the other ones."""
    from armid.model.parameter_counts import by_joint

    lines: list[str] = []
    for number, indices in by_joint(base_parameters.names).items():
        grouped = [k for k in indices if formulas[k] != f"{base_parameters.names[k]} = {base_parameters.names[k]}"]
        single = [base_parameters.names[k] for k in indices if k not in grouped]
        lines += [f"{number} {joints[number - 1]}", *(f"  {formulas[k]}" for k in grouped)]
        lines += [f"  {', '.join(single)}"] if single else []
    return lines
