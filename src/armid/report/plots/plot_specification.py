"""Plots as plain data: lines and points (traces), each with a role.

A role is the meaning of a trace. The style of a role is in `armid.report.plots.style`, and its colour is in the style
sheet. Pages and notebooks therefore show the same plot, in light and dark mode and on paper.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array

LINE_INTERVALS = 700
"""Number of intervals into which the samples of a line are divided, sufficient for the width of a plot. The drawn
line contains the smallest and the largest value of each interval."""

MAX_POINTS = 800
"""Largest number of separate points in a plot; more points would cover each other."""


@dataclass(frozen=True, eq=False, slots=True)
class PlotTrace:
    """Line or separate points of a plot.

    Attributes:
        role: Meaning of the trace, for instance `measured`; it determines the style.
        x: Abscissas (K,).
        y: Ordinates (K,); NaN is a gap.
        name: Name that is shown when the pointer rests on the line or on a point.
        cloud: True if the points are drawn separately, false if a line joins them.
    """

    role: str
    x: Array
    y: Array
    name: str
    cloud: bool = False


VISIBLE_SHARE = 0.995
"""Share of the residuals that are inside the range of their plot; a few larger ones would flatten the curves."""

BULK_SHARE, BULK_FACTOR = 0.95, 4.0
"""Probability of a quantile of the absolute values, and factor by which the range of a plot may exceed this quantile.
The factor limits the range of a plot with spikes in each period, for which `VISIBLE_SHARE` alone is too large."""

RANGE_MARGIN = 1.1
"""Ratio of the end of the axis to the largest visible value."""

MAX_CLIPPED = 60
"""Largest number of marks at one edge of a plot for values outside it."""


@dataclass(frozen=True, slots=True)
class Axes:
    """Axes of a plot, with level lines and range.

    Attributes:
        logarithmic: True if both axes are logarithmic.
        levels: Ordinates of thin dotted lines.
        marks: Abscissas of thin dotted lines.
        span: Lowest and highest ordinate of the initial view; by default the extremes of all values.
    """

    logarithmic: bool = False
    levels: Sequence[float] = ()
    marks: Sequence[float] = ()
    span: tuple[float, float] | None = None


@dataclass(frozen=True, eq=False, slots=True)
class Plot:
    """Plot with its caption.

    Attributes:
        key: Name that is unique on the page.
        title: First words of the caption.
        caption: Rest of the caption, with the main numbers for readers who cannot see the plot.
        x: Title of the abscissa with its unit.
        y: Title of the ordinate with its unit.
        traces: Lines and points.
        group: Name of a group; the plots of a group zoom together along the abscissa.
        axes: Level lines and range.
    """

    key: str
    title: str
    caption: str
    x: str
    y: str
    traces: Sequence[PlotTrace]
    group: str = ""
    axes: Axes = Axes()


@dataclass(frozen=True, slots=True)
class PlotRange:
    """Symmetric range of the initial view of a plot, which leaves out rare spikes.

    Attributes:
        limit: Largest absolute value inside the range; infinite if all values are inside.
        share: Share of the values outside the range.
        peak: Largest absolute value.
    """

    limit: float
    share: float
    peak: float

    @classmethod
    def of(cls, values: Array) -> PlotRange:
        """Range of a plot for values of any shape.

        The range contains all values if there are no spikes, 99.5 % of the values if there are few spikes, and fewer
        values if there are many spikes.
        """
        size = np.abs(values[np.isfinite(values)])
        if not len(size):
            return cls(np.inf, 0.0, np.nan)
        peak = float(size.max())
        bulk, nearly_all = np.quantile(size, [BULK_SHARE, VISIBLE_SHARE], method="lower")
        limit = RANGE_MARGIN * float(min(nearly_all, BULK_FACTOR * bulk))
        if not 0.0 < RANGE_MARGIN * limit < peak:
            return cls(np.inf, 0.0, peak)
        return cls(limit, float(np.mean(size > limit)), peak)

    @property
    def span(self) -> tuple[float, float] | None:
        """Lowest and highest ordinate of the initial view; `None` if all values are inside the range."""
        return (-RANGE_MARGIN * self.limit, RANGE_MARGIN * self.limit) if np.isfinite(self.limit) else None

    def cut(self, x: Array, y: Array, name: str) -> tuple[PlotTrace, ...]:
        """Marks at the upper or lower edge of the plot for values outside the range; empty if all are inside.

        Args:
            x: Abscissas, shape (K,).
            y: Values, shape (K,).
            name: Name of the curve in the legend.
        """
        marks = (("above", y > self.limit, self.limit), ("below", y < -self.limit, -self.limit))
        return tuple(
            points(role, x[beyond], np.full(int(beyond.sum()), edge), f"{name}, outside the plot", MAX_CLIPPED)
            for role, beyond, edge in marks
            if beyond.any()
        )


def line(role: str, x: Array, y: Array, name: str) -> PlotTrace:
    """Line reduced to about as many points as a plot can show; the extremes are retained."""
    indices = envelope(y, LINE_INTERVALS)
    return PlotTrace(role, x[indices], y[indices], name)


def points(role: str, x: Array, y: Array, name: str, most: int = MAX_POINTS) -> PlotTrace:
    """Separate points where both coordinates are finite; at most `most` points, selected uniformly."""
    known = np.flatnonzero(np.isfinite(x) & np.isfinite(y))
    indices = known[every(len(known), most)]
    return PlotTrace(role, x[indices], y[indices], name, cloud=True)


def spread(x: Array, low: Array, high: Array, name: str) -> PlotTrace:
    """Area between two lines: a polygon for each segment without gaps, reduced to few points with the extremes."""
    known = np.isfinite(x) & np.isfinite(low) & np.isfinite(high)
    ends = np.flatnonzero(np.diff(known, prepend=False, append=False)).reshape(-1, 2)
    sides: list[tuple[Array, Array]] = []
    for start, stop in ends:
        most = max(2, (LINE_INTERVALS // 2) * (stop - start) // int(known.sum()))
        at = start + np.union1d(envelope(low[start:stop], most), envelope(high[start:stop], most))
        sides.append(
            (np.concatenate([x[at], x[at][::-1], [np.nan]]), np.concatenate([low[at], high[at][::-1], [np.nan]]))
        )
    xs, ys = zip(*sides, strict=True) if sides else ((), ())
    return PlotTrace("band", np.concatenate([*xs, []]), np.concatenate([*ys, []]), name)


def crest(role: str, x: Array, y: Array, name: str) -> PlotTrace:
    """Line for logarithmic axes: the largest value in each of many logarithmically spaced intervals of x."""
    starts = np.unique(np.geomspace(1, len(y), LINE_INTERVALS).astype(np.intp)) - 1
    stops = [*starts[1:], len(y)]
    height = np.where(np.isfinite(y), y, -np.inf)
    indices = np.array([a + int(np.argmax(height[a:b])) for a, b in zip(starts, stops, strict=True)])
    return PlotTrace(role, x[indices], y[indices], name)


def envelope(y: Array, buckets: int) -> NDArray[np.intp]:
    """Sorted indices of gaps, and of the smallest and largest value in each of `buckets` intervals of the rows."""
    if len(y) <= 2 * buckets:
        return np.arange(len(y))
    edges = np.linspace(0, len(y), buckets + 1).astype(np.intp)
    starts, stops = edges[:-1, None], edges[1:, None]
    at = np.minimum(starts + np.arange((stops - starts).max()), stops - 1)  # short intervals repeat their last point
    values = y[at]
    known = np.isfinite(values)
    smallest = np.where(known, values, np.inf).argmin(axis=1)
    largest = np.where(known, values, -np.inf).argmax(axis=1)
    row, gap = np.arange(buckets), known.argmin(axis=1)
    gap = np.where(known[row, gap], smallest, gap)
    return np.unique(np.concatenate([[0, len(y) - 1], at[row, smallest], at[row, largest], at[row, gap]]))


def every(count: int, most: int) -> NDArray[np.intp]:
    """Uniformly spaced indices of at most `most` of `count` points."""
    return np.linspace(0, count - 1, min(count, most)).astype(np.intp)


def binned(x: Array, y: Array, edges: Array, fewest: int) -> tuple[Array, Array, NDArray[np.intp]]:
    """Mean of x, mean of y and number of points in each of B bins of x, shape (B,); the bins have B + 1 edges.

    Means of fewer than `fewest` points are NaN.
    """
    known = np.isfinite(x) & np.isfinite(y)
    x, y = x[known], y[known]
    index = np.clip(np.digitize(x, edges) - 1, 0, len(edges) - 2)
    inside = (x >= edges[0]) & (x <= edges[-1])
    count = np.bincount(index[inside], minlength=len(edges) - 1)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = [np.bincount(index[inside], v[inside], len(edges) - 1) / count for v in (x, y)]
    mean = [np.where(count < fewest, np.nan, v) for v in mean]
    return mean[0], mean[1], count
