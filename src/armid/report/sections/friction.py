"""Section of friction: table of all joints, plots over velocity, over position and around reversals."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from armid.checked_array import Array
from armid.estimation.estimate_record import averaged, torque_parameters
from armid.model.motion import Motion
from armid.model.torque_law_expression import symbols
from armid.report.data.friction_at_reversals import Reversals, find_reversals
from armid.report.data.friction_law_text import law_tables
from armid.report.data.joint_names import heading_of, label_of
from armid.report.data.number_format import decimals_of, fixed, short
from armid.report.data.page_data import PageData, velocity_unit
from armid.report.data.recording_data import RecordingData, concatenated, friction_columns
from armid.report.data.residual_dependence import LARGE_SHARE, residual_shares
from armid.report.plots.plot_specification import Axes, Plot, PlotTrace, binned, every, line, points
from armid.report.section import Section, effort_unit
from armid.report.tables import Column, Table, TableCell

CURVE_POINTS = 241
"""Number of points of a plotted friction law, so that a sign change over a hundredth of the range is a visible
slope."""

BINS = 14
MIN_BIN_ROWS = 5
"""Smallest number of rows in a bin of velocity or position; the mean of fewer rows is mostly noise."""

MAX_SYMBOLS = 5
"""Largest number of friction parameters with a column; further parameters are in the table of parameters."""

MAX_REVERSALS = 25
"""Largest number of single reversals that are plotted; the means include all reversals."""


def show_friction(page_data: PageData) -> Section | None:
    """Section of measured friction and fitted law of each joint; `None` if the model has no friction."""
    if not friction_columns(page_data.run.model).any():
        return None
    recordings, joints = page_data.drawn, range(len(page_data.joints))
    reversals = [find_reversals(recordings, j) for j in joints]
    rows = tuple(
        (
            heading_of(page_data.joints, j),
            (
                _over_velocity(page_data, recordings, j),
                _over_position(page_data, recordings, j),
                *_around_reversals(page_data, reversals[j], j),
            ),
        )
        for j in joints
        if recordings
    )
    legend = (
        ("forward", "measured, moving forward"),
        ("backward", "measured, moving backward"),
        ("mean", "mean of the measured friction"),
        ("law", "fitted law"),
    )
    tables = (*law_tables(page_data), _table(page_data, recordings, reversals))
    return Section("Friction", {}, tables, rows, legend if rows else ())


def _table(page_data: PageData, recordings: Sequence[RecordingData], reversals: Sequence[Reversals]) -> Table:
    model, unit = page_data.run.model, effort_unit(page_data)
    chosen = [p for p, is_friction in zip(model.parameters, friction_columns(model), strict=True) if is_friction]
    symbols_of_all = list(dict.fromkeys(p.symbol for p in chosen))
    kinds, further = symbols_of_all[:MAX_SYMBOLS], symbols_of_all[MAX_SYMBOLS:]
    units = {symbol: next(p.unit for p in chosen if p.symbol == symbol) for symbol in kinds}
    estimate = page_data.run.estimate
    mean = averaged(estimate.base.names, estimate.fit)
    ends: dict[str, Array] = dict(zip(mean.names, mean.intervals, strict=True))
    columns = (
        Column("joint", words=True),
        *(Column(symbol, units[symbol]) for symbol in kinds),
        Column("friction RMS", unit),
        Column("residual RMS", unit),
        *(Column(f"explained by {what}", "%") for what in ("velocity", "position", "reversals")),
        Column("reversals", ""),
    )
    rows: list[list[TableCell]] = []
    for j in range(len(page_data.joints)):
        shares = residual_shares(recordings, page_data.run.processing, j)
        reversal_count = len(reversals[j].observed)
        rows.append(
            [
                TableCell(label_of(page_data.joints, j), kind="name"),
                *(_parameter(ends, symbol, j + 1) for symbol in kinds),
                *(_number(_rms(concatenated(recordings, what, j))) for what in ("friction", "residual")),
                *(_share(x) for x in (shares.velocity, shares.position, shares.reversal)),
                TableCell(str(reversal_count), reversal_count),
            ]
        )
    note = (
        "± half of the 95 % interval. Residual: residual of the whole model on the plotted recordings. "
        "Explained by …: share of the residual's variance that depends on velocity, on position with "
        "direction, and on the time since the last reversal, adjusted for chance. ▲ marks shares large "
        "enough to suggest a further friction law."
    )
    if len(estimate.fit.names) > len(mean.names):
        note += " For parameters estimated separately for each recording the mean is shown."
    if further:
        note += f" {', '.join(further)}: in the table of parameters."
    return Table("friction", "Friction of each joint, and dependence of the residual", columns, rows, note)


def _parameter(ends: dict[str, Array], symbol: str, number: int) -> TableCell:
    """Cell of a friction parameter with half its interval, or of the base parameter into which it is grouped."""
    for name in (f"{symbol}_{number}", f"{symbol}R_{number}"):
        if name in ends:
            low, high = ends[name]
            half, value = 0.5 * float(high - low), 0.5 * float(high + low)
            decimals = decimals_of(half)
            return TableCell(f"{fixed(value, decimals)} ± {fixed(half, decimals)}", value)
    return TableCell("–", "")


def _rms(values: Array) -> float:
    known = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(known**2))) if len(known) else np.nan


def _number(value: float) -> TableCell:
    return TableCell(short(value), value)


def _share(value: float) -> TableCell:
    is_large = value > LARGE_SHARE
    return TableCell(
        fixed(100.0 * value, 0) + (" ▲" if is_large else ""), 100.0 * value, kind="poor" if is_large else ""
    )


def _measured_friction(recordings: Sequence[RecordingData], j: int) -> Array:
    """Measured friction: measured torque minus the torque of the model without friction."""
    return concatenated(recordings, "residual", j) + concatenated(recordings, "friction", j)


def _clouds(x: Array, dq: Array, friction: Array) -> list[PlotTrace]:
    """Points of the measured friction, as one trace for each direction of motion."""
    return [
        points(role, np.where(sign * dq > 0.0, x, np.nan), friction, f"moving {role}")
        for role, sign in (("forward", 1.0), ("backward", -1.0))
    ]


def _means(x: Array, friction: Array, role: str, name: str) -> PlotTrace:
    edges = np.linspace(x.min(), x.max(), BINS + 1)
    where, mean, _ = binned(x, friction, edges, MIN_BIN_ROWS)
    return PlotTrace(role, where, mean, name)


def _over_velocity(page_data: PageData, recordings: Sequence[RecordingData], j: int) -> Plot:
    joint = page_data.joints[j]
    dq, friction = concatenated(recordings, "dq", j), _measured_friction(recordings, j)
    fastest = float(np.abs(dq).max())
    return Plot(
        f"friction-velocity-{j}",
        "Over velocity",
        f"up to {short(fastest)} {velocity_unit(joint)}",
        f"velocity [{velocity_unit(joint)}]",
        f"friction [{joint.effort_unit}]",
        (*_clouds(dq, dq, friction), _means(dq, friction, "mean", "mean"), _law(page_data, recordings, j, fastest)),
    )


def _law(page_data: PageData, recordings: Sequence[RecordingData], j: int, fastest: float) -> PlotTrace:
    """Fitted friction law over velocity; if the law depends on more than the velocity, its mean along the motion."""
    laws = [law for _, law in page_data.run.model.laws if j in dict(law.coordinate)]
    if any(law.memory is not None or symbols(law.expression) - {"dq", "ddq"} for law in laws):
        return _means(
            concatenated(recordings, "dq", j), concatenated(recordings, "friction", j), "law", "fitted law, mean"
        )
    run, n = page_data.run, len(page_data.joints)
    theta = torque_parameters(run.estimate.base, run.estimate.fit) * friction_columns(run.model)
    velocity = np.linspace(-fastest, fastest, CURVE_POINTS)
    dq = np.zeros((CURVE_POINTS, n))
    dq[:, j] = velocity
    still = np.zeros_like(dq)
    torque = run.model.torque(Motion.of_states(still, dq, still), theta)
    return PlotTrace("law", velocity, torque[:, j], "fitted law")


def _over_position(page_data: PageData, recordings: Sequence[RecordingData], j: int) -> Plot:
    """Plot over position: torque minus the friction laws of velocity, for each direction, and the law of position."""
    joint = page_data.joints[j]
    q, dq = concatenated(recordings, "q", j), concatenated(recordings, "dq", j)
    grid = np.linspace(q.min(), q.max(), CURVE_POINTS)
    law = _position_law(page_data, j, grid)
    remaining = concatenated(recordings, "residual", j) + np.interp(q, grid, law)
    traces = _clouds(q, dq, remaining)
    for sign in (1.0, -1.0):
        chosen = sign * dq > 0.0
        if chosen.any():
            traces.append(_means(q[chosen], remaining[chosen], "mean", "mean"))
    traces.append(PlotTrace("law", grid, law, "fitted law"))
    return Plot(
        f"friction-position-{j}",
        "Over position",
        "torque minus the friction laws of velocity",
        f"position [{joint.unit}]",
        f"remaining torque [{joint.effort_unit}]",
        traces,
    )


def _position_law(page_data: PageData, j: int, q: Array) -> Array:
    """Torque of the fitted friction laws that depend only on the position, at K positions, shape (K,) [N·m or N]."""
    run, n = page_data.run, len(page_data.joints)
    theta = np.zeros(len(run.model.parameters))
    for column, (_, law) in zip(run.model.law_columns, run.model.laws, strict=True):
        if symbols(law.expression) == frozenset({"q"}):
            theta[column] = torque_parameters(run.estimate.base, run.estimate.fit)[column]
    if not theta.any():
        return np.zeros_like(q)
    positions = np.zeros((len(q), n))
    positions[:, j] = q
    still = np.zeros_like(positions)
    return run.model.torque(Motion.of_states(positions, still, still), theta)[:, j]


def _around_reversals(page_data: PageData, reversals: Reversals, j: int) -> tuple[Plot, ...]:
    """Plot of friction around reversals; the sign of friction is positive along the motion after the reversal."""
    joint, count = page_data.joints[j], len(reversals.observed)
    if not count:
        return ()
    drawn = reversals.observed[every(count, MAX_REVERSALS)]
    gap = np.full((len(drawn), 1), np.nan)
    x = np.hstack([np.tile(reversals.time, (len(drawn), 1)), gap]).ravel()
    traces = (
        PlotTrace("single", x, np.hstack([drawn, gap]).ravel(), "one reversal"),
        line("mean", reversals.time, reversals.observed.mean(axis=0), "mean"),
        line("law", reversals.time, reversals.fitted.mean(axis=0), "fitted law, mean"),
    )
    return (
        Plot(
            f"friction-reversal-{j}",
            "Around reversals",
            f"{count} reversals, signed so that motion goes forward",
            "time since the reversal [s]",
            f"friction [{joint.effort_unit}]",
            traces,
            axes=Axes(marks=(0.0,)),
        ),
    )
