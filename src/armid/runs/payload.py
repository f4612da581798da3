"""Estimation of the payload of an identified arm, or of drive gains from a known payload."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.errors import EstimationError, Finding, StudyError
from armid.estimation.update.payload import LOAD_NAMES, DriveGains, PayloadEstimate, estimate_gains, estimate_payload
from armid.estimation.update.payload_misfit import PayloadMisfit
from armid.estimation.update.stacked_problem import stack_problems
from armid.model.terms.rigid_body import rigid_body_units
from armid.runs.new_recordings import NewRecordings, load_new_recordings
from armid.runs.payload_link import PayloadLink, fit_finding, payload_link
from armid.runs.run import Run, only_drive_gains_failed
from armid.study.diagnosis import diagnosed_error
from armid.study.plausibility.estimate_findings import few_blocks_finding
from armid.study.plausibility.recording_errors import contradictions
from armid.study.storage.records import judgement_record
from armid.validation.torque_validation import Check

FAR = 3.0
"""Distance of the estimated payload from the nearest real body above which a finding is reported [standard
deviations]."""

FAR_GAIN = 4.0
"""Correction of a drive gain, divided by the stated standard deviation, above which a finding is reported. In a test
with 15 logs of a simulated arm of six joints, whose gains were random with the stated deviation, the largest
correction was above 3 in two logs, and above 4 in none."""

NOTHING = 1e-5
"""Largest lower end of the interval of a mass at which the mass counts as zero [kg]. It is above zero, because a
physically consistent estimate always has a positive mass."""

INERTIA = ("xx", "xy", "yy", "xz", "yz", "zz")
"""Elements of an inertia matrix, in the order in which armid stores the parameters of a body."""

PRINTED = (0, 1, 2, 3, 4, 5, 7, 6, 8, 9)
"""Indices that put the parameters of a payload in the usual order XX XY XZ YY YZ ZZ."""


@dataclass(frozen=True, eq=False, slots=True)
class Payload:
    """Estimated payload, or drive gains estimated from a known payload.

    Attributes:
        new_recordings: New recordings and the run.
        place: Link that carries the payload, and frame of its parameters.
        load: Parameters of the payload, with intervals.
        misfit: Residuals of the recordings with the payload, compared with the residuals of a fit of these recordings
            alone.
        known: Mask of the parameters of the payload that were given, shape (10,).
        gains: Corrections of the drive gains; `None` if the mass of the payload was not given.
        findings: Findings of recordings and estimate.
    """

    new_recordings: NewRecordings
    place: PayloadLink
    load: PayloadEstimate
    misfit: PayloadMisfit
    known: NDArray[np.bool_]
    gains: DriveGains | None
    findings: tuple[Finding, ...]

    @property
    def in_link(self) -> Array:
        """The ten parameters of the payload in the frame of the link that carries it, shape (10,)."""
        return self.place.to_link @ self.load.values

    @property
    def contradictions(self) -> tuple[Check, ...]:
        """Failed checks for faults of the recordings that make the result wrong."""
        return contradictions(self.findings)


def find_payload(
    run: Run,
    paths: Sequence[str],
    reading: Mapping[str, Any],
    *,
    mass: float | None = None,
    com: tuple[float, float, float] | None = None,
    gain_deviation: float | None = None,
    same_friction: bool = False,
    link: str | None = None,
) -> Payload:
    """Estimates the payload from recordings, or, if its mass is known, the drive gains.

    By default, friction and offsets are estimated again for the recordings with the payload. They change with
    temperature and load, and the change would otherwise be attributed to the payload.

    Args:
        run: Run of the arm without the payload.
        paths: Recordings with the payload.
        reading: Fields of the log format that differ from that of the run's first recording.
        mass: Known mass of the payload [kg]; if it is given, the drive gains are estimated.
        com: Known centre of mass [m], in the tip frame, or in the frame of the link if one is named.
        gain_deviation: Relative standard deviation of the drive gains; if not given, that of the run.
        same_friction: True if the recordings with the payload have the friction of the run.
        link: Moving link that carries the payload, in whose frame its parameters are; by default that of the tip.

    Raises:
        ArmidError: The recordings do not fit the run, or do not determine the payload.
    """
    known = _known(run, mass, com, reading.get("drive_gain", run.log_format.drive_gain))
    place = payload_link(run, link)
    carrier = [each.name for each in run.robot.links].index(place.link)
    new_recordings = load_new_recordings(run, paths, reading, gain_deviation=gain_deviation, loaded=carrier)
    own = new_recordings.changing & (not same_friction)
    deviation = new_recordings.new.scale_deviation
    try:
        joined = stack_problems(
            new_recordings.earlier, run.estimate.fit, new_recordings.new, own, place.columns, new_recordings.samples
        )
        if known is None:
            load, gains = estimate_payload(joined), None
        else:
            load, gains = estimate_gains(joined, known, np.where(deviation > 0.0, deviation, np.inf))
        misfit, unexplained = fit_finding(new_recordings, place, own, known)
    except EstimationError as error:
        raise diagnosed_error(error, new_recordings.findings) from error
    findings = (
        *(new_recordings.findings if known is None else _with_gains_sought(run, new_recordings.findings)),
        *(() if unexplained is None else (unexplained,)),
        *_payload_findings(new_recordings, load, gains),
    )
    given = np.zeros(10, dtype=np.bool_) if known is None else ~np.isnan(known)
    return Payload(new_recordings, place, load, misfit, given, gains, findings)


def _with_gains_sought(run: Run, findings: Sequence[Finding]) -> list[Finding]:
    """Reduces the severity of the finding that a run failed its validation, if only drive gains were the cause.

    The finding then becomes information, because the drive gains are estimated.
    """
    if not only_drive_gains_failed(run):
        return list(findings)
    evidence = (
        f"The run {run.folder} did not pass its own validation, but only because its drive gains contradict the "
        "masses of the description. The known load determines the gains."
    )
    remedy = "write the estimated gains into the key `drive_gain` of the study, and identify the arm again."
    info = Finding("earlier-run-failed", "info", "", evidence, remedy)
    return [info if each.code == "earlier-run-failed" else each for each in findings]


def _known(run: Run, mass: float | None, com: tuple[float, float, float] | None, drive_gain: Any) -> Array | None:
    """Known parameters of the payload from mass and centre of mass, NaN for unknown ones, shape (10,).

    The result is `None` if all parameters are unknown.

    Args:
        run: The run.
        mass: Mass [kg]; `None` if unknown.
        com: Centre of mass [m]; `None` if unknown.
        drive_gain: Drive gains of the recordings; `None` if the effort is no current.

    Raises:
        StudyError: The mass is missing or not positive, or there are no drive gains to estimate.
    """
    if mass is None:
        if com is not None:
            raise StudyError(
                "The centre of mass of the payload is given without its mass.", remedy="give --mass, too."
            )
        return None
    if not 0.0 < mass < np.inf or not np.isfinite(com or 0.0).all():
        raise StudyError(
            f"A known load must have a mass above 0 and a finite centre of mass; found {mass:g} kg, {com}.",
            remedy="correct --mass or --com.",
        )
    if drive_gain is None:
        raise StudyError(
            f"Drive gains cannot be estimated, because the effort in {run.folder} is a torque and not a current.",
            possible="an estimate of the parameters of the load, without --mass",
            remedy="to estimate drive gains, first identify from currents with drive_gain = […] in the study.",
        )
    known = np.full(10, np.nan)
    known[0] = mass
    if com is not None:
        known[1:4] = mass * np.asarray(com)
    return known


def _payload_findings(
    new_recordings: NewRecordings, load: PayloadEstimate, gains: DriveGains | None
) -> list[Finding]:
    """Findings about possible errors of an estimated payload or of estimated drive gains."""
    found: list[Finding] = []
    unclear = [f"{LOAD_NAMES[k]} ({load.status[k]})" for k in PRINTED if load.status[k] != "identified"]
    if unclear:
        found.append(
            Finding(
                "load-weakly-excited",
                "warning",
                "",
                f"The recording does not determine {', '.join(unclear)}; their values follow from the other "
                "parameters and from physical consistency.",
                "rotate the load through wide angles, and move it fast to determine its inertia.",
            )
        )
    if load.distance > FAR:
        found.append(
            Finding(
                "load-not-real",
                "warning",
                "",
                f"The distance between the best fit to the torques and the nearest real body is {load.distance:.1f} "
                "standard deviations.",
                "check that the arm had no contact, that the load was attached all the time, and that the drive "
                "gains are right.",
            )
        )
    if gains is None and load.intervals[0, 0] <= NOTHING:
        most = f"{load.intervals[0, 1]:.3g} kg"
        evidence = f"The mass of the load does not differ significantly from zero; it is below {most}."
        remedy = (
            "check that the load was attached to the arm; if it was, record a faster motion through wider angles."
        )
        found.append(Finding("load-missing", "warning", "", evidence, remedy))
    if gains is not None and not gains.determined.all():
        names = ", ".join(new_recordings.run.robot.joint_names[j] for j in np.flatnonzero(~gains.determined))
        evidence = "The recordings do not determine the drive gain of the joint."
        found.append(Finding("gain-unseen", "warning", names, evidence, "record a motion that moves the joint."))
    if gains is not None:
        found += _gains_beyond(new_recordings, gains)
    exact = (
        new_recordings.recordings[0].choice.reading.drive_gain is not None
        and not new_recordings.new.scale_deviation.any()
    )
    if gains is None and exact:
        found.append(
            Finding(
                "gain-deviation-missing",
                "warning",
                "",
                "The torque is a current times drive gains that are assumed to be exact; an error of the "
                "gains changes the load by the same factor.",
                "give --gain-deviation 0.1 if the gains are from a data sheet, or give the mass with --mass "
                "if it is known.",
            )
        )
    few = few_blocks_finding(load.solution.fit)
    return found if few is None else [*found, few]


def _gains_beyond(new_recordings: NewRecordings, gains: DriveGains) -> list[Finding]:
    """Finding about drive gains whose correction is far larger than the stated standard deviation."""
    stated = new_recordings.new.scale_deviation
    size = np.maximum(np.abs(gains.correction), np.abs(1.0 / (1.0 + gains.correction) - 1.0))
    joints = np.flatnonzero(gains.determined & (stated > 0.0) & (size > FAR_GAIN * stated))
    if not len(joints):
        return []
    names = new_recordings.run.robot.joint_names
    each = ", ".join(f"{names[j]} {gains.correction[j]:+.0%} (stated {stated[j]:.0%})" for j in joints)
    return [
        Finding(
            "gain-beyond-deviation",
            "warning",
            ", ".join(names[j] for j in joints),
            f"Corrections of drive gains are far larger than the stated standard deviation: {each}. The mass, the "
            "link or the stated deviation may be wrong; then the intervals are wrong, too.",
            "check the mass and the link of the load (--mass, --link). If the gains are that uncertain, state a "
            "larger `drive_gain_deviation`.",
        )
    ]


def payload_record(payload: Payload) -> dict[str, Any]:
    """JSON object for the file `payload.json`."""
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
        "link": payload.place.link,
        "frame": payload.place.frame,
        "tip": {
            "name": run.robot.tip.name,
            "link": run.robot.links[run.robot.tip.parent].name if run.robot.tip.parent >= 0 else None,
            "placement": run.robot.tip.placement,
        },
        "parameters": parameters,
        "mass": {"value": load.values[0], "interval95": load.intervals[0], "statistical95": load.statistical[0]},
        "com": {"value": load.com, "interval95": load.com_intervals},
        "inertia_about_com": load.inertia_about_com,
        "inertia_about_com_interval95": dict(zip(INERTIA, load.inertia_intervals, strict=True)),
        "distance_to_real": load.distance,
        "gains": None if payload.gains is None else _gains_record(payload),
        "residual": {
            "rms": load.solution.fit.residual_rms,
            "new": payload.misfit.residual,
            "new_alone": payload.misfit.alone,
        },
        "covariance": {
            "kind": load.solution.fit.covariance_kind,
            "why": load.solution.fit.report.why,
            "matrix": load.covariance[np.ix_(PRINTED, PRINTED)],
            "quantile": load.quantile,
        },
        "recordings": [
            {"path": each.choice.path, "sha256": each.recording.sha256} for each in payload.new_recordings.recordings
        ],
        **judgement_record(payload.findings),
    }


def _gains_record(payload: Payload) -> list[dict[str, Any]]:
    """JSON objects with the given and the estimated drive gain of each joint."""
    gains, reading = payload.gains, payload.new_recordings.recordings[0].choice.reading
    assert gains is not None and reading.drive_gain is not None  # as `find_payload` made sure
    names = payload.new_recordings.run.robot.joint_names
    every = np.broadcast_to(np.asarray(reading.drive_gain, dtype=np.float64), (len(names),))
    return [
        {
            "joint": name,
            "given": float(given),
            "correction": gains.correction[j] if gains.determined[j] else None,
            "interval95": gains.intervals[j] if gains.determined[j] else None,
            "gain": given * (1.0 + gains.correction[j]) if gains.determined[j] else None,
            "unit": "N·m/A",
        }
        for j, (name, given) in enumerate(zip(names, every, strict=True))
    ]
