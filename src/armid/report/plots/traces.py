"""Plots as plain data: traces with a role.

A role says what a trace is, never how it looks: that stands in `armid.report.plots.style`, and colours in the style
sheet, so that light, dark and paper, a page and a notebook show the same plot.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from armid.values import Array

__all__ = [
    "MOST_POINTS",
    "Axes",
    "Plot",
    "PlotTrace",
    "Sight",
    "binned",
    "crest",
    "envelope",
    "every",
    "line",
    "points",
    "spread",
]

LINE_BUCKETS = 700
"""Buckets of a line; each shows its smallest and largest value, twice what a plot is wide in pixels."""

MOST_POINTS = 800
"""Points of a cloud; more of them cover each other."""


@dataclass(frozen=True, eq=False, slots=True)
class PlotTrace:
    """One line or cloud.

    Attributes:
        role: What it is, for instance `measured`; the role has its look.
        x: Abscissas (K,).
        y: Ordinates (K,); NaN is a gap.
        name: What a pointer resting on it is told.
        cloud: Whether its points stand by themselves.
    """

    role: str
    x: Array
    y: Array
    name: str
    cloud: bool = False


SEEN = 0.995
"""Share of the values that a plot of residuals shows: a few spikes would flatten all the others."""

MOST, SPREAD = 0.95, 4.0
"""Share of the values whose largest, so many times, is shown at most: spikes that come each period are more than the
rest above."""

ROOM = 1.1
"""Room above what is shown."""

MOST_CUT = 60
"""Marks of values beyond a plot."""


@dataclass(frozen=True, slots=True)
class Axes:
    """Axes of a plot and what they show beside its traces.

    Attributes:
        logarithmic: Whether both are.
        levels: Ordinates of thin dotted lines.
        marks: Abscissas of thin dotted lines.
        span: Lowest and highest ordinate that are shown at first; all of them where not given.
    """

    logarithmic: bool = False
    levels: Sequence[float] = ()
    marks: Sequence[float] = ()
    span: tuple[float, float] | None = None


@dataclass(frozen=True, eq=False, slots=True)
class Plot:
    """A figure with its caption.

    Attributes:
        key: Name of it that no other plot of the page has.
        title: First words of the caption.
        caption: The rest of it, numbers included: what the plot says to who cannot see it.
        x: Title of the abscissa with its unit.
        y: Title of the ordinate with its unit.
        traces: What is drawn.
        group: Plots of one group zoom together along the abscissa.
        axes: What they show beside the traces.
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
class Sight:
    """Share of values about zero that a plot shows at first.

    Attributes:
        limit: Largest absolute value that is shown; infinite where all are.
        share: Share of the values beyond it.
        peak: Largest absolute value.
    """

    limit: float
    share: float
    peak: float

    @classmethod
    def of(cls, values: Array) -> Sight:
        """The sight of values of any shape: 99.5 % of them, fewer where spikes are many, all where none are."""
        size = np.abs(values[np.isfinite(values)])
        if not len(size):
            return cls(np.inf, 0.0, np.nan)
        peak = float(size.max())
        bulk, nearly_all = np.quantile(size, [MOST, SEEN], method="lower")
        limit = ROOM * float(min(nearly_all, SPREAD * bulk))
        if not 0.0 < ROOM * limit < peak:
            return cls(np.inf, 0.0, peak)
        return cls(limit, float(np.mean(size > limit)), peak)

    @property
    def span(self) -> tuple[float, float] | None:
        """Ends of the ordinate; `None` where all values are shown."""
        return (-ROOM * self.limit, ROOM * self.limit) if np.isfinite(self.limit) else None

    def cut(self, x: Array, y: Array, name: str) -> tuple[PlotTrace, ...]:
        """Marks at the edge where values (K,) at abscissas (K,) are cut; none where all are shown."""
        marks = (("above", y > self.limit, self.limit), ("below", y < -self.limit, -self.limit))
        return tuple(
            points(role, x[beyond], np.full(int(beyond.sum()), edge), f"{name}, beyond the picture", MOST_CUT)
            for role, beyond, edge in marks
            if beyond.any()
        )


def line(role: str, x: Array, y: Array, name: str) -> PlotTrace:
    """A line that keeps its extremes where it has more points than a plot can show."""
    kept = envelope(y, LINE_BUCKETS)
    return PlotTrace(role, x[kept], y[kept], name)


def points(role: str, x: Array, y: Array, name: str, most: int = MOST_POINTS) -> PlotTrace:
    """A cloud of points without what is not finite, thinned evenly."""
    known = np.flatnonzero(np.isfinite(x) & np.isfinite(y))
    kept = known[every(len(known), most)]
    return PlotTrace(role, x[kept], y[kept], name, cloud=True)


def spread(x: Array, low: Array, high: Array, name: str) -> tuple[PlotTrace, PlotTrace]:
    """A band between two lines, widest where it is thinned."""
    kept = np.union1d(envelope(low, LINE_BUCKETS // 2), envelope(high, LINE_BUCKETS // 2))
    return PlotTrace("edge", x[kept], low[kept], name), PlotTrace("band", x[kept], high[kept], name)


def crest(role: str, x: Array, y: Array, name: str) -> PlotTrace:
    """A line on logarithmic axes: the largest value of each of many buckets that are alike on such an axis."""
    starts = np.unique(np.geomspace(1, len(y), LINE_BUCKETS).astype(np.intp)) - 1
    stops = [*starts[1:], len(y)]
    height = np.where(np.isfinite(y), y, -np.inf)
    kept = np.array([a + int(np.argmax(height[a:b])) for a, b in zip(starts, stops, strict=True)])
    return PlotTrace(role, x[kept], y[kept], name)


def envelope(y: Array, buckets: int) -> NDArray[np.intp]:
    """Indices of the smallest and largest value of each bucket, in order; all where there are few. Gaps are kept."""
    if len(y) <= 2 * buckets:
        return np.arange(len(y))
    edges = np.linspace(0, len(y), buckets + 1).astype(np.intp)
    known = np.isfinite(y)
    low = np.where(known, y, np.inf)
    high = np.where(known, y, -np.inf)
    kept = [0, len(y) - 1]
    for start, stop in pairwise(edges):
        kept += [start + int(np.argmin(low[start:stop])), start + int(np.argmax(high[start:stop]))]
        gap = int(np.argmin(known[start:stop]))
        if not known[start + gap]:
            kept.append(start + gap)
    return np.unique(np.array(kept, dtype=np.intp))


def every(count: int, most: int) -> NDArray[np.intp]:
    """Indices of at most so many of a number of points, evenly spread."""
    return np.linspace(0, count - 1, min(count, most)).astype(np.intp)


def binned(x: Array, y: Array, edges: Array, fewest: int) -> tuple[Array, Array, NDArray[np.intp]]:
    """Mean of x and of y in each bin and how many points it has; NaN in a bin of fewer than `fewest`."""
    known = np.isfinite(x) & np.isfinite(y)
    x, y = x[known], y[known]
    index = np.clip(np.digitize(x, edges) - 1, 0, len(edges) - 2)
    inside = (x >= edges[0]) & (x <= edges[-1])
    count = np.bincount(index[inside], minlength=len(edges) - 1)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = [np.bincount(index[inside], v[inside], len(edges) - 1) / count for v in (x, y)]
    mean = [np.where(count < fewest, np.nan, v) for v in mean]
    return mean[0], mean[1], count
