"""Loop over all descriptions of some folders, which benchmarks of reading and writing share."""

from __future__ import annotations

import argparse
import json
import sys
from collections import Counter
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeVar

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "support"))

from round_trips import formats_of

SUFFIXES = (".urdf", ".xml", ".mjcf")

R = TypeVar("R")


def over_descriptions(
    text: str, attempt: Callable[[Path, str], R | str], summarise: Callable[[Mapping[str, R]], dict[str, Any]]
) -> int:
    """Try every URDF and MJCF below the folders of the command line, and print a summary.

    Args:
        text: Text of `--help`.
        attempt: Function of a path and its format (`urdf` or `mjcf`); its result, or why there is none.
        summarise: Function of the results by path; figures by name, among them `wrong`.

    Returns:
        Exit code: 1 if anything is wrong, or if there is no result.
    """
    parser = argparse.ArgumentParser(description=text)
    parser.add_argument("folders", nargs="+", type=Path, metavar="FOLDER")
    parser.add_argument("--verbose", action="store_true", help="every file")
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    found: dict[str, R] = {}
    left: dict[str, str] = {}
    counts: Counter[str] = Counter()
    for path in sorted(p for f in options.folders for p in f.rglob("*") if p.suffix in SUFFIXES):
        form = formats_of(path)
        if not form:
            continue
        result = attempt(path, form)
        if isinstance(result, str):
            left[str(path)] = result
        else:
            found[str(path)] = result
            counts[form] += 1
        if options.verbose:
            sys.stderr.write(f"{path}: {result}\n")
    summary = {"files": dict(counts), **summarise(found), "left out": len(left)}
    if options.json:
        print(json.dumps(summary | {"reasons": left}))
    else:
        print("\n".join(f"{name}: {value}" for name, value in summary.items()))
    return 1 if summary["wrong"] or not found else 0
