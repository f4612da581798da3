"""Friction in one table and one picture a joint: over velocity, over position, and around reversals."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from armid.estimation.estimate import averaged, torque_parameters
from armid.model.expression import symbols
from armid.model.motion import Motion
from armid.report.data.friction_at_reversals import Reversals, find_reversals
from armid.report.data.friction_laws import law_tables
from armid.report.data.joint_names import heading_of, label_of
from armid.report.data.number_format import decimals_of, fixed, short
from armid.report.data.page_data import PageData, velocity_unit
from armid.report.data.recording_data import RecordingData, friction_columns, joined
from armid.report.data.residual_analysis import MUCH, residual_shares
from armid.report.plots.traces import Axes, Plot, PlotTrace, binned, every, line, points
from armid.report.section import Section, effort_unit
from armid.report.tables import Column, Table, TableCell
from armid.values import Array

__all__ = ["show_friction"]

CURVE_POINTS = 241
"""Points of the drawn law: enough that a sign turning over a hundredth of the range is a slope and not a corner."""

BINS = 14
FEWEST_IN_BIN = 5
"""Rows below which a mean is noise."""

MOST_SYMBOLS = 5
"""Kinds of friction parameters that have a column; more are in the table of parameters."""

MOST_REVERSALS = 25
"""Reversals drawn by themselves; the means are over all."""


def show_friction(material: PageData) -> Section | None:
    """Friction of each joint as it is seen and as the law says; nothing where the model has no friction."""
    if not friction_columns(material.run.model).any():
        return None
    evidence, joints = material.drawn, range(len(material.joints))
    reversals = [find_reversals(evidence, j) for j in joints]
    rows = tuple(
        (
            heading_of(material.joints, j),
            (
                _over_velocity(material, evidence, j),
                _over_position(material, evidence, j),
                *_around_reversals(material, reversals[j], j),
            ),
        )
        for j in joints
        if evidence
    )
    legend = (
        ("forward", "seen, moving forward"),
        ("backward", "seen, moving backward"),
        ("mean", "mean of what is seen"),
        ("law", "fitted law"),
    )
    tables = (*law_tables(material), _table(material, evidence, reversals))
    return Section("Friction", {}, tables, rows, legend if rows else ())


def _table(material: PageData, evidence: Sequence[RecordingData], reversals: Sequence[Reversals]) -> Table:
    model, unit = material.run.model, effort_unit(material)
    chosen = [p for p, own in zip(model.parameters, friction_columns(model), strict=True) if own]
    symbols_of_all = list(dict.fromkeys(p.symbol for p in chosen))
    kinds, further = symbols_of_all[:MOST_SYMBOLS], symbols_of_all[MOST_SYMBOLS:]
    units = {symbol: next(p.unit for p in chosen if p.symbol == symbol) for symbol in kinds}
    estimate = material.run.estimate
    mean = averaged(estimate.base.names, estimate.fit)
    ends = dict(zip(mean.names, mean.intervals, strict=True))
    columns = (
        Column("joint", words=True),
        *(Column(symbol, units[symbol]) for symbol in kinds),
        Column("friction RMS", unit),
        Column("residual RMS", unit),
        *(Column(f"explained by {what}", "%") for what in ("velocity", "position", "reversals")),
        Column("reversals", ""),
    )
    rows: list[list[TableCell]] = []
    for j in range(len(material.joints)):
        remains = residual_shares(evidence, material.run.processing, j)
        turns = len(reversals[j].observed)
        rows.append(
            [
                TableCell(label_of(material.joints, j), kind="name"),
                *(_parameter(ends, symbol, j + 1) for symbol in kinds),
                *(_number(_rms(joined(evidence, what, j))) for what in ("friction", "residual")),
                *(_share(x) for x in (remains.velocity, remains.position, remains.reversal)),
                TableCell(str(turns), turns),
            ]
        )
    note = (
        "± half of the 95 % interval. Residual: of the whole model on the recordings drawn; explained by …: the "
        "share of the residual's variance that follows from velocity, from position with direction, and from the "
        "time since the last reversal, chance taken off. ▲ marks shares that are worth a richer law."
    )
    if len(estimate.fit.names) > len(mean.names):
        note += " Of what each recording has for itself the mean is shown."
    if further:
        note += f" {', '.join(further)}: in the table of parameters."
    return Table("friction", "Friction of each joint, and what the residual still follows", columns, rows, note)


def _parameter(ends: dict[str, Array], symbol: str, number: int) -> TableCell:
    """A friction parameter with half its interval, also where a constant of gravity has joined it."""
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
    much = value > MUCH
    return TableCell(fixed(100.0 * value, 0) + (" ▲" if much else ""), 100.0 * value, kind="poor" if much else "")


def _seen(evidence: Sequence[RecordingData], j: int) -> Array:
    """Friction as it is seen: measured less what the model says of all the rest."""
    return joined(evidence, "residual", j) + joined(evidence, "friction", j)


def _clouds(x: Array, dq: Array, friction: Array) -> list[PlotTrace]:
    """Return what is seen, the two directions apart."""
    return [
        points(role, np.where(way * dq > 0.0, x, np.nan), friction, f"moving {role}")
        for role, way in (("forward", 1.0), ("backward", -1.0))
    ]


def _means(x: Array, friction: Array, role: str, name: str) -> PlotTrace:
    edges = np.linspace(x.min(), x.max(), BINS + 1)
    where, mean, _ = binned(x, friction, edges, FEWEST_IN_BIN)
    return PlotTrace(role, where, mean, name)


def _over_velocity(material: PageData, evidence: Sequence[RecordingData], j: int) -> Plot:
    joint = material.joints[j]
    dq, friction = joined(evidence, "dq", j), _seen(evidence, j)
    fastest = float(np.abs(dq).max())
    return Plot(
        f"friction-velocity-{j}",
        "Over velocity",
        f"up to {short(fastest)} {velocity_unit(joint)}",
        f"velocity [{velocity_unit(joint)}]",
        f"friction [{joint.effort_unit}]",
        (*_clouds(dq, dq, friction), _means(dq, friction, "mean", "mean"), _law(material, evidence, j, fastest)),
    )


def _law(material: PageData, evidence: Sequence[RecordingData], j: int, fastest: float) -> PlotTrace:
    """The fitted law over steady velocity; its mean along the motion where it is more than a law of the velocity."""
    laws = [law for _, law in material.run.model.laws if j in dict(law.coordinate)]
    if any(law.memory is not None or symbols(law.expression) - {"dq", "ddq"} for law in laws):
        return _means(joined(evidence, "dq", j), joined(evidence, "friction", j), "law", "fitted law, mean")
    run, n = material.run, len(material.joints)
    theta = torque_parameters(run.estimate.base, run.estimate.fit) * friction_columns(run.model)
    velocity = np.linspace(-fastest, fastest, CURVE_POINTS)
    dq = np.zeros((CURVE_POINTS, n))
    dq[:, j] = velocity
    still = np.zeros_like(dq)
    torque = run.model.torque(Motion.of_states(still, dq, still), theta)
    return PlotTrace("law", velocity, torque[:, j], "fitted law")


def _over_position(material: PageData, evidence: Sequence[RecordingData], j: int) -> Plot:
    """Return what the laws of velocity leave over position, the directions apart, and the law of position, if any."""
    joint = material.joints[j]
    q, dq = joined(evidence, "q", j), joined(evidence, "dq", j)
    grid = np.linspace(q.min(), q.max(), CURVE_POINTS)
    law = _position_law(material, j, grid)
    left = joined(evidence, "residual", j) + np.interp(q, grid, law)
    traces = _clouds(q, dq, left)
    for way in (1.0, -1.0):
        chosen = way * dq > 0.0
        if chosen.any():
            traces.append(_means(q[chosen], left[chosen], "mean", "mean"))
    traces.append(PlotTrace("law", grid, law, "fitted law"))
    return Plot(
        f"friction-position-{j}",
        "Over position",
        "what the laws of velocity leave",
        f"position [{joint.unit}]",
        f"torque left [{joint.effort_unit}]",
        traces,
    )


def _position_law(material: PageData, j: int, q: Array) -> Array:
    """Torque (K,) of the fitted laws that depend on the position alone; zero where there is none."""
    run, n = material.run, len(material.joints)
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


def _around_reversals(material: PageData, found: Reversals, j: int) -> tuple[Plot, ...]:
    """Friction around reversals, turned so that the motion after each is positive."""
    joint, count = material.joints[j], len(found.observed)
    if not count:
        return ()
    drawn = found.observed[every(count, MOST_REVERSALS)]
    gap = np.full((len(drawn), 1), np.nan)
    x = np.hstack([np.tile(found.time, (len(drawn), 1)), gap]).ravel()
    traces = (
        PlotTrace("single", x, np.hstack([drawn, gap]).ravel(), "one reversal"),
        line("mean", found.time, found.observed.mean(axis=0), "mean"),
        line("law", found.time, found.fitted.mean(axis=0), "fitted law, mean"),
    )
    return (
        Plot(
            f"friction-reversal-{j}",
            "Around reversals",
            f"{count} reversals, each turned forward",
            "time since the reversal [s]",
            f"friction [{joint.effort_unit}]",
            traces,
            axes=Axes(marks=(0.0,)),
        ),
    )
