"""Time, place and version of a run."""

from __future__ import annotations

import platform
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from datetime import datetime
from importlib.metadata import version
from typing import Any

__all__ = ["RunOrigin", "origin_now", "origin_of", "origin_record"]


@dataclass(frozen=True, slots=True)
class RunOrigin:
    """The making of a run; empty where its record does not say it.

    Attributes:
        at: Date and time with the offset from UTC, ISO 8601, to the second.
        host: Name of the machine.
        version: Of armid.
    """

    at: str = ""
    host: str = ""
    version: str = ""


def origin_now() -> RunOrigin:
    """A run that is made here and now."""
    return RunOrigin(datetime.now().astimezone().isoformat(timespec="seconds"), platform.node(), version("armid"))


def origin_record(made: RunOrigin) -> dict[str, str]:
    """The making as JSON."""
    return asdict(made)


def origin_of(kept: Mapping[str, Any]) -> RunOrigin:
    """The making of a run from its record, which runs of earlier versions do not have."""
    found: Mapping[str, Any] = kept.get("made") or {}
    return RunOrigin(*(str(found.get(key, "")) for key in ("at", "host", "version")))
