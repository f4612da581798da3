"""Style of plots for pages and notebooks: colour, dash and symbol of each role, axes, levels.

A style is the part of plotly's JSON that pages and notebooks share. Colours are names from `theme.css`, written
`--blue`; a page resolves them by the light or dark mode of the system, a notebook by `resolved`.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from typing import Any, Literal, get_args

from armid.checked_array import Array
from armid.errors import ArmidError, did_you_mean
from armid.report.plots.encoding import literal, packed
from armid.report.plots.plot_specification import Plot, PlotTrace
from armid.report.rendering import text_of

Theme = Literal["light", "dark"]

Line = tuple[str, float, str]
"""Colour, width and dash of a line."""

LINES: Mapping[str, Line] = {
    "measured": ("ink", 1.3, "solid"),
    "predicted": ("blue", 1.7, "6px,3px"),
    "recorded": ("grey", 1.0, "2px,2px"),
    "training": ("blue", 1.1, "solid"),
    "validation": ("orange", 1.1, "solid"),
    "single": ("grey", 0.6, "solid"),
    "mean": ("ink", 2.0, "solid"),
    "law": ("orange", 2.4, "7px,3px"),
    "physical": ("orange", 1.5, "2px,3px"),
    "joint-1": ("joint-1", 1.6, "solid"),
    "joint-2": ("joint-2", 1.6, "9px,3px"),
    "joint-3": ("joint-3", 1.6, "2px,3px"),
    "joint-4": ("joint-4", 1.6, "9px,3px,2px,3px"),
    "joint-5": ("joint-5", 1.6, "5px,2px"),
    "joint-6": ("joint-6", 1.6, "14px,4px"),
    "joint-7": ("joint-7", 1.6, "6px,2px,1px,2px,1px,2px"),
    "limit": ("orange", 1.4, "5px,3px"),
}
"""Style of the line of each role; the styles differ in colour and in dash."""

MARKED = ("mean",)
"""Roles whose lines have a mark at each point."""

CLOUDS: Mapping[str, tuple[str, str, int]] = {
    "training": ("blue", "circle-open", 4),
    "validation": ("orange", "x-thin-open", 4),
    "above": ("near", "triangle-up", 6),
    "below": ("near", "triangle-down", 6),
    "forward": ("blue", "triangle-up", 4),
    "backward": ("orange", "triangle-down-open", 4),
    "joint-1": ("joint-1", "circle", 7),
    "joint-2": ("joint-2", "square", 7),
    "joint-3": ("joint-3", "diamond", 8),
    "joint-4": ("joint-4", "cross-thin-open", 9),
    "joint-5": ("joint-5", "triangle-up", 8),
    "joint-6": ("joint-6", "x-thin-open", 8),
    "joint-7": ("joint-7", "triangle-down", 8),
}
"""Style of the separate points of each role: colour, symbol and size [px]."""

DENSE_SIZE = 4
"""Largest size [px] of points that are drawn half transparent, so that regions with many points are darker."""

RULED = {"gridcolor": "--grid", "linecolor": "--rule", "zerolinecolor": "--rule", "tickcolor": "--rule"}


def plot_record(plot: Plot) -> dict[str, Any]:
    """Plot as plotly JSON for the script of the page: group, traces and axes; colours are given by name."""
    return {
        "group": plot.group,
        "data": [trace_style(trace, packed) for trace in plot.traces],
        "layout": {**axes_of(plot), "shapes": levels_of(plot)},
    }


def trace_style(trace: PlotTrace, numbers: Callable[[Array], Any]) -> dict[str, Any]:
    """Line or points as plotly JSON; colours are given by name.

    Args:
        trace: The trace.
        numbers: Function that converts coordinates to the form that the page or the notebook needs.
    """
    record: dict[str, Any] = {
        "type": "scatter",
        "x": numbers(trace.x),
        "y": numbers(trace.y),
        "name": literal(trace.name),
        "hovertemplate": "%{y:.4g} at %{x:.4g}<extra>" + literal(trace.name) + "</extra>",
    }
    if trace.role == "band":
        del record["hovertemplate"]
        fill = {"fill": "toself", "fillcolor": "--band"}
        return {**record, "mode": "lines", "line": {"width": 0}, "hoverinfo": "skip", **fill}
    if trace.cloud:
        colour, symbol, size = CLOUDS[trace.role]
        dense = size <= DENSE_SIZE
        edge = {"width": 1 if dense else 2, "color": f"--{colour}"}
        marker = {
            "color": f"--{colour}",
            "symbol": symbol,
            "size": size,
            "opacity": 0.55 if dense else 1,
            "line": edge,
        }
        return {**record, "mode": "markers", "marker": marker}
    colour, width, dash = LINES[trace.role]
    record["line"] = {"color": f"--{colour}", "width": width, "dash": dash}
    if trace.role not in MARKED:
        return {**record, "mode": "lines"}
    return {**record, "mode": "lines+markers", "marker": {"color": f"--{colour}", "symbol": "circle", "size": 4}}


def axes_of(plot: Plot) -> dict[str, Any]:
    """Both axes of a plot as plotly JSON."""
    log, span = plot.axes.logarithmic, plot.axes.span

    def axis(title: str, ticks: dict[str, Any]) -> dict[str, Any]:
        return {
            "title": {"text": title, "standoff": 4},
            "type": "log" if log else "linear",
            "exponentformat": "power",
            "ticks": "outside",
            "tickangle": 0,
            "ticklen": 3,
            **RULED,
            **ticks,
        }

    default_ticks = {"nticks": 5 if log else 7}
    shown = {} if span is None else {"range": [float(end) for end in span]}
    return {
        "xaxis": axis(plot.x, {"dtick": 1} if log else default_ticks),
        "yaxis": axis(plot.y, {**default_ticks, **shown}),
    }


def levels_of(plot: Plot) -> list[dict[str, Any]]:
    """Thin dotted lines of a plot at given ordinates and abscissas, as plotly shapes."""
    dotted = {"type": "line", "layer": "below", "line": {"color": "--soft", "width": 1, "dash": "1px,3px"}}
    across = [{**dotted, "xref": "paper", "x0": 0, "x1": 1, "y0": float(y), "y1": float(y)} for y in plot.axes.levels]
    upright = [{**dotted, "yref": "paper", "y0": 0, "y1": 1, "x0": float(x), "x1": float(x)} for x in plot.axes.marks]
    return [*across, *upright]


def colours(theme: Theme) -> dict[str, str]:
    """Colour values of a theme from `theme.css`, by the names of the colours.

    Raises:
        ArmidError: The theme is unknown.
    """
    blocks = re.findall(r":root[^{]*{(.*?)}", text_of("theme.css"), re.DOTALL)
    themes = dict(zip(get_args(Theme), blocks, strict=True))
    if theme not in list(themes):
        raise ArmidError(f"Unknown theme {theme!r}.", possible=", ".join(themes), remedy=did_you_mean(theme, themes))
    return dict(re.findall(r"--([\w-]+):\s*([^;]+);", themes[theme]))


def resolved(style: Any, palette: Mapping[str, str]) -> Any:
    """Replaces names of colours in a style by the colours of a palette."""
    if isinstance(style, dict):
        return {key: resolved(value, palette) for key, value in style.items()}
    if isinstance(style, list):
        return [resolved(each, palette) for each in style]
    return palette[style[2:]] if isinstance(style, str) and style.startswith("--") else style
