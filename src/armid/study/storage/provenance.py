"""Origin of a run: time, machine, and version of armid."""

from __future__ import annotations

import platform
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from datetime import datetime
from importlib.metadata import version
from typing import Any


@dataclass(frozen=True, slots=True)
class RunOrigin:
    """Origin of a run; fields that are missing in the record of the run are empty.

    Attributes:
        at: Date and time with the offset from UTC, ISO 8601, to the second.
        host: Name of the machine.
        version: Version of armid.
    """

    at: str = ""
    host: str = ""
    version: str = ""


def origin_now() -> RunOrigin:
    """Origin of a run that is made now on this machine."""
    return RunOrigin(datetime.now().astimezone().isoformat(timespec="seconds"), platform.node(), version("armid"))


def origin_record(origin: RunOrigin) -> dict[str, str]:
    """Origin of a run as a dictionary for a JSON file."""
    return asdict(origin)


def origin_of(record: Mapping[str, Any]) -> RunOrigin:
    """Origin of a run from its record; empty for runs of earlier versions."""
    origin: Mapping[str, Any] = record.get("made") or {}
    return RunOrigin(*(str(origin.get(key, "")) for key in ("at", "host", "version")))
