"""Ratios of CPU time on one thread: `python benchmarks/run.py [--json] [--samples N] [--build FOLDER]`."""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
from pathlib import Path

ONE_THREAD = {name: "1" for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")}
MEASURED = Path(__file__).with_name("measured.py")


def main() -> int:
    """Measure in a process of its own and print a table, or what it printed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.add_argument("--samples", type=int, default=216_000, help="samples of the least-squares problem")
    parser.add_argument("--build", type=Path, default=Path("build/benchmarks"), help="where the C++ loop is built")
    options = parser.parse_args()
    command = [sys.executable, str(MEASURED), str(options.samples), str(options.build)]
    done = subprocess.run(command, env={**os.environ, **ONE_THREAD}, stdout=subprocess.PIPE, text=True, check=False)
    if done.returncode or options.json:
        print(done.stdout, end="")
        return done.returncode
    outcome = json.loads(done.stdout)
    print(f"{outcome['isa']} on {outcome['processor']}, one thread, load {outcome['load'][0]:.1f}")
    for row in outcome["results"]:
        unit = "mb" if "armid_mb" in row else "seconds"
        mine, theirs = row[f"armid_{unit}"], row[f"peer_{unit}"]
        further = row.get("nanoseconds_a_further_sample")
        more = "" if further is None else f"  {further:.0f} ns a further sample"
        print(f"{row['name']:<32} {mine:>10.4g}  {row['peer']:<30} {theirs:>10.4g}  x {row['ratio']:.1f}{more}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
