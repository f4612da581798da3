"""`armid certify`: can these parameters belong to a real body?"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from armid.cli.options import Gravity, Json, Lock, Only, Package, TipLink, robot_choice

if TYPE_CHECKING:
    from armid.study.certify import Verdict
    from armid.values import Array

__all__ = ["certify"]


def certify(
    subject: Annotated[
        str, typer.Argument(metavar="RUN | ROBOT", help="A run, or an arm: its own bodies, or values that follow.")
    ],
    values: Annotated[
        str | None,
        typer.Argument(
            metavar="[VALUES.json]",
            help="{name: value} by base (ZZR_1), standard (ZZ_1) or physical names (m_1, rx_1, Ixx_1); FV_1, FS_1.",
        ),
    ] = None,
    motion: Annotated[str | None, typer.Option(metavar="PLAN", help="Look at the mass matrix along it too.")] = None,
    heaviest: Annotated[
        float | None,
        typer.Option(
            min=0.0,
            help="Largest mass of a link in the second answer, kg; 10, or twice the heaviest link where the "
            "description has heavier ones.",
        ),
    ] = None,
    gravity: Gravity = None,
    lock: Lock = None,
    only: Only = None,
    tip: TipLink = None,
    package: Package = None,
    json: Json = False,
) -> None:
    """Certify parameters: the nearest real body, the worst pose of the mass matrix, the thesis's constraints.

    Exit code 1 says that no real body has them.

    Examples:
        armid certify runs/today

        armid certify arm.urdf

        armid certify iiwa14-r820 values.json --gravity 0 0 9.81 --motion thesis-a2
    """
    from armid.study import certify as stage
    from armid.study.records import to_json
    from armid.study.run import load_run
    from armid.study.study import load_choice

    along = None if motion is None else stage.read_plan(motion)
    if values is None and Path(subject).is_dir():
        verdict = stage.certify_run(load_run(subject), motion=along, heaviest=heaviest)
    else:
        robot = load_choice(robot_choice(subject, gravity, lock, only, tip, package))
        named = stage.described_values(robot) if values is None else stage.read_values(values)
        verdict = stage.certify_named(robot, named, motion=along, heaviest=heaviest)
    if json:
        sys.stdout.write(to_json(stage.verdict_record(verdict)) + "\n")
    else:
        _report(verdict, motion)
    if not verdict.certificate.feasible:
        raise typer.Exit(1)


def _report(verdict: Verdict, motion: str | None) -> None:
    """The verdict on standard output, what it means on standard error."""
    from armid.cli.console import output_console, print_findings

    console, certificate = output_console(), verdict.certificate
    word = "[bold green]feasible[/]" if certificate.feasible else "[bold red]infeasible[/]"
    console.print(
        f"{verdict.kind} parameters: {word}, distance {certificate.distance:.4g} "
        f"({100 * certificate.relative_distance:.3g} % of all values, {100 * certificate.inertial_distance:.3g} % of "
        "those of bodies)"
    )
    console.print(f"  masses of the nearest body in kg: {_list(certificate.masses)}")
    console.print(
        f"  with every mass at most {verdict.heaviest:g} kg: distance {verdict.limited.distance:.4g}, masses "
        f"{_list(verdict.limited.masses)}"
    )
    console.print(
        f"mass matrix, worst pose in the joint limits: {verdict.pose.min_eigenvalue:.5g} {verdict.pose.unit}"
    )
    console.print(f"  at q = {_list(verdict.pose.q)}")
    if verdict.along is not None:
        console.print(f"  along {motion}: {verdict.along.min_eigenvalue:.5g} {verdict.along.unit}")
    for each in verdict.constraints:
        if not each.ok:
            note = " (within rounding)" if each.rounding else ""
            console.print(f"  {each.constraint} link {each.link}: {each.value:.4g} against {each.bound:.4g}{note}")
    print_findings(verdict.findings)


def _list(numbers: Array) -> str:
    return ", ".join(f"{x:.4g}" for x in numbers)
