"""The report's pictures as figures of plotly, for notebooks: the same plots, drawn here and not by a page's script.

    from armid import load_run
    from armid.report.plots.figures import plot_torque

    plot_torque(load_run("runs/today"), joint="joint_2")

They need the extra `report`. Joints stand one below the other; `joint` asks for one of them, `theme` is `light` or
`dark`. Recordings of a run are read again; `data` is a folder in which they are looked for first. All of them raise
`MissingExtraError` where plotly is not installed and `ArmidError` where an argument is not what it should be, there
is no such joint, or no recording of a run can be read again.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from types import NoneType
from typing import TYPE_CHECKING, Any

import numpy as np

from armid.errors import ArmidError, did_you_mean
from armid.excitation.fourier import Excitation
from armid.excitation.limits.joint_limits import Limits, described_limits
from armid.excitation.plan import Plan
from armid.model.dynamics import DynamicsModel
from armid.model.terms import RigidBody
from armid.report.data.joint_names import heading_of, residual_title
from armid.report.data.page_data import PageData, with_evidence
from armid.report.plots.style import Theme, axes_of, colours, levels_of, resolved, trace_style
from armid.report.plots.traces import Plot
from armid.report.preflight_page import motion_section
from armid.report.rendering import require_extra
from armid.report.section import Section
from armid.report.sections.friction import show_friction
from armid.report.sections.residuals import show_residuals
from armid.report.sections.torque import show_torque
from armid.robot import Robot
from armid.runs.run import Run

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

__all__ = ["figure_of", "plot_friction", "plot_plan", "plot_residuals", "plot_torque"]

MOST_COLUMNS = 4
"""Plots beside each other; a notebook is about as wide as the report."""

ROW_HEIGHT = 260
"""Height of a row of plots with its titles [pixels]."""

BETWEEN_ROWS = 90
"""Of it the room for titles [pixels]."""

Rows = Sequence[tuple[str, Sequence[Plot]]]
"""A heading and its plots, row by row, as sections have them."""


def plot_torque(
    run: Run, *, joint: str | None = None, data: Path | str | None = None, theme: Theme = "light"
) -> Figure:
    """Torque measured and predicted over time, with the band that should hold 95 % of it."""
    return _of_run(run, show_torque, joint, data, theme)


def plot_residuals(
    run: Run, *, joint: str | None = None, data: Path | str | None = None, theme: Theme = "light"
) -> Figure:
    """Residuals over time, over velocity and in frequency."""
    return _of_run(run, show_residuals, joint, data, theme)


def plot_friction(
    run: Run, *, joint: str | None = None, data: Path | str | None = None, theme: Theme = "light"
) -> Figure:
    """Friction as it is seen and as the law says: over velocity, over position and around reversals.

    Raises:
        ArmidError: The model has no friction, or as said above.
    """
    return _of_run(run, show_friction, joint, data, theme)


def plot_plan(
    plan: Plan | Excitation,
    robot: Robot,
    *,
    limits: Limits | None = None,
    joint: str | None = None,
    theme: Theme = "light",
) -> Figure:
    """Position, velocity, acceleration and torque of the links along a plan, against limits.

    Args:
        plan: The plan, or the motion that it repeats.
        robot: The arm that moves; torque is shown where its description has inertias.
        limits: Of its joints; those of the description where not given.
        joint: Name of the one joint that is wanted.
        theme: `light` or `dark`.

    Raises:
        ArmidError: The plan is of another arm, or as said above.
    """
    require_extra("plotly")
    _require(plan, (Plan, Excitation), "A plan", 'load_plan("plan.json") of armid.excitation.fourier')
    _require(robot, (Robot,), "An arm", 'load_robot("arm.urdf")')
    _require(
        limits,
        (Limits, NoneType),
        "Limits of joints",
        "described_limits(robot) of armid.excitation.limits.joint_limits",
    )
    whole = Plan(plan) if isinstance(plan, Excitation) else plan
    if whole.excitation.n != robot.n:
        raise ArmidError(
            f"The plan moves {whole.excitation.n} joints; {robot.name} has {robot.n}.",
            remedy="give a plan of this arm.",
        )
    model = DynamicsModel(robot, (RigidBody(),))
    section = motion_section(whole, model, described_limits(robot) if limits is None else limits)
    return figure_of(_of_joint(section, joint, robot), theme=theme)


def figure_of(rows: Rows, *, theme: Theme = "light") -> Figure:
    """Plots of a section as one figure.

    Args:
        rows: Headings with their plots.
        theme: `light` or `dark`.

    Raises:
        ArmidError: There is no such theme.
    """
    from plotly.subplots import make_subplots

    palette = colours(theme)
    columns = min(MOST_COLUMNS, max(len(plots) for _, plots in rows))
    placed = _placed(rows, columns)
    lines = placed[-1][0]
    height = lines * ROW_HEIGHT + BETWEEN_ROWS
    figure = make_subplots(
        rows=lines,
        cols=columns,
        subplot_titles=_titles(placed, lines, columns),
        vertical_spacing=BETWEEN_ROWS / height if lines > 1 else 0.0,
        horizontal_spacing=0.22 / columns,
    )
    named: set[str] = set()
    groups: dict[str, str] = {}
    for row, column, _, plot in placed:
        for trace in plot.traces:
            look = resolved(trace_style(trace, np.asarray), palette)
            first = trace.role != "edge" and trace.name not in named
            named.add(trace.name if first else "")
            figure.add_trace({**look, "legendgroup": trace.name, "showlegend": first}, row=row, col=column)
        axes = resolved(axes_of(plot), palette)
        figure.update_xaxes(axes["xaxis"], row=row, col=column)
        figure.update_yaxes(axes["yaxis"], row=row, col=column)
        _tie(figure, plot, groups, row, column)
        for shape in resolved(levels_of(plot), palette):
            across = "xref" if "xref" in shape else "yref"
            figure.add_shape({**shape, across: f"{across[0]} domain"}, row=row, col=column)
    figure.update_annotations(font_size=12)
    figure.update_layout(**_frame(palette, height))
    return figure


def _of_run(
    run: Run,
    show: Callable[[PageData], Section | None],
    joint: str | None,
    data: Path | str | None,
    theme: Theme,
) -> Figure:
    """A section of a run's page as a figure."""
    require_extra("plotly")
    _require(run, (Run,), "A run", 'load_run("runs/today")')
    _require(data, (Path, str, NoneType), "A folder as data", 'a folder, "recordings"')
    material = with_evidence(run, data=data)
    if not material.drawn or (material.missing and data is not None):
        many = "Not all" if material.drawn else "None"
        raise ArmidError(
            f"{many} of the recordings of {run.folder} can be read again: {' '.join(material.missing)}",
            remedy="say with data=FOLDER where they are; without it, what is left is drawn.",
        )
    section = show(material)
    if section is None:  # with recordings at hand, of friction alone
        raise ArmidError(
            f"The model of {run.folder} has no friction.", remedy="identify with friction among its terms."
        )
    return figure_of(_of_joint(section, joint, run.robot), theme=theme)


def _require(value: object, kinds: tuple[type, ...], what: str, example: str) -> None:
    """Refuse what is of none of these kinds.

    Raises:
        ArmidError: It is not.
    """
    if not isinstance(value, kinds):
        shown = f"{value!r:.60}" if isinstance(value, str | int | float | Path) else f"a {type(value).__name__}"
        raise ArmidError(f"{what} must be given; found {shown}.", remedy=f"give it as a value: {example}.")


def _of_joint(section: Section, joint: str | None, robot: Robot) -> Rows:
    """The rows of a section, or what of them is about one joint: a row by its heading, a plot by its title.

    Raises:
        ArmidError: There is no such joint, or no plot of it.
    """
    if joint is None:
        return section.plots
    if joint not in robot.joint_names:
        known = robot.joint_names
        raise ArmidError(
            f"{robot.name} has no joint {joint!r}.", possible=", ".join(known), remedy=did_you_mean(joint, known)
        )
    wanted = heading_of(robot.joints, robot.joint_names.index(joint))
    titles = wanted, residual_title(wanted)
    kept = ((heading, plots if heading == wanted else [p for p in plots if p.title in titles])
            for heading, plots in section.plots)  # fmt: skip
    rows = [(heading, plots) for heading, plots in kept if plots]
    if not rows:
        drawn = [heading for heading, _ in section.plots]
        raise ArmidError(
            f"{section.title} has no plot of {joint}.", possible=", ".join(drawn), remedy="ask for these."
        )
    return rows


def _placed(rows: Rows, columns: int) -> list[tuple[int, int, str, Plot]]:
    """Row, column, heading and plot of each, headings with the first of theirs; rows and columns count from 1."""
    placed: list[tuple[int, int, str, Plot]] = []
    line = 0
    for heading, plots in rows:
        for k, plot in enumerate(plots):
            line += k % columns == 0
            placed.append((line, k % columns + 1, heading if k == 0 else "", plot))
    return placed


def _titles(placed: Sequence[tuple[int, int, str, Plot]], lines: int, columns: int) -> list[str]:
    """Titles of all places, row by row; empty where no plot is."""
    titles = [""] * (lines * columns)
    for row, column, heading, plot in placed:
        above = f"<b>{heading}</b><br>" if heading else ""
        titles[(row - 1) * columns + column - 1] = f"{above}{plot.title}"
    return titles


def _tie(figure: Any, plot: Plot, groups: dict[str, str], row: int, column: int) -> None:
    """Let plots of one group zoom together along the abscissa, as they do on a page."""
    if plot.group:
        own = figure.get_subplot(row, column).xaxis.plotly_name.replace("axis", "")
        figure.update_xaxes({"matches": groups.setdefault(plot.group, own)}, row=row, col=column)


def _frame(palette: dict[str, str], height: int) -> dict[str, Any]:
    """All of the layout but the axes."""
    return {
        "template": "none",
        "height": height,
        "margin": {"l": 60, "r": 20, "t": 60, "b": 80},
        "paper_bgcolor": palette["paper"],
        "plot_bgcolor": palette["paper"],
        "font": {"size": 11, "color": palette["soft"]},
        "hovermode": "closest",
        "legend": {"orientation": "h", "x": 0.0, "y": -60.0 / height, "yanchor": "top"},
    }
