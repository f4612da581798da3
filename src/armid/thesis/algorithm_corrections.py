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
from armid.thesis.experiments.motion_variants import Slower, slower
from armid.thesis.experiments.residual_causes import CauseSearch, causes
from armid.thesis.setting import PERIOD, Setting

ONE_SIDED = "one-sided filter, right sign"
"""Title of the group of results with the right sign of gravity and the filter on the torque only."""

CORRECTED = replace(THESIS, columns=True)
"""Processing of the thesis, with the filter of the torque also applied to the columns of the regressor."""

PADDED = replace(THESIS, edges="pad", average=False)
PRINTED = replace(PADDED, decimate=0.0)
"""Processing of Algorithm 3 as printed: every sample is a row, and the ends are padded, as zero-phase filters do by
default. It is applied to the mean of the repetitions."""

HOLDING = {"com": 1.0}
"""Option of the estimator `thesis-nlp`: bound of the coordinates of a centre of mass [m]. With it, Table 4.2 fulfils
the bounds (3.52b) of the thesis; its centres of mass are up to 0.823 m away from the origins of their frames."""

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
        one_sided: Relative error, and torque error on Table A.2 of the thesis [N·m], with the right sign of gravity
            and the filter on the torque only, shape (seeds, 2).
        corrected: Errors as in `one_sided`, but with filtered columns, shape (seeds, 2).
        one_sided_ratio: Residual with the wrong sign of gravity divided by that with the right sign, with the filter
            on the torque only, shape (seeds,).
        corrected_ratio: Ratio as in `one_sided_ratio`, but with filtered columns, shape (seeds,).
    """

    seeds: int
    one_sided: Array
    corrected: Array
    one_sided_ratio: Array
    corrected_ratio: Array


@dataclass(frozen=True, eq=False, slots=True)
class Estimates:
    """Estimates of section 3.2 of the thesis that later chapters use.

    Attributes:
        printed: Estimate by Algorithm 3 as printed: printed sign of gravity, filter on the torque only, every sample
            a row, padded ends, ordinary least squares.
        one_sided: Estimate as in `printed`, but with the right sign of gravity.
        corrected: Estimate with the right sign of gravity, filtered columns and periodic edges.
        wrong: Estimate with filtered columns and the printed sign of gravity.
        printed_physical: Estimate as in `printed`, under the constraints (3.52) and (3.53) of the thesis.
        corrected_physical: Estimate as in `corrected`, under the constraints (3.52) and (3.53).
        consistent: Physically consistent estimate with filtered columns.
    """

    printed: Fitted
    one_sided: Fitted
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
        search: Result of the search for causes of the residual that the thesis itself has.
        slower: Torque errors along the motion of Table A.2, executed in longer periods.
    """

    rows: tuple[Step, ...]
    spread: Spread
    search: CauseSearch
    slower: Slower


def steps(setting: Setting, tell: Callable[[float], None]) -> tuple[Steps, Estimates]:
    """Runs all identification steps of section 3.2 of the thesis, and the main steps for several noise seeds.

    `tell` is called with the share of the work that is done, from 0 to 1.
    """
    tell(0.0)
    recording = recorded(setting, seed=1)
    rows = _Rows(setting)
    printed = _as_printed(rows, recording)
    tell(0.1)
    one_sided = _edges(rows, recording)
    tell(0.2)
    periodic = rows.take(ONE_SIDED, "one-sided", "periodic edges", _periodic(setting, recording))
    _cutoffs(rows, recording)
    tell(0.25)
    corrected = _both_sides(rows, recording, periodic)
    tell(0.3)
    _others(rows, recording, periodic)
    wrong = _signs(rows, periodic, corrected)
    bodies = _bodies(rows, printed, periodic, corrected)
    tell(0.4)
    search = causes(setting, PRINTED, lambda share: tell(0.4 + 0.25 * share))
    slow = slower(setting, printed, periodic, corrected)
    spread = _spread(setting, lambda share: tell(0.65 + 0.35 * share))
    tell(1.0)
    estimates = Estimates(printed, one_sided, corrected, wrong, bodies[0], bodies[4], bodies[5])
    return Steps(tuple(rows.found), spread, search, slow), estimates


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


def _as_printed(rows: _Rows, recording: Recording) -> Fitted:
    """Adds rows for Algorithm 3 as printed, with two treatments of the ends of the recording.

    The thesis does not state its treatment of the ends. The returned estimate is the one for padded ends.
    """
    setting, group = rows.setting, "as printed"
    mean = mean_of(recording)
    fitted = estimate(setting.literal, observed(setting, mean, PRINTED, None))
    rows.take(group, "printed", "sign in print, every row, ends padded", fitted)
    cropped = estimate(setting.literal, observed(setting, mean, replace(PRINTED, trim=2.0), None))
    rows.take(group, "printed-cropped", "the same, 2 s left out at both ends", cropped)
    return fitted


def _edges(rows: _Rows, recording: Recording) -> Fitted:
    """Adds rows for estimates with the right sign of gravity and several treatments of the ends of the recording."""
    mean, group = mean_of(recording), ONE_SIDED
    fitted = rows.run(group, "one-sided-every-row", "every row, ends padded", mean, PRINTED)
    rows.run(group, "one-sided-padded", "100 rows per second, ends padded", mean, PADDED)
    quiet = mean_of(recorded(rows.setting, seed=1, noise=False))
    rows.run(group, "one-sided-quiet", "the same without any noise", quiet, PADDED)
    rows.run(
        group, "one-sided-cropped", "the same with noise, 2 s left out at both ends", mean, replace(PADDED, trim=2.0)
    )
    return fitted


def _cutoffs(rows: _Rows, recording: Recording) -> None:
    for cutoff in (5.0, 10.0):
        processing = replace(THESIS, cutoff=cutoff, motion_cutoff=cutoff)
        title = f"periodic edges, both cut-offs {cutoff:g} Hz"
        rows.run(ONE_SIDED, f"one-sided-{cutoff:g}-hz", title, recording, processing)


def _both_sides(rows: _Rows, recording: Recording, periodic: Fitted) -> Fitted:
    """Adds rows for estimates in which the filter of the torque is also applied to the columns of the regressor."""
    group, mean = "columns filtered too", mean_of(recording)
    padded = replace(PADDED, columns=True)
    rows.run(group, "columns-padded", "ends padded", mean, padded)
    observations = Observations(periodic.observations.runs, CORRECTED.band)
    corrected = rows.take(group, "columns", "periodic edges", estimate(rows.setting.hanging, observations))
    rows.run(group, "columns-cropped", "ends padded, 2 s left out at both", mean, replace(padded, trim=2.0))
    return corrected


def _others(rows: _Rows, recording: Recording, periodic: Fitted) -> None:
    """Adds rows for variants: slow rows left out, joints weighted, and the processing `OWN` of armid."""
    group = "one-sided filter, other remedies"
    rows.run(group, "one-sided-fast", "rows below 0.1 rad/s left out", recording, replace(THESIS, slow=0.1))
    rows.take(group, "one-sided-weighted", "each joint weighted", by_method(periodic, "wls"))
    rows.run("armid's own", "own", "5 Hz, order 4, weighted", recording, OWN, "wls")


def _signs(rows: _Rows, periodic: Fitted, corrected: Fitted) -> Fitted:
    """Adds rows for the printed sign of gravity; returns the estimate with this sign and filtered columns."""
    setting, group = rows.setting, "sign of gravity in print"
    rows.take(group, "wrong-one-sided", "one-sided filter", estimate(setting.literal, periodic.observations))
    return rows.take(group, "wrong-columns", "columns filtered", estimate(setting.literal, corrected.observations))


def _bodies(rows: _Rows, *estimates: Fitted) -> list[Fitted]:
    """Adds rows for physical parameters: estimated as printed, with one-sided filter, and with filtered columns."""
    options = {"starts": rows.setting.extent.searches, **HOLDING}
    kinds = (
        ("printed", "bodies, as printed"),
        ("one-sided", "bodies, one-sided filter"),
        ("columns", "bodies, columns filtered"),
    )
    bodies: list[Fitted] = []
    for fitted, (name, group) in zip(estimates, kinds, strict=True):
        nlp = by_method(fitted, "thesis-nlp", options)
        bodies.append(rows.take(group, f"{name}-nlp", "(3.52) with (3.53), interior point", nlp))
        # The description has the true bodies of the virtual arm, so a prior towards it would contain the solution.
        convex = by_method(fitted, "physical", {"prior": "mass"})
        bodies.append(rows.take(group, f"{name}-convex", "pseudo-inertias, convex", convex))
    return bodies


def _spread(setting: Setting, tell: Callable[[float], None]) -> Spread:
    """Runs the main steps with both signs of gravity, for each of several seeds of the noise.

    `tell` is called with the share of the work that is done, from 0 to 1.
    """
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
