"""`armid simulate --servo`: simulated log of an arm with position servos, with commands and positions."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from armid.errors import LabError

if TYPE_CHECKING:
    from armid.robot import Robot
    from armid.study.config import RobotChoice
    from armid.study.servos.lab_files import WrittenServoSimulation


@dataclass(frozen=True, slots=True)
class ServoSimulationRequest:
    """Options of `armid simulate --servo`, as given.

    Attributes:
        plan: Commands, plan or name of a built-in plan; `None` for a random motion.
        options: Path of a `lab.toml`.
        effects: Names of effects, separated by commas.
        repetitions: Number of repetitions of the motion.
        period: Period of a plan [s].
        rate: Rate of the bus [Hz].
        seconds: Duration of a random motion [s].
        seed: Seed of noise, jitter, faults and random motion.
        kind: Format of the recording.
        noise_free: True if motion and torque without noise are written, too.
    """

    plan: str | None
    options: Path | None
    effects: str | None
    repetitions: int | None
    period: float | None
    rate: float | None
    seconds: float
    seed: int
    kind: str
    noise_free: bool


def simulate_servos(request: ServoSimulationRequest, choice: RobotChoice, out: Path | None, *, json: bool) -> None:
    """Simulate the arm, write the files and print what was written."""
    from dataclasses import replace

    from armid.cli.console import print_findings, progress
    from armid.cli.options import run_folder
    from armid.lab.servos.options import servo_lab_table
    from armid.lab.servos.simulation import servo_findings
    from armid.lab.servos.virtual_arms import options_for
    from armid.output.locks import claim
    from armid.study.config import load_choice
    from armid.study.servos.lab_files import commands_of, refuse_servo_format, servo_description, simulate_servo_to

    arm = load_choice(replace(choice, description=servo_description(choice.description)))
    refuse_servo_format(request.kind, arm)
    table: dict[str, Any] = {} if request.options is None else servo_lab_table(request.options)
    if request.repetitions is not None:
        table["repetitions"] = request.repetitions
    if request.effects is not None:
        names = [name.strip() for name in request.effects.split(",") if name.strip()]
        table["arm"] = {**table.get("arm", {}), "effects": names}
    if request.rate is not None:
        table["sensing"] = {**table.get("sensing", {}), "rate": request.rate}
    options = options_for(arm, table)
    motion = commands_of(request.plan, arm, options.sensing.rate, request.seconds, request.seed, request.period)
    with progress(quiet=json) as tell:
        claim(folder := out or run_folder(None, f"{arm.name}-lab"))
        done = simulate_servo_to(
            folder,
            arm,
            motion,
            options,
            kind=request.kind,
            seed=request.seed,
            noise_free=request.noise_free,
            tell=lambda share: tell("simulation", share),
        )
    _report(done, arm, json=json)
    print_findings((*arm.findings, *servo_findings(done.simulated)))


def refuse_controller(mode: str | None, controller: str | None) -> None:
    """Raises an error if options of another controller are given together with `--servo`."""
    given = [f"--{name} {value}" for name, value in (("mode", mode), ("controller", controller)) if value is not None]
    if given:
        raise LabError(
            f"{given[0]} and --servo exclude each other: servos are the controller of the arm.",
            remedy="leave out one of the two.",
        )


def _report(done: WrittenServoSimulation, arm: Robot, *, json: bool) -> None:
    """Print the written files, the number of rows, and how far the joints are from their commands."""
    import numpy as np

    from armid.notebook_display import plural
    from armid.study.storage.records import to_json

    recording = done.simulated.recording
    assert recording.command is not None
    error = np.sqrt(np.nanmean((recording.command - recording.q) ** 2, axis=0))
    if json:
        record = {
            "recording": str(done.recording),
            "truth": str(done.truth),
            "description": None if done.description is None else str(done.description),
            "samples": recording.samples,
            "rate": done.simulated.options.sensing.rate,
            "joints": arm.joint_names,
            "position_error": error,
        }
        sys.stdout.write(to_json(record) + "\n")
        return
    parts = [
        f"{1e3 * x:.1f} {'mm' if joint.is_prismatic else 'mrad'}" for x, joint in zip(error, arm.joints, strict=True)
    ]
    written = [done.recording, done.truth, *([done.description] if done.description else [])]
    sys.stdout.write(
        f"{plural(recording.samples, 'row')} of {plural(arm.n, 'joint')}; command minus position, RMS: "
        f"{', '.join(parts)}\nwritten: {', '.join(map(str, written))}\n"
    )
