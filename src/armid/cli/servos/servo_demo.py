"""`armid demo --servo`: simulation, identification and validation of a virtual hobby arm without torque."""

from __future__ import annotations

import json as json_files
import sys
from contextlib import redirect_stdout
from io import StringIO
from pathlib import Path
from typing import Any

import typer

TRAIN, UNSEEN, RESULT = "train", "unseen", "result"
"""Folders of the demo: the training log, the log of another motion, and the result."""

SECONDS = {TRAIN: 40.0, UNSEEN: 20.0}
"""Length of each log [s]."""

KINDS = ("stiffness", "rotor_inertia", "FV", "FS", "offset", "delay")
"""Quantities that are compared with the truth."""


def run_servo_demo(folder: Path, *, seed: int, json: bool) -> None:
    """Simulate two logs, identify the arm from the first one, validate on the second, and compare with the truth."""
    from armid.cli.console import progress
    from armid.cli.servos.servo import servo
    from armid.lab.servos.virtual_arms import HOBBY_ARM, description_of, options_for
    from armid.robot import load_robot
    from armid.study.servos.lab_files import commands_of, simulate_servo_to
    from armid.study.storage.records import to_json

    robot = load_robot(description_of(HOBBY_ARM))
    options = options_for(robot)
    done = {}
    with progress(quiet=json) as tell:
        for k, name in enumerate((TRAIN, UNSEEN)):
            motion = commands_of(None, robot, options.sensing.rate, SECONDS[name], seed + k)
            done[name] = simulate_servo_to(
                folder / name,
                robot,
                motion,
                options,
                seed=seed + k,
                tell=lambda share, k=k: tell("virtual lab", 0.5 * (k + share)),
            )
    code, printed = 0, StringIO()
    logs = [str(done[TRAIN].description), str(done[TRAIN].recording)]
    try:
        with redirect_stdout(printed if json else sys.stdout):
            servo(logs, validate=[str(done[UNSEEN].recording)], out=folder / RESULT, json=json)
    except typer.Exit as end:
        code = end.exit_code
    record = json_files.loads((folder / RESULT / "servo.json").read_text(encoding="utf-8"))
    truth = json_files.loads(done[TRAIN].truth.read_text(encoding="utf-8"))
    compared = compare_with_truth(record, truth)
    if json:
        sys.stdout.write(to_json({**record, "run": str(folder / RESULT), "truth": compared}) + "\n")
    else:
        _print(compared)
    if code:
        raise typer.Exit(code)


def _print(compared: list[dict[str, Any]]) -> None:
    """Print the largest error of each quantity, and how many intervals hold the truth."""
    from armid.cli.console import output_console

    scales = {"offset": (1e3, "mrad"), "delay": (1e3, "ms")}
    for kind in KINDS:
        each = [value for value in compared if value["kind"] == kind]
        scale, unit = scales.get(kind, (100.0, "%"))
        worst = max((abs(value["error"]) for value in each), default=0.0)
        inside = sum(value["inside"] for value in each)
        output_console().print(
            f"{kind}: largest error against the true values {scale * worst:.2g} {unit}; {inside} of {len(each)} "
            "intervals hold the truth"
        )


def compare_with_truth(record: dict[str, Any], truth: dict[str, Any]) -> list[dict[str, Any]]:
    """Estimated and true value, error and interval of each quantity of each joint.

    Errors are relative, except those of offsets [rad or m] and delays [s].

    Args:
        record: Content of a `servo.json`.
        truth: Content of a `truth.json`.
    """
    compared: list[dict[str, Any]] = []
    for value in record["values"]:
        kind, number = value["kind"], record["joints"].index(value["joint"])
        if kind not in KINDS:
            continue
        if kind in truth["servo"]:
            right = truth["servo"][kind][number]
        else:
            right = truth["parameters"][f"{'IA' if kind == 'rotor_inertia' else kind}_{number + 1}"]
        error = value["value"] - right
        compared.append(
            {
                "kind": kind,
                "joint": value["joint"],
                "value": value["value"],
                "true": right,
                "error": error if kind in ("offset", "delay") else error / right,
                "inside": value["low"] <= right <= value["high"],
            }
        )
    return compared
