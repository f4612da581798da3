"""Load or tool on a known arm, and drive gains from a load that is known."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from armid.errors import Finding, StudyError
from armid.estimation.update.payload import LOAD_NAMES, DriveGains, PayloadEstimate, estimate_gains, estimate_payload
from armid.estimation.update.stacked_problem import stack_problems
from armid.model.terms.rigid_body import rigid_body_units
from armid.runs.new_recordings import NewRecordings, link_columns, load_columns, load_new_recordings
from armid.runs.run import Run
from armid.study.plausibility import few_blocks_finding
from armid.study.records import finding_record
from armid.values import Array

__all__ = ["Payload", "find_payload", "payload_record"]

FAR = 3.0
"""Distance of the estimate from the nearest real body, in standard deviations, from which on the two disagree."""

NOTHING = 1e-5
"""Mass that the lower end of an interval has where the data allow none [kg]: the speck of dust of a real body."""

INERTIA = ("xx", "xy", "yy", "xz", "yz", "zz")
"""Entries of an inertia in parameter order."""

PRINTED = (0, 1, 2, 3, 4, 5, 7, 6, 8, 9)
"""The load's parameters as the field lists them: XX XY XZ YY YZ ZZ."""


@dataclass(frozen=True, eq=False, slots=True)
class Payload:
    """Load as a recording shows it.

    Attributes:
        beside: The recordings and the run.
        link: Name of the link that carries the load.
        frame: Name of the frame that the load is given in, the tip.
        load: The load.
        in_link: The same ten parameters in the frame of the link, shape (10,).
        known: Which of the load's parameters were given, shape (10,).
        gains: Corrections of the drive gains, where the load was known.
        findings: What was noticed on the way.
    """

    beside: NewRecordings
    link: str
    frame: str
    load: PayloadEstimate
    in_link: Array
    known: NDArray[np.bool_]
    gains: DriveGains | None
    findings: tuple[Finding, ...]


def find_payload(
    run: Run,
    paths: Sequence[str],
    reading: Mapping[str, Any],
    *,
    mass: float | None = None,
    com: tuple[float, float, float] | None = None,
    gain_deviation: float | None = None,
    same_friction: bool = False,
) -> Payload:
    """The load of recordings, or with a known mass the drive gains.

    Friction and offsets of the loaded recordings are their own unless said otherwise: they change with temperature
    and under load, and what does not fit would be taken for a load.

    Args:
        run: The arm as it was identified without the load.
        paths: Recordings with the load.
        reading: Fields of a reading that differ from how the run's first recording was read.
        mass: Known mass [kg]; the drive gains are then unknowns.
        com: Known centre of mass in the tip frame [m].
        gain_deviation: Relative standard deviation of the drive gains, in place of what the run says.
        same_friction: The loaded recordings have the friction of the run.

    Raises:
        ArmidError: Recordings that do not fit the run, or say nothing of the load.
    """
    known = _known(run, mass, com)
    link, _ = link_columns(run)
    added, to_link = load_columns(run)
    beside = load_new_recordings(run, paths, reading, gain_deviation=gain_deviation)
    own = beside.changing & (not same_friction)
    joined = stack_problems(beside.earlier, run.estimate.fit, beside.new, own, added, beside.samples)
    if known is None:
        load, gains = estimate_payload(joined), None
    else:
        deviation = beside.new.scale_deviation
        load, gains = estimate_gains(joined, known, np.where(deviation > 0.0, deviation, np.inf))
    findings = (*beside.findings, *_doubts(beside, load, gains))
    name = run.robot.links[link].name
    given = np.zeros(10, dtype=np.bool_) if known is None else ~np.isnan(known)
    return Payload(beside, name, run.robot.tip.name, load, to_link @ load.values, given, gains, findings)


def _known(run: Run, mass: float | None, com: tuple[float, float, float] | None) -> Array | None:
    """Return what is known of the load, NaN where nothing is; `None` where the load is all unknown."""
    if mass is None:
        if com is not None:
            raise StudyError("A centre of mass is given without a mass.", remedy="give --mass, too.")
        return None
    if not 0.0 < mass < np.inf or not np.isfinite(com or 0.0).all():
        raise StudyError(f"A known load has a mass above 0 and a finite centre of mass; found {mass:g} kg, {com}.")
    if run.reading.drive_gain is None:
        raise StudyError(
            f"The effort in {run.folder} is a torque and not a current: there are no drive gains to find.",
            possible="the load's own parameters, without --mass",
            remedy="to find gains, identify currents with drive_gain = […] in the study.",
        )
    known = np.full(10, np.nan)
    known[0] = mass
    if com is not None:
        known[1:4] = mass * np.asarray(com)
    return known


def _doubts(beside: NewRecordings, load: PayloadEstimate, gains: DriveGains | None) -> list[Finding]:
    """Return what speaks against taking the result at its word."""
    found: list[Finding] = []
    unclear = [f"{LOAD_NAMES[k]} ({load.status[k]})" for k in PRINTED if load.status[k] != "identified"]
    if unclear:
        found.append(
            Finding(
                "load-weakly-excited",
                "warning",
                "",
                f"The recording does not determine {', '.join(unclear)}: what is given for them follows from the "
                "others and from being a real body.",
                "turn the load through wide angles, and for its inertia quickly.",
            )
        )
    if load.moved > FAR:
        found.append(
            Finding(
                "load-not-real",
                "warning",
                "",
                f"The nearest real body is {load.moved:.1f} standard deviations from what the torques say.",
                "look for contact, for a load that was not on the arm all the time, or for other drive gains.",
            )
        )
    if gains is None and load.intervals[0, 0] <= NOTHING:
        found.append(
            Finding("load-missing", "warning", "", "The load's mass cannot be told from zero.", "is it on the arm?")
        )
    if gains is not None and not gains.determined.all():
        names = ", ".join(beside.run.robot.joint_names[j] for j in np.flatnonzero(~gains.determined))
        found.append(
            Finding("gain-unseen", "warning", names, "Nothing determines the drive gain.", "move the joint.")
        )
    exact = beside.run.reading.drive_gain is not None and not beside.new.scale_deviation.any()
    if gains is None and exact:
        found.append(
            Finding(
                "gain-deviation-missing",
                "warning",
                "",
                "The effort is a current times drive gains that are taken as exact; a load scales with them.",
                "give --gain-deviation 0.1 for gains from a data sheet, or the known mass with --mass.",
            )
        )
    few = few_blocks_finding(load.solved.fit)
    return found if few is None else [*found, few]


def payload_record(payload: Payload) -> dict[str, Any]:
    """The contents of `payload.json`."""
    load, run = payload.load, payload.beside.run
    units = rigid_body_units()
    parameters = [
        {
            "name": LOAD_NAMES[k],
            "value": load.values[k],
            "unit": units[k],
            "interval95": load.intervals[k],
            "statistical95": load.statistical[k],
            "status": load.status[k],
            "known": payload.known[k],
            "unconstrained": load.unconstrained[k],
            "in_link": payload.in_link[k],
        }
        for k in PRINTED
    ]
    return {
        "run": run.folder,
        "robot": run.robot.name,
        "link": payload.link,
        "frame": payload.frame,
        "parameters": parameters,
        "mass": {"value": load.values[0], "interval95": load.intervals[0], "statistical95": load.statistical[0]},
        "com": {"value": load.com, "interval95": load.com_intervals},
        "inertia_about_com": load.inertia_about_com,
        "inertia_about_com_interval95": dict(zip(INERTIA, load.inertia_intervals, strict=True)),
        "distance_to_real": load.moved,
        "gains": None if payload.gains is None else _gains_record(payload),
        "residual": {"rms": load.solved.fit.residual_rms},
        "covariance": {"kind": load.solved.fit.covariance_kind, "why": load.solved.fit.report.why},
        "recordings": [
            {"path": each.choice.path, "sha256": each.recording.sha256} for each in payload.beside.recordings
        ],
        "warnings": [finding_record(finding) for finding in payload.findings],
    }


def _gains_record(payload: Payload) -> list[dict[str, Any]]:
    """Each joint's drive gain as it was given, and what it is."""
    gains, reading = payload.gains, payload.beside.run.reading
    assert gains is not None and reading.drive_gain is not None  # as `find_payload` made sure
    names = payload.beside.run.robot.joint_names
    return [
        {
            "joint": name,
            "given": float(given),
            "correction": gains.correction[j] if gains.determined[j] else None,
            "interval95": gains.intervals[j] if gains.determined[j] else None,
            "gain": given * (1.0 + gains.correction[j]) if gains.determined[j] else None,
            "unit": "N·m/A",
        }
        for j, (name, given) in enumerate(zip(names, np.asarray(reading.drive_gain, dtype=np.float64), strict=True))
    ]
