"""Printed tables of parameters: base parameters by joint, inertias of links, friction by joint."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from armid.estimation.estimate_record import Estimate
from armid.estimation.fit_result import POORLY_IDENTIFIED
from armid.estimation.friction.selection import FrictionSelection
from armid.estimation.link_properties import QUANTITIES, LinkProperties, LinkTable
from armid.estimation.standard_parameter_resolution import StandardFit
from armid.model.parameter_counts import by_joint, count_text
from armid.model.term_descriptions import friction_of_joint
from armid.notebook_display import interval_text
from armid.robot.robot import Robot

FEWEST_DECIMALS, MOST_DECIMALS = 3, 9

MIN_NAME_WIDTH = 12
"""Smallest width of a column of link names; longer names are folded [characters]."""

UNLIMITED_WIDTH = 1000
"""Width that no table exceeds; it is used to measure the natural width of a table [characters]."""

ORDER = (4, 6, 9, 5, 7, 8)
"""Indices of the inertias xx yy zz xy xz yz, in this order of printing, among the ten quantities of a body."""


PRIORS = {
    "log-det": "bodies near those of the description (log-det divergence)",
    "euclidean": "bodies near those of the description (Euclidean distance)",
    "mass": "the smallest bodies (mass and second moments)",
    "none": "none",
}
"""Description of each kind of prior."""


def folded_line(estimate: Estimate) -> str:
    """Line with the number of base parameters and the number of poorly identified base parameters."""
    names = estimate.fit.names
    poor = int(estimate.fit.poorly_identified.sum())
    note = f"; {poor} with a relative standard deviation above {POORLY_IDENTIFIED:g} %" if poor else ""
    return f"{len(names)} base parameters, {count_text(names)}, by {estimate.method}{note}"


def estimate_table(estimate: Estimate, joints: Sequence[str]) -> Table:
    """Table of base parameters with intervals, grouped by joint."""
    fit, ends = estimate.fit, estimate.intervals
    decimals = [_decimals(0.5 * (high - low)) for low, high in ends]
    table = Table(
        title=f"{estimate.robot}: {len(fit.names)} base parameters ({count_text(fit.names)}), {estimate.method}",
        caption=f"σ %: relative standard deviation. * above {POORLY_IDENTIFIED:g} %: poorly identified, or near zero",
        header_style="bold",
    )
    for name in ("parameter", "value", "unit", "σ %", "95 % interval"):
        table.add_column(name, justify="left" if name in ("parameter", "unit") else "right")
    units = dict(zip(estimate.base.names, estimate.base.units, strict=True))
    for number, indices in by_joint(fit.names).items():
        table.add_section()
        table.add_row(f"[bold]{number} {escape(joints[number - 1])}[/]")
        for k in indices:
            table.add_row(
                escape(fit.names[k]),
                f"{fit.values[k]:.{decimals[k]}f}",
                units[fit.names[k].of_all],
                f"{_percent(fit.relative_deviation[k])}{'*' if fit.poorly_identified[k] else ' '}",
                interval_text(*map(float, ends[k]), decimals=decimals[k]),
            )
    return table


def _decimals(half_width: float) -> int:
    """Number of decimals that show two digits of the half width, at least as many as in Table 4.1 of the thesis."""
    if not 0.0 < half_width < math.inf:
        return FEWEST_DECIMALS
    return min(max(FEWEST_DECIMALS, 1 - math.floor(math.log10(half_width))), MOST_DECIMALS)


def _percent(relative: float) -> str:
    """Text for a relative deviation [%]: two decimals; below 0.1 three significant digits; from 1000 on `> 999`."""
    if not relative < 1000.0:
        return "> 999"
    return f"{relative:.2f}" if relative >= 0.1 else f"{relative:.3g}"


def print_links(console: Console, table: LinkTable) -> None:
    """Prints estimated and described mass, centre of mass and inertia of each link; without values, the reason."""
    if table.note or not table.links:
        console.print(f"bodies of the links: {escape(table.note)}", highlight=False)
        return
    mass, inertia = (range(4), ("mass kg", "x m", "y m", "z m")), (ORDER, ("Ixx", "Iyy", "Izz", "Ixy", "Ixz", "Iyz"))
    title = "Bodies of the links: new (estimate) and old (description)"
    full_table = _bodies(table, (*mass[0], *inertia[0]), (*mass[1], *inertia[1]), title)
    if (
        console.measure(full_table, options=console.options.update(max_width=UNLIMITED_WIDTH)).maximum
        <= console.width
    ):
        console.print(full_table)
    else:
        console.print(_bodies(table, *mass, title))
        console.print(_bodies(table, *inertia, None))
    console.print(_links_note(table))


def _bodies(table: LinkTable, columns: Sequence[int], names: Sequence[str], title: str | None) -> Table:
    """Table of the chosen quantities, with an estimated and a described row for each link; long names are folded."""
    shown = Table(title=title, header_style="bold")
    shown.add_column("link", overflow="fold", min_width=MIN_NAME_WIDTH)
    shown.add_column("", no_wrap=True)
    for name in names:
        shown.add_column(name, justify="right", no_wrap=True)
    for body in table.links:
        known = np.isfinite(body.intervals).sum(axis=1) == 2
        digits = _digits(body)
        new = [f"{_plain(body.estimate[k], digits[k])}{'*' if known[k] else ' '}" for k in columns]
        shown.add_row(escape(body.link), "new", *new)
        if np.isfinite(body.description).any():
            old = [f"[dim]{_plain(body.description[k], digits[k])} [/]" for k in columns]
            shown.add_row("", "[dim]old[/]", *old)
    return shown


def _links_note(table: LinkTable) -> str:
    """Note below the table of links: meaning of the columns, and intervals of values that the torques determine."""
    lines = ["centre of mass x y z and axes in the link frame; inertia about the centre of mass, kg·m²"]
    short = ("mass", "x", "y", "z", *QUANTITIES[4:])
    for body in table.links:
        known = zip(short, body.intervals, strict=True)
        spans = ", ".join(
            f"{name} {interval_text(*map(float, ends), digits=3)}" for name, ends in known if np.isfinite(ends).all()
        )
        if spans:
            lines.append(f"* {escape(body.link)}, 95 %: {spans}")
    starred = len(lines) > 1
    others = "the other values depend" if starred else "these values depend"
    lines.append(f"{'* values that the torques determine; ' if starred else ''}{others} on the prior, too")
    return "\n".join(lines)


def _digits(body: LinkProperties) -> list[int]:
    """Number of decimals of each of the ten quantities of a link, one to six.

    The mass, the largest coordinate of the centre of mass and the largest inertia have three significant digits.
    """
    result = [0] * 10
    for kind in ((0,), (1, 2, 3), tuple(range(4, 10))):
        sizes = np.abs(np.concatenate([body.estimate[list(kind)], body.description[list(kind)]]))
        largest = float(np.max(sizes[np.isfinite(sizes)], initial=0.0))
        decimals = 3 if not largest > 0.0 else min(max(2 - math.floor(math.log10(largest)), 1), 6)
        for k in kind:
            result[k] = decimals
    return result


def _plain(value: float, decimals: int) -> str:
    return f"{round(value, decimals) + 0.0:.{decimals}f}" if math.isfinite(value) else "–"


def status_line(standard: StandardFit) -> str:
    """Line with the number of standard parameters of each status, and with the prior of the estimate."""
    kinds = ("identified", "prior-dominated", "not identifiable")
    counts = ", ".join(f"{standard.status.count(kind)} {kind}" for kind in kinds)
    prior = standard.prior
    weight = f", of weight {prior.weight:.3g} ({prior.how})" if prior.weight else ""
    return f"of {len(standard.names)} standard parameters {counts}; prior: {PRIORS[prior.kind]}{weight}"


def friction_selection_table(selection: FrictionSelection, robot: Robot) -> Table:
    """Table of the friction laws selected for each joint, with the ratio of the RMS errors with and without them."""
    table = Table(title="Friction selected on held-out blocks of the training motion", header_style="bold")
    table.add_column("#", justify="right")
    table.add_column("joint")
    table.add_column("RMS ratio, with / without", justify="right")
    table.add_column("added laws")
    for j, joint in enumerate(robot.joints):
        laws = friction_of_joint(selection.added, joint.name, prismatic=joint.kind == "prismatic")
        gain = f"{selection.ratio[j]:.2f} ± {selection.deviation[j]:.2f}"
        table.add_row(str(j + 1), escape(joint.name), gain if laws else "-", escape("\n".join(laws) or "none"))
    note = "± standard error between blocks; the selection used the same blocks, so the ratio is optimistic"
    table.caption = " ".join(filter(None, ((note + ".") if selection.evidence else "", selection.why)))
    table.caption_justify = "left"
    return table
