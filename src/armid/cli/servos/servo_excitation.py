"""`armid excite --servo`: design of a motion of commands for an arm with position servos."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from armid.errors import ArmidError

if TYPE_CHECKING:
    from armid.robot import Robot
    from armid.servo.motion_design.search import CommandDesign
    from armid.servo.parameters import ServoModel

ARM, MOTION = ("gravity", "lock", "only", "tip", "package"), ("duration", "limit", "torque_margin", "format_rate")
USED = frozenset((*ARM, *MOTION, "servo", "stiffness", "damping", "budget", "seed", "out", "json"))
"""Options of `armid excite` that hold for a motion of commands."""

RATE, MARGIN = 50.0, 0.3
"""Default rate of the commands [Hz], and default share of the largest torques of the servos that stays unused."""


def excite_servos(arm: Robot, folder: Path, options: Mapping[str, Any], usual: Mapping[str, Any]) -> None:
    """Design the motion, write its files and print what is expected of it.

    Args:
        arm: The arm.
        folder: Output folder.
        options: Values of the options of `armid excite`, by name.
        usual: Default values of these options.
    """
    from armid.cli.console import print_findings, progress
    from armid.cli.motion.number_options import parse_limits
    from armid.model.terms import Coulomb, Viscous
    from armid.servo.motion_design.search import design_commands
    from armid.servo.parameters import make_servo_model
    from armid.study.plans.design_writing import refuse_plan_folder
    from armid.study.servos.choice import ServoChoice, servo_options
    from armid.study.servos.command_plan import command_plan_record, limited_robot, save_command_plan
    from armid.study.storage.records import to_json

    _refuse_others(options, usual)
    refuse_plan_folder(folder)
    robot = limited_robot(arm, parse_limits(options["limit"] or ()))
    stiffness, damping = (_gains(options[name], name) for name in ("stiffness", "damping"))
    model = make_servo_model(robot, [Viscous(), Coulomb(0.0)])
    margin = MARGIN if options["torque_margin"] is None else options["torque_margin"]
    with progress(quiet=options["json"]) as tell:
        design = design_commands(
            model,
            servo_options(ServoChoice(stiffness=stiffness, damping=damping), robot),
            seconds=options["duration"],
            rate=options["format_rate"] or RATE,
            torque_share=1.0 - margin,
            budget=options["budget"],
            seed=options["seed"],
            progress=lambda value, share: tell(f"criterion {value:.3f}", share),
        )
    written = save_command_plan(design, model, folder)
    if options["json"]:
        sys.stdout.write(to_json({**command_plan_record(design, model), "folder": str(folder)}) + "\n")
    else:
        _print(design, model)
        sys.stdout.write(f"written to {folder}: {', '.join(written)}\n")
    print_findings(arm.findings)


def _refuse_others(options: Mapping[str, Any], usual: Mapping[str, Any]) -> None:
    """Raises an error about options that have no meaning for a motion of commands."""
    given = [name for name, value in options.items() if name not in USED and value != usual[name]]
    if given:
        names = ", ".join("--" + name.replace("_", "-") for name in given)
        raise ArmidError(
            f"{names}: not possible together with --servo.",
            possible=", ".join("--" + name.replace("_", "-") for name in sorted(USED - {"servo"})),
            remedy="leave these options out.",
        )


def _gains(text: str | None, name: str) -> tuple[float, ...] | None:
    """Numbers of an option, separated by commas; `None` if the option is not given."""
    try:
        return None if text is None else tuple(float(part) for part in text.split(","))
    except ValueError:
        raise ArmidError(f"--{name} {text} is not a list of numbers.", remedy=f"write --{name} 20,20,15.") from None


def _print(design: CommandDesign, model: ServoModel) -> None:
    """Print expected deviations, predicted torques and positions, joint by joint."""
    from rich.markup import escape
    from rich.table import Table

    from armid.cli.console import output_console

    kinds = {"stiffness": "stiffness", "rotor_inertia": "rotor inertia", "FV": "viscous", "FS": "Coulomb"}
    kinds["delay"] = "delay"
    table = Table(title="expected standard deviations, %; of delays, ms")
    table.add_column("joint")
    for heading in (*kinds.values(), "largest torque", "position"):
        table.add_column(heading, justify="right")
    found = {}
    for (field, k), value in design.deviations.items():
        law = model.laws[k] if field == "friction" else None
        found[(field, k) if law is None else (law.symbol, law.joint)] = value
    for j, joint in enumerate(model.robot.joints):
        cells = [
            "given" if (kind, j) not in found else f"{(1e3 if kind == 'delay' else 100.0) * found[kind, j]:.2g}"
            for kind in kinds
        ]
        low, high = design.positions[:, j]
        torque = f"{design.torque_share[j]:.0%} of limit" if design.torque_share[j] > 0.0 else "no limit"
        table.add_row(escape(joint.name), *cells, torque, f"{low:.2f} … {high:.2f} {joint.unit}")
    output_console().print(table)
    sys.stdout.write(
        f"the best of {design.trials} motions; distances between bodies were not checked, so watch the first run at "
        "low speed\n"
    )
