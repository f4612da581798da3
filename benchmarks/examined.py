"""CPU time of `armid doctor` on recorded arms in a fresh process.

`python benchmarks/examined.py [STUDY…] [--rounds N]`. A line an arm: median over the rounds of the CPU time, user and
system, after the import of the command line, with the modules that the doctor imports; of the examination from the
description and the file to the findings alone; and of the same once more in the same process. The first recording of
each study is examined over its whole length; the studies are those of `tests/real` where none are given. CPU time
grows by up to a half where other programs share the cores, so the load is printed, too.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
from pathlib import Path
from statistics import median

STUDIES = Path(__file__).resolve().parents[1] / "tests" / "real" / "studies"

SCRIPT = """
import json, resource, sys

def spent():
    used = resource.getrusage(resource.RUSAGE_SELF)
    return used.ru_utime + used.ru_stime

import armid.cli.main
from armid.threads import keep_freed_memory, prefer_one_thread

prefer_one_thread()
keep_freed_memory()
times = [spent()]
from dataclasses import replace
from armid.study.config import load_study
from armid.study.diagnosis import diagnose

times.append(spent())
for _ in range(2):
    study = load_study(sys.argv[1])
    first = replace(study.recordings[0], role="train", part=(0.0, 1.0))
    diagnose(replace(study, recordings=(first,)))
    times.append(spent())
print(json.dumps(times))
"""


def measured(study: Path) -> tuple[float, float, float]:
    """CPU times of one process [s]: examination with imports, without those of modules, and once more."""
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT, study], env=environment, capture_output=True, text=True, check=True
    )
    begin, imported, first, second = json.loads(done.stdout)
    return first - begin, first - imported, second - first


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("studies", type=Path, nargs="*", metavar="STUDY", default=sorted(STUDIES.glob("*.toml")))
    parser.add_argument("--rounds", type=int, default=5)
    given = parser.parse_args()
    print(f"{'CPU s, median of ' + str(given.rounds):24s}{'with imports':>14s}{'first':>8s}{'again':>8s}{'load':>7s}")
    for study in given.studies:
        measured(study)  # compiles modules and fills the system's caches
        rounds = [measured(study) for _ in range(given.rounds)]
        whole, first, again = (median(each) for each in zip(*rounds, strict=True))
        print(f"{study.stem:24s}{whole:14.2f}{first:8.2f}{again:8.2f}{os.getloadavg()[0]:7.1f}", flush=True)


if __name__ == "__main__":
    main()
