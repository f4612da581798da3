"""Chapter 4: parameter tables in the thesis's form; measured and predicted torque and their difference."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armid.information.filtering import filtered_torque, in_band
from armid.thesis.algorithm import TEST_RATE, Fitted
from armid.thesis.algorithm_corrections import Estimates
from armid.thesis.reduction import physical_of_standard
from armid.thesis.setting import Setting
from armid.validation.smallest_mass_matrix import worst_along
from armid.values import Array

BAND = 0.1
"""Share of a joint's torque range at which Figure 4.3 has lines."""


@dataclass(frozen=True, eq=False, slots=True)
class Table41:
    """Base parameters in the form of Table 4.1.

    Attributes:
        values: Base parameters, shape (57,).
        relative: Relative standard deviations for white residuals [%], shape (57,).
        below_ten: Number of these below 10 %.
        mass_matrix: Smallest eigenvalue of M(q) along Table A.2 [kg·m²].
    """

    values: Array
    relative: Array
    below_ten: int
    mass_matrix: float


@dataclass(frozen=True, eq=False, slots=True)
class Pictures:
    """Data of figures 4.2 and 4.3 over one period.

    Attributes:
        time: Time of each sample, shape (N,) [s].
        measured: Processed torque, shape (N, 7) [N·m].
        base: Prediction by base parameters, shape (N, 7) [N·m].
        physical: Prediction by physical parameters, shape (N, 7) [N·m].
        band: A tenth of each joint's torque range, shape (7,) [N·m].
        rms: RMS of measured less predicted, by base and by physical parameters, shape (2, 7) [N·m].
        beyond: Share of samples outside ± band, by base parameters, shape (7,).
    """

    time: Array
    measured: Array
    base: Array
    physical: Array
    band: Array
    rms: Array
    beyond: Array


@dataclass(frozen=True, eq=False, slots=True)
class Results:
    """Results of chapter 4 on the virtual arm.

    Attributes:
        names: π_b of (3.38).
        truth: True base parameters, shape (57,).
        printed: Table 4.1 by Algorithm 3 as printed.
        corrected: Table 4.1 with filtered columns.
        wrong: Base parameters with filtered columns for the printed sign of gravity, shape (57,).
        printed_physical: Table 4.2 by Algorithm 3 as printed, shape (7, 12).
        corrected_physical: Table 4.2 with filtered columns, shape (7, 12).
        true_physical: True values, of which only the base parameters are identifiable, shape (7, 12).
        printed_pictures: Figures 4.2 and 4.3 by Algorithm 3 as printed.
        corrected_pictures: The same with filtered columns.
    """

    names: tuple[str, ...]
    truth: Array
    printed: Table41
    corrected: Table41
    wrong: Array
    printed_physical: Array
    corrected_physical: Array
    true_physical: Array
    printed_pictures: Pictures
    corrected_pictures: Pictures


def results(setting: Setting, estimates: Estimates) -> Results:
    """Computes Tables 4.1 and 4.2 and the data of Figures 4.2 and 4.3."""
    model = setting.hanging.dynamics
    return Results(
        setting.hanging.base.names,
        setting.truth,
        _table(setting, estimates.printed),
        _table(setting, estimates.corrected),
        estimates.wrong.fit.values,
        _physical(setting, estimates.printed_physical),
        _physical(setting, estimates.corrected_physical),
        physical_of_standard(model, setting.theta),
        _pictures(estimates.printed, estimates.printed_physical),
        _pictures(estimates.corrected, estimates.corrected_physical),
    )


def _table(setting: Setting, fitted: Fitted) -> Table41:
    relative = fitted.fit.relative_deviation
    theta = fitted.model.theta(fitted.fit.values)
    return Table41(
        fitted.fit.values,
        relative,
        int(np.count_nonzero(relative < 10.0)),
        worst_along(fitted.model.dynamics, theta, setting.unseen.sample(TEST_RATE)).min_eigenvalue,
    )


def _physical(setting: Setting, fitted: Fitted) -> Array:
    """Rows as (3.40), shape (7, 12)."""
    standard = fitted.fit.standard
    assert standard is not None  # estimators of bodies have them
    return physical_of_standard(setting.hanging.dynamics, standard.values)


def _pictures(base: Fitted, physical: Fitted) -> Pictures:
    """Torques on the output grid; predictions are filtered where the columns are."""
    (run,) = base.observations.runs
    band, rows = base.observations.band, run.rows
    measured = filtered_torque(run, band)[rows]
    dynamics = base.model.dynamics
    predicted: list[Array] = []
    for fitted in (base, physical):
        torque = dynamics.torque(run.motion, fitted.model.theta(fitted.fit.values))
        predicted.append((in_band(torque, run.rate, band) if band.columns else torque)[rows])
    off = measured - np.array(predicted)
    limit = BAND * np.ptp(measured, axis=0)
    return Pictures(
        run.motion.time[rows],
        measured,
        predicted[0],
        predicted[1],
        limit,
        np.sqrt(np.mean(off**2, axis=1)),
        np.mean(np.abs(off[0]) > limit, axis=0),
    )
