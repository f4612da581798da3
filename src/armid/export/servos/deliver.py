"""Files about an identified servo arm for other programs, and the check of the MJCF by MuJoCo."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from armid.errors import ArmidError, Finding, OutputError
from armid.export.body_split import share_out
from armid.export.formats import urdf
from armid.export.input_digest_check import source_of
from armid.export.servos.edited_mjcf import edited_mjcf, reason_without_shapes
from armid.export.servos.mjcf_actuators import joint_values, servo_mjcf, written_links
from armid.export.servos.mujoco_rollout import SAME, RollOutComparison, beginnings, compare_roll_outs
from armid.export.servos.simulator_parameters import simulator_parameters
from armid.export.types import Content, DescriptionSource
from armid.robot.robot import InertialParameters
from armid.runs.servos.stored_servo import StoredServo
from armid.servo.servo_run import ServoRun
from armid.study.storage.records import to_json

MODEL, URDF, SIMULATORS = "model.xml", "model.urdf", "simulators.json"


@dataclass(frozen=True, eq=False, slots=True)
class Delivery:
    """Files for other programs.

    Attributes:
        files: Contents of the files, by their name.
        findings: Findings about values that a format cannot store, and about checks of the files.
        check: Comparison of the roll-out of the MJCF in MuJoCo, for `servo.json`; empty without MuJoCo.
    """

    files: Mapping[str, bytes]
    findings: tuple[Finding, ...]
    check: Mapping[str, Any] = field(default_factory=dict[str, Any])


def delivered(stored: StoredServo, runs: Sequence[ServoRun]) -> Delivery:
    """Makes the files of a result, and checks the MJCF.

    Args:
        stored: The result.
        runs: Runs on whose beginnings the roll-out of MuJoCo is compared with that of armid.
    """
    source = _source(stored)
    data, findings = _mjcf(stored, source)
    comparison, told = _checked(stored, data, runs)
    if comparison is not None and comparison.total > SAME and data != (plain := _plain_mjcf(stored)):
        # Something else of the description acts in MuJoCo, such as springs; the file must move as the result does.
        data, other = plain, _without_shapes("with the rest of the description, MuJoCo moves the arm otherwise")
        comparison, told = _checked(stored, data, runs)
        findings = (*findings, other)
    files = {MODEL: data}
    try:
        written, of_urdf = _urdf(stored, source)
        files[URDF] = written
    except OutputError as error:
        of_urdf = (Finding("servo-urdf-left-out", "info", "", f"{URDF} was not written: {error.problem}", ""),)
    record = simulator_parameters(stored.model, stored.parameters)
    files[SIMULATORS] = (to_json(record) + "\n").encode()
    findings = (*findings, *_without_place(record["not_stated"]), *told, *of_urdf)
    return Delivery(files, findings, {} if comparison is None else _record(comparison))


def _source(stored: StoredServo) -> DescriptionSource | None:
    """Description of the arm; `None` if it has changed or does not exist any more."""
    try:
        return source_of(stored.study.robot, Path(stored.study.folder), stored.robot)
    except ArmidError:
        return None


def _mjcf(stored: StoredServo, source: DescriptionSource | None) -> tuple[bytes, tuple[Finding, ...]]:
    """MJCF with the shapes of the description if it is an MJCF whose shapes are there, otherwise without shapes."""
    reason = reason_without_shapes(source)
    if source is None or reason:
        return _plain_mjcf(stored), (_without_shapes(reason),)
    try:
        data, findings = edited_mjcf(source, stored.model, stored.parameters, Path(stored.folder))
    except OutputError as error:
        return _plain_mjcf(stored), (_without_shapes(error.problem),)
    return data, (*source.findings, *findings)


def _plain_mjcf(stored: StoredServo) -> bytes:
    return servo_mjcf(stored.model, stored.parameters)


def _without_shapes(reason: str) -> Finding:
    what = f"the bodies of {MODEL} have no shapes: {reason}"
    return Finding("servo-shapes-left-out", "info", "", what)


def _without_place(names: Sequence[str]) -> tuple[Finding, ...]:
    """Finding about parameters of friction laws that no format but `servo.json` can store."""
    if not names:
        return ()
    what = f"the files for other programs do not contain {', '.join(names)}; servo.json does"
    return (Finding("servo-law-left-out", "warning", "", what, "use the terms viscous and coulomb for simulators"),)


def _checked(
    stored: StoredServo, data: bytes, runs: Sequence[ServoRun]
) -> tuple[RollOutComparison | None, tuple[Finding, ...]]:
    """Comparison of the motion of MuJoCo with that of armid, and the finding if they differ or MuJoCo refuses."""
    folder = Path(stored.folder).resolve()
    folder.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=folder.parent, prefix=f".{folder.name}-check-") as place:
        path = Path(place) / MODEL  # beside the folder, so that relative paths of meshes are right
        path.write_bytes(data)
        try:
            found = compare_roll_outs(path, stored.model, stored.parameters, beginnings(runs))
        except OutputError as error:
            return None, (Finding("servo-file-refused", "warning", MODEL, error.problem, error.remedy),)
    if found is None or found.total <= SAME:
        return found, ()
    j = int(np.argmax(found.rms))
    what = (
        f"under the recorded commands, MuJoCo {found.version} moves the arm of {MODEL} otherwise than armid: by "
        f"{1e3 * found.total:.3g} mrad (mm) RMS over the joints, most at {stored.robot.joint_names[j]} "
        f"({1e3 * found.rms[j]:.3g})"
    )
    remedy = "do not use the file for this arm; friction laws without a place in the format are one cause"
    return found, (Finding("servo-rollout-differs", "warning", MODEL, what, remedy),)


def _record(comparison: RollOutComparison) -> dict[str, Any]:
    return {
        "mujoco": comparison.version,
        "rms": comparison.rms,
        "total": comparison.total,
        "bound": SAME,
        "seconds": comparison.seconds,
    }


def _urdf(stored: StoredServo, source: DescriptionSource | None) -> tuple[bytes, tuple[Finding, ...]]:
    """URDF with identified bodies, viscous and Coulomb friction and limits: the description edited, or a new one.

    Raises:
        OutputError: A new file needs limits that the description does not state, or bodies cannot be distributed.
    """
    links = written_links(stored.robot, stored.parameters)
    values = joint_values(stored.model, stored.parameters)
    joints = {name: {term: x for term, x in each.items() if term in urdf.PLACES} for name, each in values.items()}
    limits = zip(stored.robot.joints, stored.parameters.limit, strict=True)
    own = [replace(joint, effort_limit=float(limit)) for joint, limit in limits]
    content = Content(replace(stored.robot, joints=own, links=links), joints)
    if source is not None and source.format == "urdf":
        bodies = urdf.bodies(source, urdf.read(source.data, source.locked), stored.robot)
        inertials = [link.inertial or InertialParameters.zero() for link in links]
        changed, findings = share_out(inertials, bodies, lumped=False)
        written = urdf.write(replace(content, source=source, bodies=changed))
        return written.data, (*source.findings, *findings, *written.findings)
    written = urdf.write(content)
    return written.data, written.findings
