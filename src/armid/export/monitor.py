"""Export of a monitor of external torque as C code, with the functions of the model."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np

from armid.codegen.texts.monitor_code import MonitorNumbers, write_monitor
from armid.export.code import export_code
from armid.export.sidecar import origin_line, refuse_overwriting
from armid.runs.monitoring.monitor import Monitor
from armid.runs.monitoring.observer import SETTLED, SLOW, LowPassStage
from armid.runs.monitoring.thresholds import AFTER_REST, REST_SPEED, REST_TIME


def export_monitor(monitor: Monitor, folder: Path | str, *, name: str = "") -> tuple[Path, ...]:
    """Writes a monitor as C code for samples at the rate of its thresholds; returns the paths of the files.

    Args:
        monitor: The monitor.
        folder: Folder for the code.
        name: Prefix of the functions; if empty, the name of the arm is used.

    Raises:
        OutputError: The files cannot be written, or would replace files that are not an export of this run.
    """
    own_line, folder = origin_line(monitor.run), Path(folder)
    present = [path for suffix in ("c", "h") for path in folder.glob(f"*_monitor.{suffix}")]
    foreign = [path for path in present if own_line not in path.read_text(encoding="utf-8", errors="replace")]
    refuse_overwriting(foreign, monitor.run)
    found = monitor.thresholds
    heading = (
        own_line,
        f"Observer: {monitor.options.kind}, gain {monitor.options.gain_at(monitor.rate):g} 1/s.",
        f"Samples per second: {monitor.rate:.6g}.",
        f"False alarms per hour: {found.rate:.4g}{'' if found.promised else ' (extrapolated, not promised)'}.",
    )
    memory = bool(monitor.run.model.nodes)
    written = partial(write_monitor, numbers=monitor_numbers(monitor), memory=memory, heading=heading)
    return export_code(monitor.run, "c", folder, name=name, further=written).files


def monitor_numbers(monitor: Monitor) -> MonitorNumbers:
    """Numbers that the C code of a monitor contains: filter coefficients, times, speeds and thresholds."""
    rate, options, found = monitor.rate, monitor.options, monitor.thresholds
    corner = options.stage_at(rate)
    stage = LowPassStage.of(corner, rate)
    return MonitorNumbers(
        options.kind == "momentum",
        monitor.velocity,
        (corner, stage.decay, stage.old, stage.new),
        (
            LowPassStage.of(options.gain_at(rate), rate).decay,
            float(np.exp(-SLOW / rate)),
            float(np.exp(-AFTER_REST / rate)),
        ),
        (REST_SPEED, int(np.ceil(REST_TIME * rate))),
        rate,
        int(np.ceil(SETTLED * rate)),
        found.scale,
        found.factor,
        found.friction,
    )
