"""Section 3.2 of the thesis step by step: Algorithm 3 as printed, then with one correction after another."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from armid.checked_array import Array
from armid.measurement.observations import Observations
from armid.measurement.processing.options import THESIS, ProcessingOptions
from armid.measurement.recording import Recording
from armid.thesis.algorithm import Errors, Fitted, by_method, errors_of, estimate, mean_of, observed, recorded
from armid.thesis.setting import PERIOD, Setting

CORRECTED = replace(THESIS, columns=True)
"""Processing of the thesis, with the filter of the torque also applied to the columns of the regressor."""

PADDED = replace(THESIS, edges="pad", average=False)
OWN = ProcessingOptions(edges="periodic", average=True)


@dataclass(frozen=True, slots=True)
class Step:
    """Row of the table of results: one variant of the identification.

    Attributes:
        group: Title of the group to which the row belongs.
        key: Unique name of the variant.
        title: Description of the variant.
        errors: Errors of the estimate, compared with the true parameters.
    """

    group: str
    key: str
    title: str
    errors: Errors


@dataclass(frozen=True, eq=False, slots=True)
class Spread:
    """Results of the main steps for several seeds of the noise.

    Attributes:
        seeds: Number of seeds.
        printed: Relative error, and torque error on Table A.2 of the thesis [N·m], of Algorithm 3 as printed, shape
            (seeds, 2).
        corrected: Errors as in `printed`, but with filtered columns, shape (seeds, 2).
        printed_ratio: Residual with the wrong sign of gravity divided by that with the right sign, for Algorithm 3 as
            printed, shape (seeds,).
        corrected_ratio: Ratio as in `printed_ratio`, but with filtered columns, shape (seeds,).
    """

    seeds: int
    printed: Array
    corrected: Array
    printed_ratio: Array
    corrected_ratio: Array


@dataclass(frozen=True, eq=False, slots=True)
class Estimates:
    """Estimates of section 3.2 of the thesis that later chapters use.

    Attributes:
        printed: Estimate by Algorithm 3 as printed: ordinary least squares, periodic edges.
        corrected: Estimate as in `printed`, but with filtered columns.
        wrong: Estimate with filtered columns and the printed sign of gravity.
        printed_physical: Estimate under the constraints (3.52) and (3.53) of the thesis; only the torque is filtered.
        corrected_physical: Estimate under the constraints (3.52) and (3.53); the columns are filtered, too.
        consistent: Physically consistent estimate with filtered columns.
    """

    printed: Fitted
    corrected: Fitted
    wrong: Fitted
    printed_physical: Fitted
    corrected_physical: Fitted
    consistent: Fitted


@dataclass(frozen=True, eq=False, slots=True)
class Steps:
    """Results of the identification steps of section 3.2 of the thesis, on the virtual arm.

    Attributes:
        rows: Results of the steps, one for each row of the table of results.
        spread: Results of the main steps for several seeds of the noise.
    """

    rows: tuple[Step, ...]
    spread: Spread


def steps(setting: Setting, tell: Callable[[float], None]) -> tuple[Steps, Estimates]:
    """Runs all identification steps of section 3.2 of the thesis, and the main steps for several noise seeds."""
    tell(0.0)
    recording = recorded(setting, seed=1)
    rows = _Rows(setting)
    _edges(rows, recording)
    tell(0.15)
    printed = rows.take("one-sided filter", "printed", "as printed, periodic edges", _periodic(setting, recording))
    _cutoffs(rows, recording)
    tell(0.3)
    corrected = _both_sides(rows, recording, printed)
    tell(0.4)
    estimates = _others(rows, recording, printed, corrected)
    tell(0.5)
    spread = _spread(setting, lambda share: tell(0.5 + 0.5 * share))
    tell(1.0)
    return Steps(tuple(rows.found), spread), estimates


class _Rows:
    """Builder of the table of results, to which each estimate adds a row."""

    def __init__(self, setting: Setting) -> None:
        self.setting = setting
        self.found: list[Step] = []

    def take(self, group: str, key: str, title: str, fitted: Fitted) -> Fitted:
        """Adds a row with the errors of an estimate to the table of results, and returns the estimate."""
        self.found.append(Step(group, key, title, errors_of(self.setting, fitted)))
        return fitted

    def run(
        self,
        group: str,
        key: str,
        title: str,
        recording: Recording,
        processing: ProcessingOptions,
        method: str = "ols",
    ) -> Fitted:
        """Processes a recording, estimates the parameters, and adds a row with the errors to the table of results."""
        period = None if processing.edges == "pad" else PERIOD
        observations = observed(self.setting, recording, processing, period)
        return self.take(group, key, title, estimate(self.setting.hanging, observations, method))


def _periodic(setting: Setting, recording: Recording) -> Fitted:
    return estimate(setting.hanging, observed(setting, recording, THESIS))


def _edges(rows: _Rows, recording: Recording) -> None:
    """Adds results for several treatments of the ends of the recording; the thesis does not state its treatment."""
    mean, group = mean_of(recording), "one-sided filter"
    rows.run(group, "printed-padded", "as printed, ends padded, 100 rows per second", mean, PADDED)
    every = replace(PADDED, decimate=0.0)
    rows.run(group, "printed-every-row", "the same with every row", mean, every)
    quiet = mean_of(recorded(rows.setting, seed=1, noise=False))
    rows.run(group, "printed-quiet", "the same without any noise, 100 rows", quiet, PADDED)
    rows.run(group, "printed-cropped", "as printed, 2 s left out at both ends", mean, replace(PADDED, trim=2.0))


def _cutoffs(rows: _Rows, recording: Recording) -> None:
    group = "one-sided filter"
    for cutoff in (5.0, 10.0):
        processing = replace(THESIS, cutoff=cutoff, motion_cutoff=cutoff)
        title = f"periodic edges, both cut-offs {cutoff:g} Hz"
        rows.run(group, f"printed-{cutoff:g}-hz", title, recording, processing)


def _both_sides(rows: _Rows, recording: Recording, printed: Fitted) -> Fitted:
    """Adds rows for estimates in which the filter of the torque is also applied to the columns of the regressor."""
    group, mean = "columns filtered too", mean_of(recording)
    padded = replace(PADDED, columns=True)
    rows.run(group, "columns-padded", "ends padded", mean, padded)
    observations = Observations(printed.observations.runs, CORRECTED.band)
    corrected = rows.take(group, "columns", "periodic edges", estimate(rows.setting.hanging, observations))
    rows.run(group, "columns-cropped", "ends padded, 2 s left out at both", mean, replace(padded, trim=2.0))
    return corrected


def _others(rows: _Rows, recording: Recording, printed: Fitted, corrected: Fitted) -> Estimates:
    """Adds results of variants: slow rows left out, joints weighted, printed sign of gravity, consistent links."""
    setting, group = rows.setting, "one-sided filter, other remedies"
    rows.run(group, "printed-fast", "rows below 0.1 rad/s left out", recording, replace(THESIS, slow=0.1))
    rows.take(group, "printed-weighted", "each joint weighted", by_method(printed, "wls"))
    rows.run("armid's own", "own", "5 Hz, order 4, weighted", recording, OWN, "wls")
    group = "gravity as printed"
    rows.take(group, "wrong-printed", "one-sided filter", estimate(setting.literal, printed.observations))
    wrong = rows.take(group, "wrong-columns", "columns filtered", estimate(setting.literal, corrected.observations))
    searches = {"starts": setting.extent.searches}
    bodies: list[Fitted] = []
    for fitted, name, group in (
        (printed, "printed", "bodies, one-sided filter"),
        (corrected, "columns", "bodies, columns filtered"),
    ):
        nlp = by_method(fitted, "thesis-nlp", searches)
        bodies.append(rows.take(group, f"{name}-nlp", "(3.52) with (3.53), interior point", nlp))
        # The description has the true bodies of the virtual arm, so a prior towards it would contain the solution.
        convex = by_method(fitted, "physical", {"prior": "mass"})
        bodies.append(rows.take(group, f"{name}-convex", "pseudo-inertias, convex", convex))
    return Estimates(printed, corrected, wrong, bodies[0], bodies[2], bodies[3])


def _spread(setting: Setting, tell: Callable[[float], None]) -> Spread:
    """Runs the main steps with both signs of gravity, for one seed of the noise after another."""
    seeds = setting.extent.seeds
    errors, ratios = np.zeros((2, seeds, 2)), np.zeros((2, seeds))
    for k in range(seeds):
        tell(k / seeds)
        observations = observed(setting, recorded(setting, seed=k + 1), THESIS)
        for which, band in enumerate((THESIS.band, CORRECTED.band)):
            same = Observations(observations.runs, band)
            right, wrong = (estimate(model, same) for model in (setting.hanging, setting.literal))
            found = errors_of(setting, right)
            errors[which, k] = found.relative, found.unseen
            ratios[which, k] = wrong.residual / right.residual
    return Spread(seeds, errors[0], errors[1], ratios[0], ratios[1])
