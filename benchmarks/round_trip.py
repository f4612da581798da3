"""Descriptions edited and read back: `python benchmarks/round_trip.py FOLDER... [--verbose] [--json]`.

Every URDF and MJCF in the folders that is a fixed arm or tree gets bodies of other mass and shape, friction and
rotors, as an export writes them. Told are how many files there were, in how many every byte outside the edited spans
is as it was, and the largest error of the torque that Pinocchio and MuJoCo compute from the written file. What armid
does not read (free bodies, ball joints, parts of files) or refuses to write is left out; `--json` and `--verbose` say
why. Fails where a byte or a torque of a written file is wrong.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from armid.errors import ArmidError
from descriptions import over_descriptions
from round_trips import PROGRAMS, RoundTrip, round_trip


def tried(path: Path, to: str) -> RoundTrip | str:
    """A description's way there and back, or why it has none."""
    with tempfile.TemporaryDirectory() as folder:
        try:
            return round_trip(path, Path(folder), to=to)
        except ArmidError as error:
            return f"{type(error).__name__}: {error.problem.splitlines()[0]}"


def summary(found: Mapping[str, RoundTrip]) -> dict[str, Any]:
    """Figures over all descriptions."""
    return {
        "bytes kept": sum(each.kept for each in found.values()),
        "largest error": {
            name: max((each.errors.get(name, 0.0) for each in found.values()), default=0.0) for name in PROGRAMS
        },
        "read by": {name: sum(name in each.errors for each in found.values()) for name in PROGRAMS},
        "joints": sum(each.joints for each in found.values()),
        "wrong": [path for path, each in found.items() if not each.holds],
    }


if __name__ == "__main__":
    sys.exit(over_descriptions(__doc__ or "", tried, summary))
