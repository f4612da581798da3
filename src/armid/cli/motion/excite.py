"""`armid excite`: design of the motion to record."""

from __future__ import annotations

import inspect
import math
import sys
from collections.abc import Generator
from contextlib import contextmanager, nullcontext
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from armid.cli.commands.report import try_page
from armid.cli.last_handler import INTERRUPTED, Terminated
from armid.cli.motion.preview import PAGE as PREVIEW
from armid.cli.options import (
    Gravity,
    Json,
    Lock,
    Only,
    Out,
    Package,
    RobotName,
    Terms,
    TipLink,
    robot_choice,
    run_folder,
)
from armid.cli.value_completion import CRITERIA, among, limits

if TYPE_CHECKING:
    from concurrent.futures import Executor

    from armid.excitation.design.multistart import Progress, SearchCandidate
    from armid.study.plans.certified_plan import Stage
    from armid.study.plans.preflight_text import Checked


def _option(
    kind: Any, default: Any, help: str, *names: str, metavar: str | None = None, complete: Any = None
) -> tuple[Any, Any]:
    """Annotation and default value of an option, for the table `OPTIONS`."""
    return Annotated[kind, typer.Option(*names, help=help, metavar=metavar, autocompletion=complete)], default


PREFLIGHT = "preflight.html"

POSE, SEVERAL = "Q…", list[str] | None

OPTIONS: dict[str, tuple[Any, Any]] = {
    "gravity": (Gravity, None),
    "lock": (Lock, None),
    "only": (Only, None),
    "tip": (TipLink, None),
    "package": (Package, None),
    "terms": (Terms, None),
    "servo": _option(bool, False, "Commands for an arm with position servos, whose logs have no torque.", "--servo"),
    "stiffness": _option(str | None, None, "With --servo: known stiffness of the servos, N·m/rad.", metavar="K[,K…]"),
    "damping": _option(str | None, None, "With --servo: known damping of the servos, N·m·s/rad.", metavar="D[,D…]"),
    "experiment": _option(
        str, "series", "series: the Fourier series; poses: static poses for gravity; sweeps: constant velocities, "
        "one joint at a time, for friction."
    ),
    "poses": _option(int, 30, "Number of static poses."),
    "rest": _option(float, 2.0, "Time at rest in each static pose, s."),
    "criterion": _option(
        str | None,
        None,
        "d-optimal, condition, scaled-condition, a-optimal, e-optimal, prediction (--predict), or worst: the "
        "largest standard deviation of a parameter, with --after RUN divided by its value. By default worst "
        "after a run, otherwise d-optimal.",
        metavar="NAME",
        complete=among(CRITERIA),
    ),
    "duration": _option(float, 20.0, "Length of a period, s."),
    "harmonics": _option(int, 10, "Number of harmonics."),
    "start": _option(str | None, None,
        "Start pose, rad or m: one number for each joint; chosen by armid if left out.",
        metavar=POSE),
    "free_start": _option(bool, False, "Let the search choose the start pose.", "--free-start"),
    "free_centre": _option(bool, False,
        "Let joints oscillate about a pose other than the start pose.", "--free-centre"),
    "begin": _option(str | None, None,
        "Pose before the motion, rad or m; adds a move to the start pose.", metavar=POSE),
    "end": _option(str | None, None,
        "Pose after the motion, rad or m; adds a move from the start pose.", metavar=POSE),
    "limits": _option(
        str, "true", "true: limits on position, velocity and, if known, torque of the motion; thesis: equations "
            "(3.55d-f) of the thesis without the factor 1/L; thesis-literal: these equations as printed."
    ),
    "limit": _option(
        SEVERAL, None, "Limits: A1.velocity=1.2, A1.position=-1:1, '*.effort=80' (of all joints), …; repeatable.",
        metavar="JOINT.KIND=VALUE", complete=limits,
    ),
    "acceleration": _option(float | None, None, "Acceleration limit of every joint, rad/s² or m/s²."),
    "jerk": _option(float | None, None, "Jerk limit of every joint, rad/s³ or m/s³."),
    "torque_margin": _option(float | None, None,
        "Share of the torque limits that must stay unused; by default 0.1 with --limits true."),
    "collision": _option(
        bool | None, None, "Check distances between links and to the surroundings; by default on if the description "
        "has shapes.", "--collision/--no-collision",
    ),
    "clearance": _option(float, 0.02, "Required distance between bodies, m."),
    "ignore_pair": _option(
        SEVERAL, None, "Two links or bodies whose distance is not checked, also patterns; repeatable.", metavar="A,B"
    ),
    "srdf": _option(Path | None, None, "SRDF file whose disabled pairs of links are not checked."),
    "floor": _option(
        float | None, None, "Height of a floor above the base, m. By default the plane through "
        "the base, if the arm stands on it."
    ),
    "no_floor": _option(bool, False, "Assume no floor.", "--no-floor"),
    "environment": _option(Path | None, None, "TOML of boxes, spheres and half-spaces; implies --collision."),
    "tip_box": _option(
        str | None, None, "Box in which the tip must stay, m: lower and upper corner.", metavar="X,Y,Z,X,Y,Z"
    ),
    "envelope": _option(
        str | None, None, "Recording or plan whose velocities and accelerations are limits; "
        "thesis-a1@27: the plan with a period of 27 s.",
        metavar="MOTION",
    ),
    "envelope_of_arm": _option(
        bool, False, "Use the highest velocity and acceleration of any joint as the envelope of all joints.",
        "--envelope-of-arm"
    ),
    "noise": _option(str | None, None,
        "Standard deviation of the torque noise, N·m or N: one number, or one for each joint; by "
        "default that of the run given with --after, otherwise 1.", metavar="S…"),
    "rate": _option(float, 100.0, "Number of samples in one second that count as independent, Hz."),
    "repetitions": _option(int, 1, "Number of periods that will be recorded."),
    "after": _option(SEVERAL, None, "Run or plan.json with information that the new motion completes; repeatable. "
        "The design has the terms of the last run, unless --terms is given."),
    "predict": _option(SEVERAL, None, "Plan for which the model must predict the torque well; repeatable."),
    "budget": _option(float, 30.0, "Wall time of the search, s."),
    "seed": _option(int, 1, "Seed of the random starts; the same seed gives the same search."),
    "workers": _option(int, 2, "Number of processes; 0 searches in the main process."),
    "formats": _option(SEVERAL, None, "csv, ros2, fri, urscript, mat; repeatable, all by default.", "--format"),
    "format_rate": _option(float | None, None, "Sampling rate of the written motions, Hz."),
    "rehearsal": _option(float, 0.2, "Relative speed of the rehearsal written with each motion, 0.1 to 0.25."),
    "no_report": _option(bool, False, "Do not write preflight.html and preview.html.", "--no-report"),
    "out": (Out, None),
    "json": (Json, False),
}  # fmt: skip
"""Annotation and default value of each option, by name. The signature of the command is made from this table."""


STEPS = {
    "start pose": "start pose: choose the start pose and read the meshes, usually some seconds",
    "search": "search: the best motion within {budget:g} s (--budget)",
    "certificate of the limits": "limits: certify the limits between the points of the grid, usually some seconds",
    "closest approaches": "bodies: measure the distance of each pair, usually some seconds",
    "poses": "poses: choose {poses} poses and the paths between them, usually some seconds",
    "sweeps": "sweeps: find the range in which each joint moves without collision, usually some seconds",
    "files": "files: write the motions",
    "preview": "preview: draw the arm",
}
"""Text that is printed at the beginning of each stage of a design if standard error is not a terminal."""


@contextmanager
def _search_context(options: dict[str, Any]) -> Generator[tuple[Executor | None, Progress, Stage]]:
    """Process pool for the search, and callbacks that print the best value and the stage on standard error.

    If standard error is not a terminal, one line of `STEPS` is printed at the beginning of each stage.

    The pool is made first, because forking of processes is fast, but possible only before other threads run.
    """
    from armid.cli.console import print_missing_meshes, progress
    from armid.excitation.design.multistart import single_threaded_pool
    from armid.notebook_display import plural

    workers = options["workers"] if options["experiment"] == "series" else 0
    budget = max(float(options["budget"]), 1e-3)
    criterion = options["criterion"] or "criterion"
    with (
        single_threaded_pool(workers) if workers > 0 else nullcontext() as pool,
        progress(quiet=options["json"]) as tell,
        print_missing_meshes(quiet=options["json"]),
    ):
        share = 0.0

        def report(best: SearchCandidate, seconds: float, descents: int) -> None:
            value = math.exp(best.value) if "condition" in criterion else best.value
            nonlocal share
            share = min(seconds / budget, 1.0)
            tell(f"{criterion} {value:.4g}, {plural(descents, 'descent')}", share)

        begun = set[str]()

        def report_stage(name: str) -> None:
            tell(name, share)
            if not (options["json"] or sys.stderr.isatty() or name in begun):
                begun.add(name)
                print(STEPS[name].format_map(options), file=sys.stderr, flush=True)

        yield pool, report, report_stage


def excite(robot: str, **options: Any) -> None:
    """Design the motion to record: the most informative motion within all limits.

    The command writes plan.json, the motion in the formats of controllers, each with a slow rehearsal, and a report
    of all margins, which should be read before the arm moves. Separate the numbers of a pose by commas or blanks.

    Examples:
        armid excite iiwa14-r820 --gravity 0 0 9.81 --floor -1.5 --budget 20

        armid excite iiwa14-r820 --gravity 0 0 9.81 --criterion condition --limits thesis --budget 10

        armid excite arm.urdf --limit elbow.velocity=1.5 --acceleration 5 --floor 0

        armid excite panda --after runs/monday --duration 10
    """
    from armid.cli.console import output_console, print_findings
    from armid.cli.motion.excite_goal import design_model
    from armid.cli.motion.excite_request import run_experiment, run_request
    from armid.cli.servos.servo_excitation import excite_servos
    from armid.study.config import load_choice
    from armid.study.plans.design_writing import choose_formats, plan_record, refuse_plan_folder, save_design
    from armid.study.plans.preflight_text import report_text
    from armid.study.storage.records import to_json

    formats = choose_formats(options["formats"])
    arm = load_choice(robot_choice(robot, *(options[key] for key in ("gravity", "lock", "only", "tip", "package"))))
    run_default = run_folder(None, arm.name)
    folder = options["out"] or run_default.with_name(f"{run_default.name}-plan")
    if options["servo"]:
        return excite_servos(arm, folder, options, {name: usual for name, (_, usual) in OPTIONS.items()})
    refuse_plan_folder(folder)
    model = design_model(arm, options)
    rate, rehearsal = options["format_rate"], options["rehearsal"]
    with _search_context(options) as (pool, tell, stage):
        if options["experiment"] in STEPS:
            stage(options["experiment"])
        designed = (
            run_request(model, options, executor=pool, progress=tell, stage=stage)
            if options["experiment"] == "series" else run_experiment(model, options)
        )  # fmt: skip
        stage("files")
        stopped: list[Stopped] = []
        pages = None if options["no_report"] else partial(_write_pages, designed, stage, stopped)
        save_design(designed, folder, formats=formats, rate=rate, rehearsal=rehearsal, pages=pages)
    for page, reason in stopped:
        if not isinstance(reason, KeyboardInterrupt):
            raise reason
        sys.stderr.write(f"interrupted; the plan in {folder} is complete, but {page} was not written\n")
        raise typer.Exit(INTERRUPTED)
    if options["json"]:
        sys.stdout.write(to_json({**plan_record(designed), "folder": str(folder)}) + "\n")
    else:
        sys.stdout.write(report_text(designed, findings=False))
        output_console().print(f"written to [bold]{folder}[/]")
    print_findings((*arm.findings, *designed.findings), shapes=True)
    if designed.preflight.verdict == "fail":
        sys.stderr.write(f"verdict: fail. {designed.preflight.sentence}; no motion was written for a controller\n")
        raise typer.Exit(1)


Stopped = tuple[str, BaseException]
"""Name of a page that was not written, and the exception by which the user stopped it."""


def _write_pages(designed: Checked, stage: Stage, stopped: list[Stopped], folder: Path) -> None:
    """Write preflight.html and preview.html into the folder of a plan, which is complete without these pages.

    If the user stops the writing, this is added to `stopped`, so that the plan is kept.
    """
    from armid.report.preflight_page import write_preflight
    from armid.report.preview.make_preview import preview_of_design
    from armid.report.preview.page import write_preview

    page = PREFLIGHT
    try:
        try_page(page, lambda: write_preflight(designed, folder / PREFLIGHT))
        stage("preview")
        page = PREVIEW
        try_page(page, lambda: write_preview(preview_of_design(designed), folder / PREVIEW))
    except (KeyboardInterrupt, Terminated) as reason:
        stopped.append((page, reason))


def _signature() -> inspect.Signature:
    """Signature of `excite` for the parser, made from `OPTIONS`."""
    robot = RobotName
    kind = inspect.Parameter.KEYWORD_ONLY
    parameters = [inspect.Parameter("robot", inspect.Parameter.POSITIONAL_OR_KEYWORD, annotation=robot)]
    parameters += [inspect.Parameter(name, kind, default=d, annotation=a) for name, (a, d) in OPTIONS.items()]
    return inspect.Signature(parameters)


excite.__signature__ = _signature()  # pyright: ignore[reportFunctionMemberAccess]
excite.__annotations__ = {p.name: p.annotation for p in _signature().parameters.values()}
