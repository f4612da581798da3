"""From a long Parquet file to an identified and validated model: time and memory of `armid identify`.

`python benchmarks/long_recordings.py [--minutes M …] [--rate HZ] [--peer M] [--folder DIR] [--json]`. A virtual
iiwa 14 on a motion of several frequencies, positions and torque with noise, by inverse dynamics; the first 70 %
train, the rest validates. Each file is identified by the command in a new process, with the checks of the recording
and without the report; wall time, CPU time and the peak of resident memory are those of this process. The peer reads
a file of M minutes with pyarrow, filters and differentiates with SciPy, and solves one least-squares problem with
Pinocchio's regressor at the rows that are left, which do not pass the filter of the torque. Files are kept in the
folder, if one is given, and used again.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from processing import CUTOFF, ORDER, RATE, ROWS, arm, parts, peak, spent

CHUNK = 500_000
"""Samples that are made and written at a time."""

STUDY = """
[robot]
description = "iiwa14-r820"
gravity = [0.0, 0.0, 9.81]
[model]
terms = ["rigid-body", "viscous", "coulomb"]
[[recording]]
path = "{path}"
part = [0.0, 0.7]
[[recording]]
path = "{path}"
part = [0.7, 1.0]
role = "validate"
"""


def write(path: Path, samples: int, rate: float) -> None:
    """Write a recording of the arm."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    n = arm()[0].n
    schema = pa.schema(
        [(name, pa.float64()) for name in ("t", *(f"{x}{j + 1}" for x in ("q", "tau") for j in range(n)))]
    )
    unfinished = path.with_suffix(".part")
    with pq.ParquetWriter(unfinished, schema, compression="snappy") as writer:
        for t, q, tau in parts(samples, rate, CHUNK):
            columns = [np.ascontiguousarray(each) for each in (t, *q.T, *tau.T)]
            writer.write_table(pa.table(columns, schema=schema), row_group_size=CHUNK)
    unfinished.rename(path)


def identified(path: Path, folder: Path) -> dict[str, float]:
    """Wall time [s], CPU time [s] and peak of memory [MB] of the command."""
    study = folder / "study.toml"
    study.write_text(STUDY.format(path=path))
    command = [sys.executable, "-m", "armid", "identify", str(study), "--no-report", "--out", str(folder / "run")]
    one = dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1")
    begin = time.perf_counter()
    child = subprocess.Popen(command, env={**os.environ, **one}, stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
    assert child.stdout is not None
    text = child.stdout.read().decode()
    _, status, used = os.wait4(child.pid, 0)
    if status:
        raise SystemExit(text)
    return {
        "wall": time.perf_counter() - begin,
        "cpu": used.ru_utime + used.ru_stime,
        "peak_mb": used.ru_maxrss / 1024.0,
    }


def peer(path: Path, rate: float) -> dict[str, float]:
    """The same of pyarrow, SciPy and Pinocchio, in this process."""
    import pyarrow.parquet as pq
    from scipy.signal import butter, sosfiltfilt

    pin: Any = import_module("pinocchio")
    model, _ = arm()
    robot = pin.Model()
    for i, each in enumerate(model.robot.joints):
        placement = pin.SE3(each.placement[:3, :3].copy(), each.placement[:3, 3].copy())
        robot.addJoint(i, pin.JointModelRZ(), placement, each.name)
    data, n = robot.createData(), model.n
    begin, before = spent(), time.perf_counter()
    table = pq.read_table(path)
    q, tau = (np.column_stack([table[f"{each}{j + 1}"].to_numpy() for j in range(n)]) for each in ("q", "tau"))
    sections = butter(ORDER, CUTOFF, fs=rate, output="sos")
    step, edge = round(rate / ROWS), round(0.5 * rate)
    rows = slice(edge, len(q) - edge, step)
    q = sosfiltfilt(sections, q, axis=0)
    dq = np.gradient(q, 1.0 / rate, axis=0)
    ddq = np.gradient(dq, 1.0 / rate, axis=0)[rows]
    q, dq = q[rows], dq[rows]
    Y = np.zeros((len(q), n, 12 * n))
    for s in range(len(q)):
        Y[s, :, : 10 * n] = pin.computeJointTorqueRegressor(robot, data, q[s], dq[s], ddq[s])
    joint = np.arange(n)
    Y[:, joint, 10 * n + joint], Y[:, joint, 11 * n + joint] = dq, np.sign(dq)
    np.linalg.lstsq(Y.reshape(-1, 12 * n), sosfiltfilt(sections, tau, axis=0)[rows].ravel())
    return {"wall": time.perf_counter() - before, "cpu": spent() - begin, "peak_mb": peak()}


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=float, nargs="+", default=(6.0, 60.0))
    parser.add_argument("--rate", type=float, default=RATE, help="sample rate [Hz]")
    parser.add_argument("--peer", type=float, default=6.0, metavar="M", help="minutes for the peer; 0 leaves it out")
    parser.add_argument("--folder", type=Path, help="folder of the files, which are kept")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.add_argument("--beside", type=Path, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.beside:
        print(json.dumps(peer(given.beside, given.rate)))
        return
    with tempfile.TemporaryDirectory() as place:
        folder = given.folder or Path(place)
        folder.mkdir(parents=True, exist_ok=True)

        def file(minutes: float) -> Path:
            path = (folder / f"{minutes:g}min{given.rate:g}Hz.parquet").resolve()
            if not path.exists():
                write(path, round(60.0 * minutes * given.rate), given.rate)
            return path

        results: dict[str, dict[str, float]] = {}
        for minutes in given.minutes:
            results[f"armid, {minutes:g} min"] = identified(file(minutes), Path(place))
        if given.peer:
            command = [sys.executable, __file__, "--rate", str(given.rate), "--beside", str(file(given.peer))]
            done = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True)
            results[f"peer, {given.peer:g} min"] = json.loads(done.stdout)
        if given.json:
            print(json.dumps(results))
            return
        print(f"{'':<18}{'wall s':>9}{'CPU s':>9}{'peak MB':>9}")
        for name, row in results.items():
            print(f"{name:<18}{row['wall']:9.1f}{row['cpu']:9.1f}{row['peak_mb']:9.0f}")
        print(f"load {os.getloadavg()[0]:.1f}, {os.cpu_count()} cores")


if __name__ == "__main__":
    main()
