"""Section of a planned motion: position, velocity, acceleration and torque of each joint, with their limits."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from armid.checked_array import Array
from armid.excitation.limits.joint_limits import Limits
from armid.excitation.plan import Plan
from armid.excitation.poses_and_sweeps import Moves
from armid.model.described_torque import described_torque
from armid.model.dynamics_model import DynamicsModel
from armid.model.motion import Motion
from armid.report.data.joint_names import heading_of
from armid.report.data.number_format import short
from armid.report.plots.plot_specification import Plot, PlotTrace, line
from armid.report.section import Section, one_of
from armid.report.series_table import coefficient_table
from armid.report.tables import Table

PLOT_RATE = 100.0
"""Sampling rate of the plots [Hz]; a period of the fastest harmonic that arms can follow has 40 samples."""

PLOT_POINTS = 4000.0
"""Largest number of samples of a long motion in a plot."""


def motion_section(
    plan: Plan | Moves, model: DynamicsModel, limits: Limits, content: Mapping[str, object] | None = None
) -> Section:
    """Section of a plan with its limits, and with torque if the description has inertias.

    Args:
        plan: The motion.
        model: Model of the arm; torque is computed from the values of its description.
        limits: Limits of the joints.
        content: Further values for the template.
    """
    motion = plan.sample(min(PLOT_RATE, PLOT_POINTS / plan.duration))
    described = None if model.nominal_parameters() is None else described_torque(model.robot)
    torque = None if described is None else described[0].torque(motion, described[1])
    rows = tuple(
        (heading_of(model.robot.joints, j), tuple(_plots(motion, torque, model, limits, j))) for j in range(model.n)
    )
    return Section("Motion", content or {}, _tables(plan, model), rows, (("measured", "plan"), ("limit", "limit")))


def _tables(plan: Plan | Moves, model: DynamicsModel) -> tuple[Table, ...]:
    """Table of the Fourier coefficients; empty for a motion between poses, which has none."""
    if not isinstance(plan, Plan):
        return ()
    units = [joint.unit for joint in model.robot.joints]
    table = coefficient_table(
        "series",
        "Fourier coefficients",
        plan.excitation,
        f"q₀ in {one_of(units)}. The same numbers at full precision are in plan.json.",
        unit=one_of([f"{unit}/s" for unit in units]),
        text=lambda value: short(value, 5),
        offsets=True,
        folded=True,
    )
    return (table,)


def _plots(motion: Motion, torque: Array | None, model: DynamicsModel, limits: Limits, j: int) -> list[Plot]:
    """Plots of position, velocity, acceleration and torque of one joint over time, with the limits."""
    joint = model.robot.joints[j]
    unit = joint.unit
    shown: list[tuple[str, str, Array, tuple[float, float]]] = [
        ("position", f"q [{unit}]", motion.q[:, j], (float(limits.lower[j]), float(limits.upper[j]))),
        ("velocity", f"dq [{unit}/s]", motion.dq[:, j], _both(limits.velocity[j])),
        ("acceleration", f"ddq [{unit}/s²]", motion.ddq[:, j], _both(limits.acceleration[j])),
    ]
    if torque is not None:
        shown.append(("torque", f"τ [{joint.effort_unit}]", torque[:, j], _both(limits.effort[j])))
    plots: list[Plot] = []
    for name, axis, values, bounds in shown:
        traces = [line("measured", motion.time, values, name)]
        ends = motion.time[[0, -1]]
        traces += [PlotTrace("limit", ends, np.full(2, each), "limit") for each in bounds if math.isfinite(each)]
        caption = f"{short(float(values.min()))} to {short(float(values.max()))}"
        if math.isfinite(bounds[1]):
            low, high = map(short, bounds)
            caption += f"; limit {high}" if bounds[0] == -bounds[1] else f"; limits {low} and {high}"
        plots.append(Plot(f"{name}-{j + 1}", name.capitalize(), caption, "time [s]", axis, traces, "plan"))
    return plots


def _both(limit: float) -> tuple[float, float]:
    return -float(limit), float(limit)
