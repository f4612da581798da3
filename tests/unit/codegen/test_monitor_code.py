"""The monitor in C gives what the monitor in Python gives, sample by sample."""

from __future__ import annotations

import ctypes
import subprocess
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from armid.checked_array import Array
from armid.export.monitor import export_monitor
from armid.lab.pushes import Push
from armid.runs.monitoring.live_monitor import LiveMonitor
from armid.runs.monitoring.monitor import make_monitor
from armid.runs.monitoring.observer import ObserverOptions
from coded import CC, STRICT
from watched import RATE, moved, small_run

PUSH = Push(joint=1, torque=6.0, start=3.0, seconds=0.3)

MAIN = """
#include "{name}_monitor.h"
static {name}_monitor m;
void start(void) {{ {name}_monitor_start(&m); }}
int update(const double *q, const double *tau, const double *dq, double *external, double *threshold) {{
  (void)dq;
  return {name}_monitor_update(&m, q, tau{velocity}, external, threshold);
}}
"""


def pointer(x: Array) -> Any:
    return x.ctypes.data_as(ctypes.POINTER(ctypes.c_double))


@pytest.mark.skipif(CC is None, reason="no C compiler")
@pytest.mark.parametrize(
    ("kind", "terms", "velocity"),
    [
        ("momentum", ("rigid-body", "viscous", "coulomb"), False),
        ("residual", ("rigid-body", "viscous", "coulomb"), True),
        ("momentum", ("rigid-body", "viscous", "hysteresis"), True),
    ],
)
def test_c_is_python(tmp_path: Path, kind: str, terms: tuple[str, ...], velocity: bool):
    run = small_run(tmp_path, *terms)
    logs = [moved(seed, 1, *pushes) for seed, pushes in ((20, ()), (4, (PUSH,)))]
    if velocity:
        logs = [replace(log, dq=np.gradient(log.q, 1.0 / RATE, axis=0)) for log in logs]
    options = ObserverOptions(kind, 50.0)  # pyright: ignore[reportArgumentType]
    monitor = make_monitor(run, references=logs[:1], options=options, false_alarms=100.0)
    files = export_monitor(monitor, tmp_path / "code")
    name = files[0].stem
    assert [path.name for path in files[-2:]] == [f"{name}_monitor.h", f"{name}_monitor.c"]
    assert "no safety function" in files[-2].read_text() and "malloc" not in files[-1].read_text()
    (tmp_path / "code" / "main.c").write_text(MAIN.format(name=name, velocity=", dq" if velocity else ""))
    library = tmp_path / "code" / "monitor.so"
    sources = [str(path) for path in (tmp_path / "code").glob("*.c")]
    subprocess.run(
        [str(CC), "-std=c99", "-O1", *STRICT, "-shared", "-fPIC", *sources, "-lm", "-o", library], check=True
    )
    loaded = ctypes.CDLL(str(library))
    live, log, alarms = LiveMonitor(monitor, RATE), logs[1], 0
    assert log.effort is not None
    loaded.start()
    external, threshold = np.empty(3), np.empty(3)
    for k in range(1000):
        dq = log.dq[k].copy() if log.dq is not None else None
        q, tau = log.q[k].copy(), log.effort[k].copy()
        seen = live.update(q, tau, dq)
        given = (q, tau, q if dq is None else dq, external, threshold)
        if k == 400:  # refused, and the samples that follow are as without it
            assert loaded.update(*map(pointer, (q * np.nan, *given[1:]))) == -1
            assert loaded.update(*map(pointer, (q, tau * np.inf, *given[2:]))) == -1
        over = loaded.update(*map(pointer, given))
        # Rounding; the order of sums differs from that of the kernel.
        assert np.allclose(external, seen.external, atol=1e-9) and np.allclose(threshold, seen.threshold, atol=1e-9)
        assert over == int(seen.exceeded.sum())
        alarms += over > 0
    assert alarms > 20
