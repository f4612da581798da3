"""Identification of a fleet: units are processed one by one or by an executor, and merged in one place."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable, Mapping
from concurrent.futures import BrokenExecutor, Executor, Future
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from typing import TypeVar

import numpy as np

from armid.errors import ArmidError, Finding, StudyError
from armid.estimation.fleet.fleet_estimate import FleetEstimate, estimate_fleet
from armid.estimation.fleet.layout import fleet_layout
from armid.estimation.fleet.unit_update import FleetPrior
from armid.estimation.friction_per_recording import changing_parameters
from armid.information.information import Information
from armid.measurement.recording import Recording
from armid.model.base_parameters import BaseParameters
from armid.robot import Robot
from armid.study.config import Study
from armid.study.fleet.fleet_file import FleetChoice
from armid.study.fleet.fleet_findings import fleet_findings
from armid.study.fleet.unit_result import concluded_unit
from armid.study.identify import Result
from armid.study.prepare import Prepared, prepare
from armid.study.progress import Progress, no_progress

A = TypeVar("A")
B = TypeVar("B")


@dataclass(frozen=True, eq=False, slots=True)
class FleetIdentification:
    """Result of the identification of a fleet.

    Attributes:
        robot: The type of arm.
        base: Base parameters.
        estimate: Estimate of the fleet.
        results: Result of each unit, in the order of the fleet file.
        findings: Findings about units and fleet.
    """

    robot: Robot
    base: BaseParameters
    estimate: FleetEstimate
    results: tuple[Result, ...]
    findings: tuple[Finding, ...]


def identify_fleet(
    fleet: FleetChoice,
    *,
    given: Mapping[str, Recording] | None = None,
    executor: Executor | None = None,
    progress: Progress | None = None,
) -> FleetIdentification:
    """Identifies a fleet.

    Each unit is prepared as a study of its own. The estimate of the fleet uses the triangular factors of the units
    only. Then each unit is estimated from its own samples, with the other units as prior. Results do not depend on
    executor, number of workers or order of completion.

    Args:
        fleet: The fleet.
        given: Recordings that are in memory already, by their path in the fleet file.
        executor: Executor on which the units are processed; one after the other in this process if not given.
        progress: Function that is called with the name of each stage and the share of the stage that is done.

    Raises:
        ArmidError: An input is wrong; the message names the unit and the fault.
    """
    tell = progress or no_progress
    studies = {unit.name: unit.study for unit in fleet.units}
    prepared = _prepared(studies, given, executor, tell)
    _refuse_shared_recordings(prepared)
    first = next(iter(prepared.values()))
    own = changing_parameters(first.model)[first.base.kept]
    tell("fleet", 0.0)
    information: dict[str, Information] = {name: each.problem.information for name, each in prepared.items()}
    found = estimate_fleet(information, own)
    tasks = [(prepared[name], found.priors[name], name) for name in studies]
    results = _mapped(_concluded, tasks, executor, partial(tell, "units"))
    fits = [result.estimate.fit for result in results]
    # The intervals of the units contain systematic errors and the spectrum of the noise; those of the merge do not.
    estimate = replace(
        found.estimate,
        values=np.array([fit.values for fit in fits]),
        deviation=np.array([fit.deviation for fit in fits]),
    )
    findings = fleet_findings(estimate, first.model.robot)
    return FleetIdentification(first.model.robot, first.base, estimate, tuple(results), findings)


def _prepared(
    studies: Mapping[str, Study], given: Mapping[str, Recording] | None, executor: Executor | None, tell: Progress
) -> dict[str, Prepared]:
    """Prepares all units with the same torque terms.

    The doctor adds rotor inertia to a unit whose recordings show that the description lacks it. If it did so for some
    units, the others are prepared again with the terms of these units.
    """
    tasks = [(study, given, name) for name, study in studies.items()]
    prepared = dict(zip(studies, _mapped(_prepare, tasks, executor, partial(tell, "recordings")), strict=True))
    fullest = max(prepared.values(), key=lambda each: len(each.study.model.terms))
    other = [name for name, each in prepared.items() if each.study.model.terms != fullest.study.model.terms]
    again = [(replace(studies[name], model=fullest.study.model), given, name) for name in other]
    prepared |= dict(zip(other, _mapped(_prepare, again, executor, partial(tell, "recordings")), strict=True))
    return prepared


def _refuse_shared_recordings(prepared: Mapping[str, Prepared]) -> None:
    """Raises an error if a recording belongs to two units.

    Raises:
        StudyError: Two units have the same recording.
    """
    owner: dict[str, str] = {}
    for name, unit in prepared.items():
        for each in unit.recordings:
            other = owner.setdefault(each.recording.sha256, name)
            if each.recording.sha256 and other != name:  # arrays in memory have no digest
                raise StudyError(
                    f"The units {other} and {name} have the same recording: {each.choice.path} (sha256 "
                    f"{each.recording.sha256[:12]}…).",
                    remedy="give each unit its own recordings.",
                )


def _prepare(task: tuple[Study, Mapping[str, Recording] | None, str]) -> Prepared:
    """Prepares one unit."""
    study, given, name = task
    with _named(name):
        return prepare(study, given=given)


def _concluded(task: tuple[Prepared, FleetPrior, str]) -> Result:
    """Estimates one unit with the other units as prior."""
    prepared, prior, name = task
    with _named(name):
        layout = fleet_layout(prepared.problem.information, np.isin(prior.names, prior.own))
        return concluded_unit(prepared, prior, layout)[1]


@contextmanager
def _named(name: str) -> Generator[None]:
    """Context in which an error names the unit."""
    try:
        yield
    except ArmidError as error:
        raise StudyError(f"unit {name}: {error.problem}", possible=error.possible, remedy=error.remedy) from error


def _mapped(
    function: Callable[[A], B], tasks: Iterable[A], executor: Executor | None, tell: Callable[[float], None]
) -> list[B]:
    """Applies a function to all tasks, in the order of the tasks.

    If a worker process was killed, a pool of processes is lost; the tasks that are left are then run in this process.
    """
    tasks = list(tasks)
    futures = [None if executor is None else _submitted(executor, function, task) for task in tasks]
    results: list[B] = []
    try:
        for future, task in zip(futures, tasks, strict=True):
            try:
                results.append(function(task) if future is None else future.result())
            except BrokenExecutor:
                results.append(function(task))
            tell(len(results) / len(tasks))
    finally:
        for future in futures[len(results) :]:
            if future is not None:
                future.cancel()
    return results


def _submitted(executor: Executor, function: Callable[[A], B], task: A) -> Future[B] | None:
    """Task of an executor; `None` if the executor has lost its processes."""
    try:
        return executor.submit(function, task)
    except BrokenExecutor:
        return None
