"""Descriptions edited and read back: `python benchmarks/round_trip.py FOLDER... [--verbose] [--json]`.

Every URDF and MJCF in the folders that is a fixed arm or tree gets bodies of other mass and shape, friction and
rotors, as an export writes them. Told are how many files there were, in how many every byte outside the edited spans
is as it was, and the largest error of the torque that Pinocchio and MuJoCo compute from the written file. What armid
does not read (free bodies, ball joints, parts of files) or refuses to write is left out; `--json` and `--verbose` say
why. Fails where a byte or a torque of a written file is wrong.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections import Counter
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "support"))

from armid.errors import ArmidError
from round_trips import PROGRAMS, RoundTrip, formats_of, round_trip

SUFFIXES = (".urdf", ".xml", ".mjcf")


def tried(path: Path, to: str) -> RoundTrip | str:
    """A description's way there and back, or why it has none."""
    with tempfile.TemporaryDirectory() as folder:
        try:
            return round_trip(path, Path(folder), to=to)
        except ArmidError as error:
            return f"{type(error).__name__}: {error.problem.splitlines()[0]}"


def main() -> int:
    """Try every file and print what came of it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folders", nargs="+", type=Path, metavar="FOLDER")
    parser.add_argument("--verbose", action="store_true", help="every file")
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    found: dict[str, RoundTrip] = {}
    left: dict[str, str] = {}
    counts: Counter[str] = Counter()
    for path in sorted(p for f in options.folders for p in f.rglob("*") if p.suffix in SUFFIXES):
        to = formats_of(path)
        if not to:
            continue
        result = tried(path, to)
        if isinstance(result, str):
            left[str(path)] = result
        else:
            found[str(path)] = result
            counts[to] += 1
        if options.verbose:
            sys.stderr.write(f"{path}: {result}\n")
    summary = {
        "files": dict(counts),
        "bytes kept": sum(each.kept for each in found.values()),
        "largest error": {name: max(each.errors.get(name, 0.0) for each in found.values()) for name in PROGRAMS},
        "read by": {name: sum(name in each.errors for each in found.values()) for name in PROGRAMS},
        "joints": sum(each.joints for each in found.values()),
        "wrong": [path for path, each in found.items() if not each.holds],
        "left out": len(left),
    }
    if options.json:
        print(json.dumps(summary | {"reasons": left}))
    else:
        print("\n".join(f"{name}: {value}" for name, value in summary.items()))
    return 1 if summary["wrong"] or not found else 0


if __name__ == "__main__":
    sys.exit(main())
