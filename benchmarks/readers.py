"""Descriptions read by armid and by Pinocchio: `python benchmarks/readers.py FOLDER... [--verbose] [--json]`.

Every URDF and MJCF in the folders that armid reads is read by Pinocchio, too. Told are how many files there were and
the largest differences of joint placements, inertias, torques on random states and base parameters, each relative to
the largest number of its kind. Joints that armid refuses to move (free, ball, followers) are held. `--verbose` says
the figures of each file, `--json` also why files were left out. Fails where a difference is above 1e-12.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections import Counter
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "support"))

from armid.errors import ArmidError
from pinocchio_descriptions import Agreement, compare
from round_trips import formats_of

SUFFIXES = (".urdf", ".xml", ".mjcf")
FIGURES = ("placement", "inertia", "torque", "base")


def main() -> int:
    """Compare every file and print what came of it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folders", nargs="+", type=Path, metavar="FOLDER")
    parser.add_argument("--verbose", action="store_true", help="every file")
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    found: dict[str, Agreement] = {}
    left: dict[str, str] = {}
    counts: Counter[str] = Counter()
    for path in sorted(p for f in options.folders for p in f.rglob("*") if p.suffix in SUFFIXES):
        form = formats_of(path)
        if not form:
            continue
        try:
            found[str(path)] = compare(path)
        except (ArmidError, UnicodeDecodeError) as error:
            left[str(path)] = str(error).splitlines()[0]
            continue
        counts[form] += 1
        if options.verbose:
            sys.stderr.write(f"{path}: {found[str(path)]}\n")
    summary = {
        "files": dict(counts),
        "joints": sum(each.joints for each in found.values()),
        "largest difference": {
            name: max((getattr(each, name) or 0.0 for each in found.values()), default=0.0) for name in FIGURES
        },
        "base parameters compared": sum(each.base is not None for each in found.values()),
        "wrong": {path: str(each) for path, each in found.items() if not each.holds},
        "left out": len(left),
    }
    if options.json:
        print(json.dumps(summary | {"reasons": left}))
    else:
        print("\n".join(f"{name}: {value}" for name, value in summary.items()))
    return 1 if summary["wrong"] or not found else 0


if __name__ == "__main__":
    sys.exit(main())
