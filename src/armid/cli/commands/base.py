"""`armid base`: which parameters the torques of an arm can show."""

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

__all__ = ["base"]


class Style(StrEnum):
    """Rules for writing formulas."""

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
    style: Annotated[Style, typer.Option(help="How formulas are written.")] = Style.text,
    columns: Annotated[
        bool, typer.Option("--columns", help="Also how each removed column depends on kept ones.")
    ] = False,
    json: Json = False,
) -> None:
    """Count and name the base parameters of an arm, with their groupings as formulas.

    Examples:
        armid base iiwa14-r820 --gravity 0 0 9.81

        armid base panda.urdf --lock panda_finger_joint1 --lock panda_finger_joint2 --style latex
    """
    from armid.cli.console import output_console, print_findings
    from armid.model.base_formulas import base_formulas, base_record, column_formulas
    from armid.model.base_parameters import find_base_parameters
    from armid.model.parameter_counts import count_text
    from armid.study.config import build_model, load_choice
    from armid.study.records import to_json

    arm = load_choice(robot_choice(robot, gravity, lock, only, tip, package))
    found = find_base_parameters(build_model(arm, model_choice(terms, default=BASE_TERMS)))
    if json:
        sys.stdout.write(to_json(base_record(found)) + "\n")
        print_findings(arm.findings)
        return
    formulas = base_formulas(found, style.value)
    more = ("", *column_formulas(found, style.value)) if columns else ()
    if style is Style.latex:
        lines: Sequence[str] = formulas
    else:
        zero = [found.standard_names[k] for k in found.zero_columns]
        output_console().print(
            f"[bold]{arm.name}[/]: {found.count} base parameters of {len(found.standard_names)}, "
            f"{count_text(found.names)}; {len(zero)} without effect" + (f" ({', '.join(zero)})" if zero else "")
        )
        lines = _grouped(found, formulas, arm.joint_names)
    sys.stdout.write("\n".join((*lines, *more)) + "\n")
    print_findings(arm.findings)


def _grouped(found: BaseParameters, formulas: Sequence[str], joints: Sequence[str]) -> list[str]:
    """Base parameters under their joints: groupings as formulas, then those that stand for themselves alone."""
    from armid.model.parameter_counts import by_joint

    lines: list[str] = []
    for number, own in by_joint(found.names).items():
        grouped = [k for k in own if formulas[k] != f"{found.names[k]} = {found.names[k]}"]
        alone = [found.names[k] for k in own if k not in grouped]
        lines += [f"{number} {joints[number - 1]}", *(f"  {formulas[k]}" for k in grouped)]
        lines += [f"  {', '.join(alone)}"] if alone else []
    return lines
