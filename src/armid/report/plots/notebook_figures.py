"""Plots of the report as plotly figures, for notebooks.

    from armid import load_run
    from armid.report.plots.notebook_figures import plot_torque

    plot_torque(load_run("runs/today"), joint="joint_2")

The functions need the extra `report`. Joints are drawn one below the other; `joint` selects one of them, and `theme`
is `light` or `dark`. The recordings of a run are read again; the folder `data` is searched first. All functions raise
`MissingExtraError` if plotly is not installed, and `ArmidError` if an argument has the wrong type, the joint does not
exist, or no recording of a run can be read.
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
from armid.model.dynamics_model import DynamicsModel
from armid.model.terms import RigidBody
from armid.report.data.joint_names import heading_of, residual_title
from armid.report.data.page_data import PageData, with_recordings
from armid.report.planned_motion import motion_section
from armid.report.plots.encoding import literal
from armid.report.plots.plot_specification import Plot
from armid.report.plots.style import Theme, axes_of, colours, levels_of, resolved, trace_style
from armid.report.rendering import require_extra
from armid.report.section import Section
from armid.report.sections.friction import show_friction
from armid.report.sections.residuals import show_residuals
from armid.report.sections.torque import show_torque
from armid.robot import Robot
from armid.runs.run import Run

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

MAX_COLUMNS = 4
"""Largest number of plots in a row; a notebook is about as wide as the report."""

ROW_HEIGHT = 260
"""Height of a row of plots with its titles [pixels]."""

BETWEEN_ROWS = 90
"""Height of the titles between two rows of plots, a part of `ROW_HEIGHT` [pixels]."""

Rows = Sequence[tuple[str, Sequence[Plot]]]
"""Heading and plots of each row, as in a section of a page."""


def plot_torque(
    run: Run, *, joint: str | None = None, data: Path | str | None = None, theme: Theme = "light"
) -> Figure:
    """Figure of measured and predicted torque over time, with the 95 % prediction interval."""
    return _of_run(run, show_torque, joint, data, theme)


def plot_residuals(
    run: Run, *, joint: str | None = None, data: Path | str | None = None, theme: Theme = "light"
) -> Figure:
    """Figure of the residuals of the torque over time, over velocity and in frequency."""
    return _of_run(run, show_residuals, joint, data, theme)


def plot_friction(
    run: Run, *, joint: str | None = None, data: Path | str | None = None, theme: Theme = "light"
) -> Figure:
    """Figure of measured friction and fitted law over velocity, over position and around reversals.

    Raises:
        ArmidError: The model has no friction; the docstring of this module lists further causes.
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
    """Figure of position, velocity, acceleration and torque along a plan, with limits.

    The torque is computed from the description.

    Args:
        plan: The plan, or only its excitation.
        robot: The arm that moves; torque is shown if its description has inertias.
        limits: Limits of the joints; by default the limits of the description.
        joint: Name of a joint, to plot only this one.
        theme: `light` or `dark`.

    Raises:
        ArmidError: The plan is for another arm; the docstring of this module lists further causes.
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
    full_plan = Plan(plan) if isinstance(plan, Excitation) else plan
    if full_plan.excitation.n != robot.n:
        raise ArmidError(
            f"The plan moves {full_plan.excitation.n} joints, but {robot.name} has {robot.n}.",
            remedy="give a plan for this arm.",
        )
    model = DynamicsModel(robot, (RigidBody(),))
    section = motion_section(full_plan, model, described_limits(robot) if limits is None else limits)
    return figure_of(_of_joint(section, joint, robot), theme=theme)


def figure_of(rows: Rows, *, theme: Theme = "light") -> Figure:
    """Plots of a section as one figure.

    Args:
        rows: Headings with their plots.
        theme: `light` or `dark`.

    Raises:
        ArmidError: The theme is unknown.
    """
    from plotly.subplots import make_subplots

    palette = colours(theme)
    columns = min(MAX_COLUMNS, max(len(plots) for _, plots in rows))
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
    in_legend: set[str] = set()
    groups: dict[str, str] = {}
    for row, column, _, plot in placed:
        for trace in plot.traces:
            style = resolved(trace_style(trace, np.asarray), palette)
            first = trace.name not in in_legend
            in_legend.add(trace.name if first else "")
            figure.add_trace({**style, "legendgroup": trace.name, "showlegend": first}, row=row, col=column)
        axes = resolved(axes_of(plot), palette)
        figure.update_xaxes(axes["xaxis"], row=row, col=column)
        figure.update_yaxes(axes["yaxis"], row=row, col=column)
        _link_zoom(figure, plot, groups, row, column)
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
    """Figure with the plots of one section of the page of a run, or with those of one joint."""
    require_extra("plotly")
    _require(run, (Run,), "A run", 'load_run("runs/today")')
    _require(data, (Path, str, NoneType), "A folder as data", 'a folder, "recordings"')
    page_data = with_recordings(run, data=data)
    if not page_data.drawn or (page_data.missing and data is not None):
        many = "Not all" if page_data.drawn else "None"
        raise ArmidError(
            f"{many} of the recordings of {run.folder} can be read: {' '.join(page_data.missing)}",
            remedy="give the folder of the recordings with data=FOLDER; without it, only the readable recordings "
            "are plotted.",
        )
    section = show(page_data)
    if section is None:  # only the section of friction can be empty here
        raise ArmidError(f"The model of {run.folder} has no friction.", remedy="identify again with friction terms.")
    return figure_of(_of_joint(section, joint, run.robot), theme=theme)


def _require(value: object, kinds: tuple[type, ...], what: str, example: str) -> None:
    """Checks that an argument has one of the given types.

    Raises:
        ArmidError: The value has none of these types.
    """
    if not isinstance(value, kinds):
        shown = f"{value!r:.60}" if isinstance(value, str | int | float | Path) else f"a {type(value).__name__}"
        raise ArmidError(f"{what} must be given; found {shown}.", remedy=f"give a value, for instance {example}.")


def _of_joint(section: Section, joint: str | None, robot: Robot) -> Rows:
    """Rows of plots of a section, or only the plots of one joint, found by the headings of rows and titles of plots.

    Raises:
        ArmidError: The joint does not exist, or the section has no plot of it.
    """
    if joint is None:
        return section.plots
    if joint not in robot.joint_names:
        known = robot.joint_names
        raise ArmidError(
            f"{robot.name} has no joint {joint!r}.", possible=", ".join(known), remedy=did_you_mean(joint, known)
        )
    title = heading_of(robot.joints, robot.joint_names.index(joint))
    titles = title, residual_title(title)
    selected = ((heading, plots if heading == title else [p for p in plots if p.title in titles])
            for heading, plots in section.plots)  # fmt: skip
    rows = [(heading, plots) for heading, plots in selected if plots]
    if not rows:
        drawn = [heading for heading, _ in section.plots]
        raise ArmidError(
            f"The section {section.title!r} has no plot of {joint}.",
            possible=", ".join(drawn),
            remedy="choose one of these joints.",
        )
    return rows


def _placed(rows: Rows, columns: int) -> list[tuple[int, int, str, Plot]]:
    """Row and column (from 1), heading and plot of each place; only the first plot of a row has a heading."""
    placed: list[tuple[int, int, str, Plot]] = []
    line = 0
    for heading, plots in rows:
        for k, plot in enumerate(plots):
            line += k % columns == 0
            placed.append((line, k % columns + 1, heading if k == 0 else "", plot))
    return placed


def _titles(placed: Sequence[tuple[int, int, str, Plot]], lines: int, columns: int) -> list[str]:
    """Titles of the places of a figure, row by row; the title of a place without a plot is empty."""
    titles = [""] * (lines * columns)
    for row, column, heading, plot in placed:
        above = f"<b>{literal(heading)}</b><br>" if heading else ""
        titles[(row - 1) * columns + column - 1] = f"{above}{literal(plot.title)}"
    return titles


def _link_zoom(figure: Any, plot: Plot, groups: dict[str, str], row: int, column: int) -> None:
    """Links the horizontal axes of the plots of a group, so that they zoom together as on a page."""
    if plot.group:
        axis = figure.get_subplot(row, column).xaxis.plotly_name.replace("axis", "")
        figure.update_xaxes({"matches": groups.setdefault(plot.group, axis)}, row=row, col=column)


def _frame(palette: dict[str, str], height: int) -> dict[str, Any]:
    """Layout of the figure, without axes."""
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
