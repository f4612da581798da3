"""Payload of an identified arm, and drive gains from a known payload."""

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

FAR = 3.0
"""Distance of the estimate from the nearest real body, in standard deviations, from which it is reported."""

NOTHING = 1e-5
"""Lower end of the mass interval up to which the data allow no payload [kg]; consistency requires a positive mass."""

INERTIA = ("xx", "xy", "yy", "xz", "yz", "zz")
"""Entries of an inertia in parameter order."""

PRINTED = (0, 1, 2, 3, 4, 5, 7, 6, 8, 9)
"""Usual order of the payload's parameters: XX XY XZ YY YZ ZZ."""


@dataclass(frozen=True, eq=False, slots=True)
class Payload:
    """Estimated payload.

    Attributes:
        new_recordings: The recordings and the run.
        link: Name of the link that carries the payload.
        frame: Name of the frame of the payload's parameters, the tip.
        load: The payload.
        in_link: The same ten parameters in the frame of the link, shape (10,).
        known: Flags of the parameters that were given, shape (10,).
        gains: Corrections of the drive gains, where the payload was known.
        findings: Findings of recordings and estimate.
    """

    new_recordings: NewRecordings
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
    """Estimates the payload of recordings, or with a known mass the drive gains.

    The loaded recordings have their own friction and offsets by default. These change with temperature and load, and
    the change would otherwise be attributed to the payload.

    Args:
        run: Run of the arm without the payload.
        paths: Recordings with the payload.
        reading: Fields of the log format that differ from that of the run's first recording.
        mass: Known mass [kg]; the drive gains are then unknowns.
        com: Known centre of mass in the tip frame [m].
        gain_deviation: Relative standard deviation of the drive gains, in the place of the run's.
        same_friction: Whether the loaded recordings have the friction of the run.

    Raises:
        ArmidError: The recordings do not fit the run, or do not determine the payload.
    """
    known = _known(run, mass, com)
    link, _ = link_columns(run)
    added, to_link = load_columns(run)
    new_recordings = load_new_recordings(run, paths, reading, gain_deviation=gain_deviation)
    own = new_recordings.changing & (not same_friction)
    joined = stack_problems(
        new_recordings.earlier, run.estimate.fit, new_recordings.new, own, added, new_recordings.samples
    )
    if known is None:
        load, gains = estimate_payload(joined), None
    else:
        deviation = new_recordings.new.scale_deviation
        load, gains = estimate_gains(joined, known, np.where(deviation > 0.0, deviation, np.inf))
    findings = (*new_recordings.findings, *_payload_findings(new_recordings, load, gains))
    name = run.robot.links[link].name
    given = np.zeros(10, dtype=np.bool_) if known is None else ~np.isnan(known)
    return Payload(new_recordings, name, run.robot.tip.name, load, to_link @ load.values, given, gains, findings)


def _known(run: Run, mass: float | None, com: tuple[float, float, float] | None) -> Array | None:
    """Known parameters of the payload (10,), NaN where unknown; `None` if all are unknown."""
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


def _payload_findings(
    new_recordings: NewRecordings, load: PayloadEstimate, gains: DriveGains | None
) -> list[Finding]:
    """Findings that question the result."""
    found: list[Finding] = []
    unclear = [f"{LOAD_NAMES[k]} ({load.status[k]})" for k in PRINTED if load.status[k] != "identified"]
    if unclear:
        found.append(
            Finding(
                "load-weakly-excited",
                "warning",
                "",
                f"The recording does not determine {', '.join(unclear)}: their values follow from the "
                "others and from physical consistency.",
                "turn the load through wide angles, and quickly for its inertia.",
            )
        )
    if load.distance > FAR:
        found.append(
            Finding(
                "load-not-real",
                "warning",
                "",
                f"The nearest real body is {load.distance:.1f} standard deviations from the best fit to the torques.",
                "look for contact, for a load that was not on the arm all the time, or for other drive gains.",
            )
        )
    if gains is None and load.intervals[0, 0] <= NOTHING:
        found.append(
            Finding("load-missing", "warning", "", "The load's mass cannot be told from zero.", "is it on the arm?")
        )
    if gains is not None and not gains.determined.all():
        names = ", ".join(new_recordings.run.robot.joint_names[j] for j in np.flatnonzero(~gains.determined))
        found.append(
            Finding("gain-unseen", "warning", names, "Nothing determines the drive gain.", "move the joint.")
        )
    exact = new_recordings.run.reading.drive_gain is not None and not new_recordings.new.scale_deviation.any()
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
    few = few_blocks_finding(load.solution.fit)
    return found if few is None else [*found, few]


def payload_record(payload: Payload) -> dict[str, Any]:
    """The contents of `payload.json`."""
    load, run = payload.load, payload.new_recordings.run
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
        "distance_to_real": load.distance,
        "gains": None if payload.gains is None else _gains_record(payload),
        "residual": {"rms": load.solution.fit.residual_rms},
        "covariance": {"kind": load.solution.fit.covariance_kind, "why": load.solution.fit.report.why},
        "recordings": [
            {"path": each.choice.path, "sha256": each.recording.sha256} for each in payload.new_recordings.recordings
        ],
        "warnings": [finding_record(finding) for finding in payload.findings],
    }


def _gains_record(payload: Payload) -> list[dict[str, Any]]:
    """Given and estimated drive gain of each joint."""
    gains, reading = payload.gains, payload.new_recordings.run.reading
    assert gains is not None and reading.drive_gain is not None  # as `find_payload` made sure
    names = payload.new_recordings.run.robot.joint_names
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
