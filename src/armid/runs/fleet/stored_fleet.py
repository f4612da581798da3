"""Folder of a fleet, and its reader.

    fleet.json  fleet.npz  robot.npz  units/NAME/ (a run for each unit)

The folder is written under a temporary name and renamed when it is complete, so a fleet is never incomplete.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from armid.atomic_file import replace_file
from armid.dataclass_files import load, save
from armid.errors import ArmidError
from armid.estimation.fleet.fleet_estimate import FleetEstimate
from armid.hashes import sha256_of_file
from armid.input_boundary import boundary, read_json
from armid.robot import Robot
from armid.runs.fleet.fleet_change import UnitChange, change_record
from armid.runs.run import write_run
from armid.study.fleet.fleet_table import fleet_rows
from armid.study.fleet.identify_fleet import FleetIdentification
from armid.study.storage.archive_digests import refuse_changed_archive
from armid.study.storage.atomic_folder import completed, refuse, whole_folder
from armid.study.storage.provenance import origin_now
from armid.study.storage.records import finding_record, to_json

MARKER = "fleet.json"

ARCHIVES = ("fleet.npz", "robot.npz")
"""Archives of a fleet, whose digests are stored in `fleet.json`."""

FORMAT = 1
"""Number of the format of the folder of a fleet, stored in `fleet.json`."""

UNITS = "units"
"""Name of the folder in a fleet that contains a run for each unit."""


@dataclass(frozen=True, eq=False, slots=True)
class StoredFleet:
    """Contents of the folder of a fleet.

    Attributes:
        folder: The folder.
        robot: The type of arm.
        estimate: Estimate of the fleet.
    """

    folder: str
    robot: Robot
    estimate: FleetEstimate

    def run_of(self, unit: str) -> Path:
        """Folder of the run of a unit.

        Raises:
            ArmidError: The fleet has no unit of this name.
        """
        if unit not in self.estimate.units:
            raise ArmidError(
                f"The fleet {self.folder} has no unit {unit!r}.",
                possible=", ".join(self.estimate.units),
                remedy="give the name of one of these units.",
            )
        return Path(self.folder) / UNITS / unit


def refuse_fleet_folder(folder: Path | str) -> None:
    """Raises an error if a fleet cannot or must not be written to a folder; called before a long computation.

    Raises:
        OutputError: The folder has contents that are not a fleet, is the working folder, or is not writable.
    """
    refuse(folder, MARKER, "fleet")


def save_fleet(
    fleet: FleetIdentification,
    folder: Path | str,
    *,
    changes: Sequence[UnitChange] | None = None,
    since: str = "",
) -> Path:
    """Writes the folder of a fleet. An existing fleet is replaced; any other folder is refused.

    Args:
        fleet: Result of an identification of a fleet.
        folder: Output folder.
        changes: Changes since an earlier fleet; `None` if it is not compared.
        since: Folder of the earlier fleet.

    Raises:
        OutputError: The folder cannot be written, or its contents are not a fleet.
    """
    made = origin_now()
    with whole_folder(folder, MARKER, "fleet") as draft:
        for name, result in zip(fleet.estimate.units, fleet.results, strict=True):
            place = draft / UNITS / name
            place.mkdir(parents=True)
            write_run(result, place, made)
        save(fleet.estimate, draft / ARCHIVES[0])
        save(fleet.robot, draft / ARCHIVES[1])
        record = fleet_record(fleet, changes=changes, since=since)
        record["sha256"] = {name: sha256_of_file(draft / name) for name in ARCHIVES}
        replace_file(draft / MARKER, to_json(record) + "\n")
    return Path(folder)


def fleet_record(
    fleet: FleetIdentification, *, changes: Sequence[UnitChange] | None = None, since: str = ""
) -> dict[str, Any]:
    """JSON object about a fleet: own parameters of all units with intervals, shared parameters, odd units, changes.

    Args:
        fleet: Result of an identification of a fleet.
        changes: Changes since an earlier fleet; `None` if it is not compared.
        since: Folder of the earlier fleet.
    """
    rows = fleet_rows(fleet)
    estimate = fleet.estimate
    own = set(estimate.prior.own)
    units = dict(zip(fleet.base.names, fleet.base.units, strict=True))
    record: dict[str, Any] = {
        "format": FORMAT,
        "robot": fleet.robot.name,
        "units": [
            {
                "name": name,
                "run": f"{UNITS}/{name}",
                "verdict": result.validation.verdict,
                "own": [
                    {
                        "name": row.parameter,
                        "joint": row.joint,
                        "value": row.value,
                        "unit": row.unit,
                        "interval95": (row.value - row.half, row.value + row.half),
                        "score": row.score,
                        "odd": row.odd,
                    }
                    for row in rows
                    if row.of == name
                ],
            }
            for name, result in zip(estimate.units, fleet.results, strict=True)
        ],
        "shared": [
            {"name": name, "value": estimate.prior.mean[k], "unit": units[name], "deviation": deviation}
            for k, (name, deviation) in enumerate(
                zip(fleet.base.names, estimate.prior.covariance.diagonal() ** 0.5, strict=True)
            )
            if name not in own
        ],
        "between_units": [
            {"name": name, "deviation": deviation}
            for name, deviation in zip(estimate.own.names, estimate.own.deviation, strict=True)
        ],
        "warnings": [finding_record(finding) for finding in fleet.findings],
    }
    if changes is not None:
        record["since"] = since
        record["changes"] = [change_record(each) for each in changes]
    return record


def load_fleet(folder: Path | str) -> StoredFleet:
    """Reads a fleet.

    Raises:
        ArmidError: The folder is not a fleet, is damaged, or has a format that this version does not know.
    """
    folder = completed(folder)
    with boundary("a fleet of this version of armid", folder, remedy="give the folder that armid fleet made."):
        made = (folder / MARKER).is_file()
    if not made:
        raise ArmidError(f"{folder} is not a fleet of armid.", remedy="give the folder that armid fleet made.")
    kept = read_json(folder / MARKER, "a record of a fleet", remedy="run armid fleet again.")
    if kept.get("format", FORMAT) != FORMAT:
        raise ArmidError(
            f"{folder} has format {kept['format']}; this version of armid reads format {FORMAT}.",
            remedy="update armid, or run armid fleet again with this version.",
        )
    with boundary("a fleet", folder, remedy="run armid fleet again."):
        digests = {name: kept["sha256"][name] for name in ARCHIVES}
    for name, digest in digests.items():
        refuse_changed_archive(folder / name, digest, MARKER, "run armid fleet again.")
    robot, estimate = load(Robot, folder / ARCHIVES[1]), load(FleetEstimate, folder / ARCHIVES[0])
    if robot.n != len(estimate.prior.noise):
        raise ArmidError(
            f"{folder} has an arm with {robot.n} joints and an estimate with {len(estimate.prior.noise)}, which do "
            "not belong together.",
            remedy="restore the folder from a copy, or run armid fleet again.",
        )
    return StoredFleet(str(folder), robot, estimate)
