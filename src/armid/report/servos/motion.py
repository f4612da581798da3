"""Section of the motion of a servo result: commanded, measured and simulated positions of each joint, and errors."""

from __future__ import annotations

import numpy as np

from armid.checked_array import Array
from armid.report.data.joint_names import heading_of
from armid.report.data.number_format import share, short
from armid.report.data.page_data import MAX_DRAWN
from armid.report.plots.plot_specification import Axes, Plot, line, spread
from armid.report.section import Section
from armid.report.servos.page_data import ServoPageData
from armid.servo.quantities import POSITION_ERROR

LEGEND = (
    ("recorded", "commanded"),
    ("measured", "measured"),
    ("predicted", "simulated"),
    ("band", "95 % band"),
    ("training", "error, measured − simulated"),
    ("level", "ends of the band"),
)


def motion_section(page_data: ServoPageData) -> Section | None:
    """Section with plots of position and error of each joint on the drawn recordings; `None` without recordings."""
    if not page_data.runs:
        return None
    names = page_data.names
    rows = tuple(
        (f"{names[k]}: {heading_of(page_data.joints, j)}", _plots(page_data, k, j))
        for k in range(min(MAX_DRAWN, len(names)))
        for j in range(len(page_data.joints))
    )
    content = {"role": page_data.role, "drawn": min(MAX_DRAWN, len(names)), "all": len(names)}
    return Section("Commanded, measured and simulated motion", content, plots=rows, legend=LEGEND)


def _plots(page_data: ServoPageData, k: int, j: int) -> tuple[Plot, ...]:
    """Plots of position and error of one joint on one run."""
    run, joint = page_data.runs[k], page_data.joints[j]
    q, simulated, command = run.q[:, j], page_data.simulated[k][:, j], run.held(run.time)[:, j]
    half, time = float(page_data.stored.errors.band[j]), run.time - run.start
    scale, unit = POSITION_ERROR.scale, POSITION_ERROR.unit(joint)
    error = q - simulated
    inside = float(np.mean(np.abs(error) <= half))
    return (
        Plot(
            f"servo-q-{k}-{j}",
            "Position",
            f"measured from {short(float(q.min()))} to {short(float(q.max()))} {joint.unit}",
            "time [s]",
            f"q [{joint.unit}]",
            (
                spread(time, simulated - half, simulated + half, "95 % band"),
                line("recorded", time, command, "commanded"),
                line("measured", time, q, "measured"),
                line("predicted", time, simulated, "simulated"),
            ),
            group=f"servo-{k}",
        ),
        Plot(
            f"servo-error-{k}-{j}",
            "Position error",
            f"RMS {short(scale * _rms(error))} {unit}, that of the command {short(scale * _rms(q - command))} "
            f"{unit}; {share(inside)} of the rows inside ±{short(scale * half)} {unit}",
            "time [s]",
            f"error [{unit}]",
            (line("training", time, scale * error, "measured − simulated"),),
            group=f"servo-{k}",
            axes=Axes(levels=(-scale * half, 0.0, scale * half) if np.isfinite(half) else (0.0,)),
        ),
    )


def _rms(error: Array) -> float:
    return float(np.sqrt(np.mean(error**2)))
