"""Descriptions read by armid and by Pinocchio: `python benchmarks/readers.py FOLDER... [--verbose] [--json]`.

Every URDF and MJCF in the folders that armid reads is read by Pinocchio, too. Told are how many files there were and
the largest differences of joint placements, inertias, torques on random states and base parameters, each relative to
the largest number of its kind. Joints that armid refuses to move (free, ball, followers) are held. `--verbose` says
the figures of each file, `--json` also why files were left out. Fails where a difference is above 1e-12.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from armid.errors import ArmidError
from descriptions import over_descriptions
from pinocchio_descriptions import Agreement, compare

FIGURES = ("placement", "inertia", "torque", "base")


def tried(path: Path, form: str) -> Agreement | str:
    """Agreement of the two readers, or why a description is left out."""
    del form
    try:
        return compare(path)
    except (ArmidError, UnicodeDecodeError) as error:
        return str(error).splitlines()[0]


def summary(found: Mapping[str, Agreement]) -> dict[str, Any]:
    """Figures over all descriptions."""
    return {
        "joints": sum(each.joints for each in found.values()),
        "largest difference": {
            name: max((getattr(each, name) or 0.0 for each in found.values()), default=0.0) for name in FIGURES
        },
        "base parameters compared": sum(each.base is not None for each in found.values()),
        "wrong": {path: str(each) for path, each in found.items() if not each.holds},
    }


if __name__ == "__main__":
    sys.exit(over_descriptions(__doc__ or "", tried, summary))
