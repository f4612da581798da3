"""How often the doctor is right: `python benchmarks/doctor.py [--logs N] [--first K] [--fault NAME]… [--json]`.

N logs without a fault and N with each fault, of three arms on motions drawn at random, by inverse dynamics. A line
a class: how often the fault was found, and how often it was named and nothing else was called an error; of sound
logs how many had any error or warning.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from collections import Counter
from pathlib import Path
from typing import Any

for _name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")
sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from armid.errors import ArmidError, Finding  # noqa: E402
from armid.study.doctor import diagnose_recording  # noqa: E402
from sick import FAULTS, Case, sound  # noqa: E402

QUIET = {"info"}
"""Severities that raise no alarm."""

ALSO: dict[str, set[str]] = {
    "motor-side": {"degrees", "position-offset", "current-without-gain"},
    "rows-repeated": {"clock-jitter"},
    "degrees": {"velocity-mismatch"},
}
"""Codes that are no wrong name for a fault, since they say the same in other words."""


def examined(case: Case) -> tuple[Finding, ...]:
    """Findings on a case; one that cannot be read at all has the code of nothing."""
    try:
        return diagnose_recording(case.robot, case.recording, case.reading)
    except ArmidError as error:
        return (Finding("refused", "error", "", error.problem),)


def measure(name: str, logs: int, first: int) -> dict[str, Any]:
    """One class."""
    found = named = 0
    wrong: Counter[str] = Counter()
    worst: list[str] = []
    seconds = 0.0
    for seed in range(first, first + logs):
        case = sound(seed) if name == "sound" else FAULTS[name](seed)
        began = time.process_time()
        findings = examined(case)
        seconds += time.process_time() - began
        codes = {f.code for f in findings}
        alarms = {f.code for f in findings if f.severity not in QUIET} - {name} - ALSO.get(name, set())
        hit = name in codes if name != "sound" else not alarms
        found += hit
        named += hit and not {f.code for f in findings if f.severity == "error"} & alarms
        wrong.update(alarms)
        if not hit or alarms:
            worst.append(f"{seed} {case.robot.name} {sorted(codes)}")
    return {
        "class": name,
        "logs": logs,
        "found": found / logs,
        "named": named / logs,
        "other": dict(wrong.most_common()),
        "seconds": seconds / logs,
        "missed": worst,
    }


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--logs", type=int, default=45, help="of each class")
    parser.add_argument("--first", type=int, default=1000, help="seed of the first")
    parser.add_argument("--fault", action="append", choices=("sound", *FAULTS))
    parser.add_argument("--verbose", action="store_true")
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    results: list[dict[str, Any]] = []
    if not options.json:
        print(f"{'class':26s}{'logs':>6s}{'found':>8s}{'named':>8s}{'CPU s':>7s}  other alarms")
    for name in options.fault or ("sound", *FAULTS):
        each = measure(name, options.logs, options.first)
        results.append(each)
        if not options.json:
            print(
                f"{name:26s}{each['logs']:6d}{each['found']:8.1%}{each['named']:8.1%}{each['seconds']:7.2f}  "
                + ", ".join(f"{code} {count}" for code, count in each["other"].items()),
                flush=True,
            )
            for line in each["missed"] if options.verbose else ():
                print("   ", line)
    if options.json:
        print(json.dumps(results, indent=1))


if __name__ == "__main__":
    main()
