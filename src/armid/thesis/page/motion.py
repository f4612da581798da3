"""Chapter of the page on section 3.3, Tables A.1 and A.2, Figures 4.1 and A.1, and Algorithm 2 of the thesis."""

from __future__ import annotations

import numpy as np

from armid.excitation.fourier import Excitation
from armid.report.data.number_format import fixed, short
from armid.report.plots.plot_specification import Plot, PlotTrace, line
from armid.report.section import Section
from armid.report.series_table import coefficient_table
from armid.report.tables import Column, Table, TableCell
from armid.thesis.design_trials import DesignTrial
from armid.thesis.page.chapter_elements import Block, Figures, Text, chapter, counted, number, subscripts
from armid.thesis.page.equations import SERIES
from armid.thesis.published import published
from armid.thesis.reproduction import Thesis
from armid.thesis.setting import DESIGNED

SYMBOLS = 9
"""Number of symbols that mark the line of a joint in the plot of positions."""

DRAWN_RATE = 25.0
"""Rate at which the line of a joint is sampled in the plot of positions [Hz]."""

JOINTS = tuple(f"joint-{j}" for j in range(1, 8))


def show_excitation(thesis: Thesis) -> Section:
    """Chapter on the excitation of the thesis: condition numbers, Algorithm 2, and tables of Fourier coefficients."""
    setting, found = thesis.setting, thesis.designs
    best = found.best
    blocks: list[Block] = [
        Text(
            "Trajectories are Fourier series [Swevers1997] of ten harmonics and 20&nbsp;s that begin and end at "
            f"rest in q = 0, (3.55): {found.unknowns} coefficients, of which (3.55c) leaves {found.free} free. "
            "Table A.1 was "
            f"designed for 20&nbsp;s and run in 27&nbsp;s; its condition number in print is "
            f"{published().condition:g}."
        ),
        SERIES,
        _conditions(thesis),
        Text(_stretched(thesis)),
        Figures(
            "Figure 4.1: joint positions of the excitation trajectory, Table A.1 in 27 s",
            (positions("figure-4-1", setting.train),), 1, joint_legend(),
        ),
        Text(
            f"<b>Algorithm 2</b> from {counted(len(found.trials), 'random start')} in [−1.5, 1.5]: each start is "
            "scaled into the limits (3.55d) to (3.55f), the last without its 1/L, and the condition number is "
            "minimised from there. The result is simulated in MuJoCo under inverse dynamics control, with a model "
            "5&nbsp;% too heavy and feedforward of 90&nbsp;% of the friction, and Algorithm 3 is applied to the "
            "recording. Of the feasible trajectories the one whose parameters predict Table A.2 best is kept."
        ),
        _trials(thesis),
        Text(_kept(thesis)),
        Text(_other_families(thesis)),
        _families(thesis),
        coefficient_table("table-a-1-new", f"Fourier coefficients of the one that is kept ({best.name})", best.plan),
        Figures(
            f"The trajectory that is kept ({best.name}), {best.plan.period:g} s",
            (positions("kept", best.plan),), 1, joint_legend(),
        ),
        coefficient_table(
            "table-a-1", "Table A.1: Fourier coefficients of the used trajectory", setting.train.stretched(20.0),
            "The row b₁₀ is missing in print; it follows from (3.55c).",
        ),
        coefficient_table(
            "table-a-2", "Table A.2: Fourier coefficients of the feasibility test trajectory",
            setting.unseen.stretched(20.0),
        ),
        Figures(
            "Figure A.1: joint positions of the feasibility test trajectory, Table A.2 in 20 s",
            (positions("figure-a-1", setting.unseen.stretched(20.0)),), 1, joint_legend(),
        ),
    ]  # fmt: skip
    return chapter("The motion", *blocks)


def _stretched(thesis: Thesis) -> str:
    """Text on possible reasons why the arm of the thesis needed 27 s for a motion that was designed for 20 s."""
    found, fast = thesis.audit.conditions, thesis.designs.published[0]
    period, velocity, torque = found.period, 100.0 * found.velocity, 100.0 * found.torque
    runs = "keeps all limits" if fast.feasible else f"does not keep all limits ({', '.join(fast.doubts)})"
    return (
        f"<b>Why {period[1]:g}&nbsp;s?</b> The thesis says that the arm could perform the motion only in "
        f"{period[1]:g}&nbsp;s without reaching its limits. The catalogue's limits do not explain this: in "
        f"{period[0]:g}&nbsp;s the velocities reach {fixed(velocity[0], 1)}&nbsp;% of them, the torques that Table "
        f"4.1 predicts {fixed(torque[0], 0)}&nbsp;%, and the virtual arm {runs} in closed loop. In "
        f"{period[1]:g}&nbsp;s "
        f"it is {fixed(velocity[1], 1)}&nbsp;% and {fixed(torque[1], 0)}&nbsp;%. So the limit that was reached was "
        "lower than the catalogue's: if one of velocity, about "
        f"{fixed(velocity[1], 0)}&nbsp;% of it. The thesis does not name it; a safety configuration or the tracking "
        "error of a controller would have this effect."
    )


def _other_families(thesis: Thesis) -> str:
    """Text that compares other parameterisations of the trajectory with the Fourier series."""
    rows = thesis.designs.families
    best, exact = min(rows, key=lambda row: row.condition), min(rows, key=lambda row: row.corrected)
    filter_first = min(row.printed for row in rows) > max(row.corrected for row in rows)
    matters = ", more than those of any family with filtered columns" if filter_first else ""
    return (
        "<b>Another parameterisation?</b> The thesis asks whether one would be better. Each family below was "
        "searched with the same number of tries, without gradients; each motion begins and ends at rest in q = 0, "
        "takes "
        f"{DESIGNED:g}&nbsp;s and reaches a limit of position or velocity in every joint. The smallest condition "
        f"number has the {best.name} ({fixed(best.condition, 1)}), and the smallest torque error on Table A.2 with "
        f"filtered columns the {exact.name} ({short(exact.corrected, 2)}&nbsp;N·m). As printed, the errors are from "
        f"{fixed(min(row.printed for row in rows), 3)} to {fixed(max(row.printed for row in rows), 3)}&nbsp;N·m"
        f"{matters}. The descent with gradients, which only the Fourier series have here, reaches "
        f"{fixed(min(each.condition for each in thesis.designs.trials), 1)}."
    )


def _families(thesis: Thesis) -> Table:
    columns = [
        Column("parameterisation", words=True), Column("parameters"), Column("condition"),
        Column("columns of unit length"), Column("highest frequency", "Hz"), Column("A.2, as printed", "N·m"),
        Column("A.2, columns filtered", "N·m"),
    ]  # fmt: skip
    rows = [
        [
            TableCell(row.name),
            TableCell(str(row.unknowns), float(row.unknowns)),
            number(row.condition, fixed(row.condition, 1)),
            number(row.scaled, fixed(row.scaled, 2)),
            number(row.highest, fixed(row.highest, 2)),
            number(row.printed, fixed(row.printed, 3)),
            number(row.corrected, short(row.corrected, 2)),
        ]
        for row in thesis.designs.families
    ]
    note = (
        "Highest frequency: below it lies 99 % of the variance of each joint's velocity. A.2: RMS torque error of "
        "all joints there, against the truth; recordings follow the motion exactly."
    )
    return Table("families", "Parameterisations of the trajectory, best of a random search", columns, rows, note)


def _kept(thesis: Thesis) -> str:
    found = thesis.designs
    if found.kept < 0:
        return "None of the designs is feasible; Table A.1 in 27&nbsp;s is kept."
    best, used = found.best, found.published[-1]
    return (
        f"Kept: {best.name}, condition number {fixed(best.condition, 2)} against "
        f"{fixed(found.published[0].condition, 2)} of Table A.1 in 20&nbsp;s. The torque error on Table A.2 by "
        f"Algorithm 3 as printed is {short(best.printed.unseen)}&nbsp;N·m (Table A.1 in 27&nbsp;s: "
        f"{short(used.printed.unseen)}), with filtered columns {short(best.corrected.unseen)} "
        f"({short(used.corrected.unseen)}): the filter matters more than the motion{_otherwise(thesis)}. The "
        "remaining error comes from joints that stick briefly at reversals, where friction may have any value up to "
        "F<sub>s</sub>, which no law of the velocity describes: without rows below 0.05&nbsp;rad/s it is "
        f"{short(best.moving.unseen)} ({short(used.moving.unseen)})."
    )


def _otherwise(thesis: Thesis) -> str:
    """Text that names the trajectory with the smallest torque error for filtered columns.

    The text is empty if this trajectory is also the best one for Algorithm 3 as printed.
    """
    better = min((each for each in thesis.designs.trials if each.feasible), key=lambda each: each.corrected.unseen)
    if better is thesis.designs.best:
        return ""
    return f"; with filtered columns {better.name} would be kept ({short(better.corrected.unseen)}&nbsp;N·m)"


def joint_legend() -> tuple[tuple[str, str], ...]:
    """Legend of the plot of positions: role and symbol of the line of each joint."""
    return tuple((role, f"q{subscripts(f'_{j}')}") for j, role in enumerate(JOINTS, 1))


def positions(key: str, plan: Excitation) -> Plot:
    """Plot of the positions of all joints over one period; the lines differ in dash, symbol and colour."""
    motion = plan.sample(DRAWN_RATE)
    degrees = np.degrees(motion.q)
    traces: list[PlotTrace] = []
    for j, role in enumerate(JOINTS):
        name = f"q{subscripts(f'_{j + 1}')}"
        traces.append(line(role, motion.time, degrees[:, j], name))
        offset = (j + 0.5) / len(JOINTS) / SYMBOLS
        marked = ((np.arange(SYMBOLS) / SYMBOLS + offset) * motion.samples).astype(np.intp)
        traces.append(PlotTrace(role, motion.time[marked], degrees[marked, j], name, cloud=True))
    peaks = ", ".join(fixed(x, 0) for x in np.abs(degrees).max(axis=0))
    return Plot(key, "Joint positions.", f"largest angles {peaks}°", "time [s]", "position [°]", traces)


def _conditions(thesis: Thesis) -> Table:
    found = thesis.audit.conditions
    columns = [
        Column("period", "s"), Column("hanging"), Column("sign in print"), Column("columns of unit length"),
        Column("without friction"),
    ]  # fmt: skip
    rows = [
        [TableCell(f"{period:g}", float(period)), *(number(x, fixed(x, 2)) for x in values)]
        for period, *values in zip(
            found.period, found.hanging, found.literal, found.scaled, found.without_friction, strict=True
        )
    ]
    note = (
        "Rows at 100 Hz from t = 0 to one before the end. The printed number is that of unscaled columns for about "
        f"27 s. With all 84 columns, which (3.54) names, the condition number is {_infinite(found.every_column)}."
    )
    return Table("conditions", "Condition number of the stacked base regressor along Table A.1", columns, rows, note)


def _infinite(value: float) -> str:
    return "infinite" if not np.isfinite(value) or value > 1e12 else short(value)


def _trials(thesis: Thesis) -> Table:
    found = thesis.designs
    columns = [
        Column("trajectory", words=True), Column("condition at start"), Column("condition"),
        Column("share of limits: q"), Column("q̇"), Column("τ"), Column("tracking RMS", "mrad"),
        Column("clearance", "mm"), Column("runs", words=True), Column("A.2: as printed", "N·m"),
        Column("columns filtered", "N·m"), Column("slow rows left out, too", "N·m"), Column("base then off by", "%"),
    ]  # fmt: skip
    starts = [None] * len(found.published) + found.starts.tolist()
    rows = [
        _trial(each, start, each is found.best)
        for each, start in zip((*found.published, *found.trials), starts, strict=True)
    ]
    note = (
        "▲ kept. Shares of the limits of position, velocity and torque are the highest of the closed loop. "
        "Clearance: between bodies more than two joints apart. A.2: RMS torque error of all joints there, against "
        "the truth."
    )
    return Table("trials", "Trajectories in closed loop", columns, rows, note)


def _trial(each: DesignTrial, start: float | None, kept: bool) -> list[TableCell]:
    return [
        TableCell(each.name + (" ▲" if kept else "")),
        TableCell("–", "") if start is None else number(start, fixed(start, 1)),
        number(each.condition, fixed(each.condition, 2)),
        *(number(100.0 * x, f"{fixed(100.0 * x, 0)} %") for x in each.limits),
        number(1e3 * each.tracking, short(1e3 * each.tracking, 2)),
        number(1e3 * each.clearance, fixed(1e3 * each.clearance, 0)),
        TableCell("yes" if each.feasible else ", ".join(each.doubts), kind="" if each.feasible else "poor"),
        number(each.printed.unseen, fixed(each.printed.unseen, 3)),
        number(each.corrected.unseen, fixed(each.corrected.unseen, 3)),
        number(each.moving.unseen, fixed(each.moving.unseen, 4)),
        number(100.0 * each.moving.relative, fixed(100.0 * each.moving.relative, 3)),
    ]
