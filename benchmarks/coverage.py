"""Real coverage of 95 % intervals: `python benchmarks/coverage.py [--runs N] [--case NAME]… [--json]`.

Each line is one kind of noise; each column one way to make intervals: share of parameters inside, that of the worst
parameter, and the median width over the textbook's. The last columns are what armid chooses, how often it chose which
kind, and the share of unseen torque inside the 95 % band.
"""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")

import argparse
import json
import sys
import time
from collections import Counter
from typing import Any

import numpy as np

from armid.measurement.low_pass_band import Band
from simulated import COLOURS, COMMON, UNEQUAL, Case, Simulation

OPEN, LOGS = Band(), Band("butterworth", 3.5, 4, "periodic")
KINDS: dict[str, dict[str, Any]] = {
    "white": {"band": OPEN, "rate": 50.0},
    "AR(1) 10 ms": {"memory": 0.01},
    "AR(1) 100 ms": {"memory": 0.1},
    "AR(1) 300 ms": {"memory": 0.3},
    "AR(1) 100 ms, all rows": {"memory": 0.1, "band": OPEN},
    "unequal joints": {"memory": COLOURS, "levels": tuple(UNEQUAL)},
    "joints in common": {"memory": 0.1, "common": COMMON},
    "8 kHz, 3.5 Hz filter": {"rate": 8000.0, "drawn": 100.0, "band": LOGS},
}
PERIODS = (6, 1)
CASES = {f"{kind}, K = {K}": Case(kind, periods=K, **options) for K in PERIODS for kind, options in KINDS.items()}
METHODS = ("textbook", "block", "period", "spectral", "bootstrap", "chosen")

CHECKED = 3
"""Runs that are made again from observations, to check the short cut."""

SHORT_CUT = 0.1
"""Largest difference of the median width between the short cut and the real path: what other weights make."""


def measure(name: str, case: Case, runs: int, seed: int, bootstraps: int = 0) -> dict[str, Any]:
    """Coverage of one case, by the block bootstrap only on the first recordings."""
    began = time.perf_counter()
    simulation = Simulation(case, seed)
    inside: dict[str, list[Any]] = {}
    width: dict[str, list[float]] = {}
    kinds: Counter[str] = Counter()
    torque: list[float] = []
    apart: list[float] = []
    for k in range(runs):
        noise = case.noise(np.random.default_rng((seed, 2, k)), case.periods)
        outcome = simulation.run(noise)
        by_bootstrap = {"bootstrap": simulation.bootstrapped(noise, k)} if k < bootstraps else {}
        for method, half in {**outcome.half, **by_bootstrap}.items():
            inside.setdefault(method, []).append(np.abs(outcome.error) <= half)
            width.setdefault(method, []).append(float(np.median(half / outcome.half["textbook"])))
        kinds[outcome.chosen] += 1
        torque.append(outcome.inside)
        if k < CHECKED:
            ends = simulation.real_path(noise).intervals
            apart.append(float(abs(np.median((ends[:, 1] - ends[:, 0]) / 2.0 / outcome.half["chosen"]) - 1.0)))
    methods = {
        method: {
            "mean": float(np.mean(each)),
            "worst": float(np.mean(each, axis=0).min()),
            "width": float(np.median(width[method])),
        }
        for method, each in inside.items()
    }
    return {
        "name": name,
        "runs": runs,
        "methods": methods,
        "kinds": dict(kinds),
        "torque": float(np.mean(torque)),
        "short_cut": max(apart, default=0.0),
        "seconds": time.perf_counter() - began,
    }


def line(row: dict[str, Any]) -> str:
    """A row of the table."""
    cells: list[str] = []
    for method in METHODS:
        if method == "bootstrap" and method not in row["methods"]:
            continue
        found = row["methods"].get(method)
        text = "" if found is None else f"{100 * found['mean']:.1f} {100 * found['worst']:.1f} ×{found['width']:.2f}"
        cells.append(f"{text:<18}")
    kinds = ", ".join(f"{kind} {count / row['runs']:.0%}" for kind, count in sorted(row["kinds"].items()))
    return f"{row['name']:<32}{''.join(cells)}{kinds:<26}{100 * row['torque']:.1f}"


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=1000, help="simulated identifications of each case")
    parser.add_argument("--case", action="append", choices=list(CASES), help="only these cases")
    parser.add_argument("--bootstrap", type=int, default=0, help="first runs with a block bootstrap, slow")
    parser.add_argument("--seed", type=int, default=1, help="of the noise")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    options = parser.parse_args()
    if not options.json:
        head = "".join(f"{method:<18}" for method in METHODS if options.bootstrap or method != "bootstrap")
        print(f"{'mean % worst % width':<32}{head}{'kinds chosen':<26}torque %")
    rows: list[dict[str, Any]] = []
    for name in options.case or CASES:
        rows.append(measure(name, CASES[name], options.runs, options.seed, options.bootstrap))
        if not options.json:
            print(line(rows[-1]), flush=True)
    if options.json:
        print(json.dumps({"seed": options.seed, "results": rows}))
    return int(any(row["short_cut"] > SHORT_CUT for row in rows))


if __name__ == "__main__":
    sys.exit(main())
