"""CPU time of `armid identify` with its report, side by side with another installation.

`python benchmarks/identified.py OTHER STUDY… [--rounds N]`, where OTHER is the other's command `armid`.

Each study is identified by both in turn; the smallest time of each counts, of all processes and with imports.
"""

from __future__ import annotations

import argparse
import os
import resource
import subprocess
import sys
import tempfile
from pathlib import Path

HERE = Path(sys.executable).with_name("armid")


def seconds(command: Path, study: Path) -> float:
    """CPU time of one identification [s], on one thread."""

    def spent() -> float:
        used = resource.getrusage(resource.RUSAGE_CHILDREN)
        return used.ru_utime + used.ru_stime

    with tempfile.TemporaryDirectory() as folder:
        run = Path(folder) / "run"
        environment = {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
        environment.pop("PYTHONDONTWRITEBYTECODE", None)
        before = spent()
        done = subprocess.run(
            [command, "identify", study, "--out", run], env=environment, capture_output=True, text=True, check=False
        )
        if not (run / "report.html").is_file():
            raise SystemExit(f"{command} identify {study} failed: {done.stderr[-500:]}")
        return spent() - before


def main() -> None:
    """Measure both commands in turn on every study."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("other", type=Path)
    parser.add_argument("studies", type=Path, nargs="+", metavar="STUDY")
    parser.add_argument("--rounds", type=int, default=3)
    given = parser.parse_args()
    total = [0.0, 0.0]
    for study in given.studies:
        rounds = [(seconds(given.other, study), seconds(HERE, study)) for _ in range(given.rounds)]
        least = [min(each) for each in zip(*rounds, strict=True)]
        total = [whole + part for whole, part in zip(total, least, strict=True)]
        print(f"{study.stem:24s}{least[0]:8.2f} s{least[1]:8.2f} s   ratio {least[1] / least[0]:.2f}", flush=True)
    print(f"{'together':24s}{total[0]:8.2f} s{total[1]:8.2f} s   ratio {total[1] / total[0]:.2f}")


if __name__ == "__main__":
    main()
