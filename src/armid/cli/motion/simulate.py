"""`armid simulate`: simulated recording of an arm with known parameters."""

from __future__ import annotations

import sys
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from armid.cli.options import Gravity, Json, Lock, Only, Out, Package, RobotName, TipLink, robot_choice, run_folder

if TYPE_CHECKING:
    from armid.lab.options import LabOptions
    from armid.study.config import RobotChoice
    from armid.study.plans.simulation_files import WrittenSimulation

PlannedMotion = Annotated[
    str | None,
    typer.Argument(
        metavar="PLAN",
        help="A plan.json, the folder of a plan, or a motion file in this folder; thesis-a1 or thesis-a2; "
        "with --servo also a table commands.csv.",
    ),
]
Mode = Annotated[
    str | None,
    typer.Option(
        metavar="closed-loop|inverse-dynamics",
        help="closed-loop: arm under a controller in MuJoCo; inverse-dynamics: motion exactly as planned.",
    ),
]


OptionsFile = Annotated[
    Path | None, typer.Option("--options", metavar="FILE", help="A lab.toml with further options (docs/lab.md).")
]
ControllerKind = Annotated[str | None, typer.Option(metavar="computed-torque|pd-gravity|pid", help="The controller.")]
Effects = Annotated[
    str | None,
    typer.Option(
        metavar="A,B,…",
        help="Drive effects: rotor, elastic, stribeck, asymmetric, load, hysteresis, ripple, temperature.",
    ),
]
SimulatedPeriod = Annotated[
    float | None,
    typer.Option(help="Period of the simulated motion, s; the plan is slowed down or sped up to this period."),
]
RecordingFormat = Annotated[
    str,
    typer.Option(
        "--format",
        metavar="csv|parquet|npz|mat|bag|db3|mcap|lerobot",
        help="File format of the recording; lerobot, a data set, with --servo only.",
    ),
]
Servo = Annotated[
    bool,
    typer.Option(
        "--servo",
        help="Servos follow commands, and the log has commands and positions instead of torques; ROBOT may be "
        "hobby-arm or stand-leg, and without PLAN the motion is random.",
    ),
]


def simulate(
    robot: RobotName,
    plan: PlannedMotion = None,
    options: OptionsFile = None,
    servo: Servo = False,
    mode: Mode = None,
    controller: ControllerKind = None,
    effects: Effects = None,
    repetitions: Annotated[int | None, typer.Option(min=1, help="Number of repetitions of the motion.")] = None,
    period: SimulatedPeriod = None,
    seconds: Annotated[float, typer.Option(help="Duration of a random motion, s.")] = 30.0,
    rate: Annotated[float | None, typer.Option(help="Sampling rate of the log, up to 8000 Hz.")] = None,
    seed: Annotated[int, typer.Option(help="Seed of noise, faults and random motion.")] = 1,
    kind: RecordingFormat = "csv",
    noise_free: Annotated[bool, typer.Option("--noise-free", help="Also write the noise-free data, as NPZ.")] = False,
    gravity: Gravity = None,
    lock: Lock = None,
    only: Only = None,
    tip: TipLink = None,
    package: Package = None,
    out: Out = None,
    json: Json = False,
) -> None:
    """Simulate an arm in MuJoCo under a controller, and write the recording and the true parameters.

    Examples:
        armid simulate iiwa14-r820 thesis-a1 --gravity 0 0 9.81 --rate 1000 --out lab

        armid simulate ur10e.urdf plan.json --effects rotor,elastic,stribeck --options lab.toml

        armid simulate hobby-arm --servo --seconds 60 --out lab
    """
    from armid.cli.servos.servo_simulation import ServoSimulationRequest, refuse_controller, simulate_servos

    choice = robot_choice(robot, gravity, lock, only, tip, package)
    if servo:
        refuse_controller(mode, controller)
        given = (plan, options, effects, repetitions, period, rate, seconds, seed, kind, noise_free)
        simulate_servos(ServoSimulationRequest(*given), choice, out, json=json)
        return
    changes = options, mode, controller, effects, repetitions, rate
    named = _planned(plan)
    _simulate(choice, named, period, kind, changes, out, seed=seed, noise_free=noise_free, json=json)


def _planned(plan: str | None) -> str:
    """Name of the plan, which a controlled arm needs."""
    from armid.errors import LabError

    if plan is None:
        raise LabError(
            "The argument PLAN is missing.",
            possible="a plan.json of armid excite, thesis-a1, thesis-a2",
            remedy="give a plan; only arms with servos (--servo) have a random motion without it.",
        )
    return plan


def _simulate(
    choice: RobotChoice,
    plan: str,
    period: float | None,
    kind: str,
    changes: tuple[Any, ...],
    out: Path | None,
    *,
    seed: int,
    noise_free: bool,
    json: bool,
) -> None:
    """Simulate an arm under a controller, and write and print the result."""
    from armid.cli.console import print_findings, progress
    from armid.lab.simulation import simulation_findings
    from armid.output.locks import claim
    from armid.study.config import load_choice
    from armid.study.plans.simulation_files import refuse_format, simulate_to, the_plan

    refuse_format(kind)
    arm = load_choice(choice)
    lab_options = _lab_options(*changes)
    motion = the_plan(plan, period)
    with progress(quiet=json) as tell:
        claim(folder := out or run_folder(None, f"{arm.name}-lab"))
        write = partial(simulate_to, kind=kind, seed=seed, noise_free=noise_free)
        done = write(folder, arm, motion, lab_options, tell=lambda share: tell("simulation", share))
    _report(done, json=json)
    print_findings((*arm.findings, *simulation_findings(done.simulated)))


def _lab_options(
    path: Path | None,
    mode: str | None,
    controller: str | None,
    effects: str | None,
    repetitions: int | None,
    rate: float | None,
) -> LabOptions:
    """Options of the simulation: those of the file, changed by those of the command line."""
    from dataclasses import replace

    from armid.lab.options import LabOptions, load_options

    from_file = LabOptions() if path is None else load_options(path)
    changes: dict[str, Any] = {"mode": mode, "repetitions": repetitions}
    if controller is not None:
        changes["controller"] = replace(from_file.controller, kind=controller)
    if effects is not None:
        names = tuple(name.strip() for name in effects.split(",") if name.strip())
        changes["arm"] = replace(from_file.arm, effects=names)
    if rate is not None:
        changes["sensing"] = replace(from_file.sensing, rate=rate)
    return replace(from_file, **{key: value for key, value in changes.items() if value is not None})


def _report(done: WrittenSimulation, *, json: bool) -> None:
    """Print the written files, the number of rows and the peak torques."""
    import numpy as np

    from armid.notebook_display import plural
    from armid.study.storage.records import to_json

    recording, truth = done.simulated.recording, done.simulated.truth
    peak = np.abs(done.simulated.trace.effort).max(axis=0)
    if json:
        record = {
            "recording": str(done.recording),
            "truth": str(done.truth),
            "noise_free": None if done.noise_free is None else str(done.noise_free),
            "samples": recording.samples,
            "rate": done.simulated.options.sensing.rate,
            "joints": truth.robot.joint_names,
            "peak_effort": peak,
        }
        sys.stdout.write(to_json(record) + "\n")
        return
    units = dict.fromkeys(joint.effort_unit for joint in truth.robot.joints)
    peaks = ", ".join(f"{x:.1f}" for x in peak)
    if len(units) > 1:
        peaks = ", ".join(f"{x:.1f} {joint.effort_unit}" for x, joint in zip(peak, truth.robot.joints, strict=True))
    told = peaks if len(units) > 1 else f"{peaks} {next(iter(units), '')}"
    written = [done.recording, done.truth, *([done.noise_free] if done.noise_free else [])]
    sys.stdout.write(
        f"{plural(recording.samples, 'row')} of {plural(truth.robot.n, 'joint')}; peak torque "
        f"{told}\nwritten: {', '.join(map(str, written))}\n"
    )
