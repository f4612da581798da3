"""`armid certify`: check of physical consistency, of the mass matrix in all poses, and of bodies by their shapes."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from armid.cli.options import Gravity, Json, Lock, Only, Package, TipLink, robot_choice

if TYPE_CHECKING:
    from armid.checked_array import Array
    from armid.runs.consistency_check import Verdict
    from armid.validation.distance_to_consistency import Certificate
    from armid.validation.inertial_checks.findings import InertialCheck
    from armid.validation.thesis_constraints import Constraint

RULES = {
    "(3.52c)": ("mass", "kg", "since a mass is positive"),
    "(3.52d)": ("smallest principal moment of inertia", "kg·m²", "since a moment of inertia is positive"),
    "(3.53a)": ("sum of the two smaller moments of inertia", "kg·m²", "the largest moment"),
    "(3.53b)": ("100 times the smallest moment of inertia", "kg·m²", "the largest moment"),
    "(3.53c)": ("a tenth of the smallest moment of inertia", "kg·m²", "the largest product of inertia"),
    "(3.53d)": ("smallest moment of inertia", "kg·m²", "the usual minimum"),
    "(3.53e)": (
        "smaller moment of inertia about x or y",
        "kg·m²",
        "three times the moment of inertia about the long axis z",
    ),
    "(3.53f)": (
        "smaller moment of inertia about x or z",
        "kg·m²",
        "three times the moment of inertia about the long axis y",
    ),
}
"""Checked quantity, its unit, and a text about its lower bound; the keys are equation numbers of [Halper2024]."""


def certify(
    subject: Annotated[
        str,
        typer.Argument(metavar="RUN | ROBOT", help="A run; or an arm, whose description or VALUES.json is checked."),
    ],
    values: Annotated[
        str | None,
        typer.Argument(
            metavar="[VALUES.json]",
            help="JSON file {name: value} with base (ZZR_1), standard (ZZ_1) or physical parameters (m_1, rx_1, "
            "Ixx_1), and friction (FV_1, FS_1).",
        ),
    ] = None,
    motion: Annotated[str | None, typer.Option(metavar="PLAN", help="Check the mass matrix along it, too.")] = None,
    heaviest: Annotated[
        float | None,
        typer.Option(
            min=0.0,
            help="Largest mass of a link in the nearest consistent parameters, kg; by default 2.5 times the mass of "
            "the heaviest link of the description, and at least 10 if one of its links has no mass.",
        ),
    ] = None,
    gravity: Gravity = None,
    lock: Lock = None,
    only: Only = None,
    tip: TipLink = None,
    package: Package = None,
    json: Json = False,
) -> None:
    """Certify parameters: physical consistency, mass matrix in all poses, rules of thumb for each link.

    Without VALUES.json, each body of the description is compared with its shapes, to find wrong units and copies.

    Exit code 1: the parameters are not physically consistent, that is, no links with positive density can have them.

    Examples:
        armid certify runs/today

        armid certify arm.urdf

        armid certify iiwa14-r820 values.json --gravity 0 0 9.81 --motion thesis-a2
    """
    from armid.runs import consistency_check as stage
    from armid.runs.read_records import read_values
    from armid.runs.run import load_run
    from armid.study.config import load_choice
    from armid.validation.inertial_checks.findings import check_inertials

    along, shapes = None if motion is None else stage.read_plan(motion), None
    if values is None and Path(subject).is_dir():
        verdict = stage.certify_run(load_run(subject), motion=along, heaviest=heaviest)
    else:
        robot = load_choice(robot_choice(subject, gravity, lock, only, tip, package))
        named = stage.described_values(robot) if values is None else read_values(values)
        shapes = check_inertials(robot) if values is None else None
        verdict = stage.certify_named(robot, named, motion=along, heaviest=heaviest)
    _show(verdict, shapes, motion, as_json=json)
    if not verdict.certificate.feasible:
        raise typer.Exit(1)


def _show(verdict: Verdict, shapes: InertialCheck | None, motion: str | None, *, as_json: bool) -> None:
    """Print a verdict and, if there is one, the comparison of the bodies with their shapes."""
    from armid.runs.consistency_check import verdict_record
    from armid.study.storage.records import to_json
    from armid.validation.inertial_checks.findings import check_record

    if shapes is not None:
        verdict = replace(verdict, findings=(*verdict.findings, *shapes.findings))
    if as_json:
        shown = {} if shapes is None else {"shapes": check_record(shapes)}
        sys.stdout.write(to_json(verdict_record(verdict) | shown) + "\n")
    else:
        _report(verdict, motion, shapes)


def _report(verdict: Verdict, motion: str | None, shapes: InertialCheck | None = None) -> None:
    """Print the verdict on the parameters on standard output, and the findings on standard error."""
    from armid.cli.console import output_console, print_findings

    console, certificate = output_console(), verdict.certificate
    yes = "[bold green]physically consistent[/]: links with positive density can have these parameters"
    no = "[bold red]not physically consistent[/]: no links with positive density can have these parameters"
    console.print(f"{verdict.kind} parameters: {yes if certificate.feasible else no}")
    if not certificate.feasible:
        console.print(f"  {_change(certificate)}")
    several = "link masses (one of many sets with the same torques)" if verdict.kind == "base" else "link masses"
    console.print(f"  {several}, kg: {_list(certificate.masses)}")
    console.print(
        f"  with no link above {verdict.heaviest:.3g} kg (--heaviest; default: 2.5 times the heaviest link of the "
        f"description, at least 10 kg if a link of it has no mass): {_change(verdict.limited)}; link masses, kg: "
        f"{_list(verdict.limited.masses)}"
    )
    definite = "positive definite" if verdict.pose.min_eigenvalue > 0.0 else "not positive definite everywhere"
    console.print(
        f"mass matrix within the joint limits: {definite}; smallest eigenvalue {verdict.pose.min_eigenvalue:.5g} "
        f"{verdict.pose.unit} at q = {_list(verdict.pose.q)}"
    )
    if verdict.along is not None:
        console.print(
            f"  smallest eigenvalue along {motion}: {verdict.along.min_eigenvalue:.5g} {verdict.along.unit}"
        )
    _report_rules([each for each in verdict.constraints if not each.ok])
    if shapes is not None:
        console.print(_shapes(shapes))
    print_findings(verdict.findings)


def _shapes(check: InertialCheck) -> str:
    """Text with the number of bodies that were compared with their shapes, and the range of their densities."""
    if not check.measures:
        return "shapes: no body of the description could be compared with its shapes"
    densities = sorted(each.density for each in check.measures.values())
    named = [name for name in check.named if name in check.measures]
    found = f"{len(named)} {'does' if len(named) == 1 else 'do'} not agree" if named else "all agree"
    return (
        f"shapes: {len(check.measures)} of {check.bodies} bodies compared with the hull of their shapes; mass "
        f"divided by the volume of the hull: {densities[0]:.0f} to {densities[-1]:.0f} kg/m³; {found}"
    )


def _change(certificate: Certificate) -> str:
    """Text about the smallest change that makes the parameters physically consistent."""
    if certificate.feasible:
        return "physically consistent without a change"
    return (
        f"the smallest change that makes them consistent is {certificate.distance:.4g}, the root of the sum of "
        f"squares of all changes in SI units ({100 * certificate.relative_distance:.3g} % of all parameters, "
        f"{100 * certificate.inertial_distance:.3g} % of the inertial ones)"
    )


def _report_rules(broken: Sequence[Constraint]) -> None:
    """Print the constraints of the thesis that the links do not meet, each with its value and its bound."""
    from armid.cli.console import output_console

    console = output_console()
    if broken:
        console.print(
            "rules of thumb that are not met (they do not affect the verdict, because some real bodies do not meet "
            "them):"
        )
    for each in broken:
        value, unit, bound = RULES[each.constraint]
        note = "; met if the given values were rounded to three decimals" if each.rounding else ""
        console.print(
            f"  link {each.link}: {value} is {each.value:.4g} {unit}, less than its bound of {each.bound:.4g} "
            f"{unit}, {bound}; equation {each.constraint} of the thesis{note}"
        )


def _list(numbers: Array) -> str:
    return ", ".join(f"{x:.4g}" for x in numbers)
