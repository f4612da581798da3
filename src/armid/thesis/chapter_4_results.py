"""Chapter 4 of the thesis: tables of parameters, and measured torque compared with predicted torque."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armid.checked_array import Array
from armid.information.filtering import filtered_torque, in_band
from armid.thesis.algorithm import TEST_RATE, Fitted
from armid.thesis.algorithm_corrections import Estimates
from armid.thesis.experiments.residual_causes import oscillation, ringing
from armid.thesis.reduction import physical_of_standard
from armid.thesis.setting import Setting
from armid.validation.smallest_mass_matrix import worst_along

BAND = 0.1
"""Distance of the two horizontal lines in Figure 4.3 of the thesis from zero, divided by the range of the joint's
torque."""


@dataclass(frozen=True, eq=False, slots=True)
class Table41:
    """Base parameters in the form of Table 4.1 of the thesis.

    Attributes:
        values: Base parameters, shape (57,).
        relative: Relative standard deviations for white residuals [%], shape (57,).
        below_ten: Number of relative standard deviations below 10 %.
        mass_matrix: Smallest eigenvalue of the mass matrix M(q) along Table A.2 [kg·m²].
    """

    values: Array
    relative: Array
    below_ten: int
    mass_matrix: float


@dataclass(frozen=True, eq=False, slots=True)
class Pictures:
    """Data of Figures 4.2 and 4.3 of the thesis, over one period.

    Attributes:
        time: Time of each drawn sample, at 100 Hz, shape (N,) [s].
        measured: Processed torque, shape (N, 7) [N·m].
        base: Torque predicted with the base parameters, shape (N, 7) [N·m].
        physical: Torque predicted with the physical parameters, shape (N, 7) [N·m].
        band: A tenth of the range of each joint's measured torque, shape (7,) [N·m].
        rms: RMS of measured minus predicted torque over all samples, first with the base and then with the physical
            parameters, shape (2, 7) [N·m].
        beyond: Share of samples in which measured minus predicted torque, with the base parameters, is outside ±
            `band`, shape (7,).
        oscillation: Oscillation (RMS) of the measured torque, and of the torque predicted with the base parameters,
            between jumps of friction, shape (2, 7) [N·m].
        ringing: Fast part of `oscillation`: deviation (RMS) from a polynomial that is fitted in a window of 0.6 s,
            shape (2, 7) [N·m].
    """

    time: Array
    measured: Array
    base: Array
    physical: Array
    band: Array
    rms: Array
    beyond: Array
    oscillation: Array
    ringing: Array


@dataclass(frozen=True, eq=False, slots=True)
class Results:
    """Results of chapter 4 of the thesis, computed for the virtual arm.

    Attributes:
        names: Names of the base parameters, π_b of equation (3.38).
        truth: True base parameters, shape (57,).
        printed: Table 4.1, estimated by Algorithm 3 as printed.
        corrected: Table 4.1, estimated with filtered columns.
        wrong: Base parameters estimated with filtered columns and the printed sign of gravity, shape (57,).
        printed_physical: Table 4.2, estimated by Algorithm 3 as printed, shape (7, 12).
        corrected_physical: Table 4.2, estimated with filtered columns, shape (7, 12).
        true_physical: True physical parameters, shape (7, 12); the torque determines only their base parameters.
        printed_pictures: Data of Figures 4.2 and 4.3 for Algorithm 3 as printed.
        corrected_pictures: Data of Figures 4.2 and 4.3 with filtered columns.
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
    """Computes Tables 4.1 and 4.2 of the thesis, and the data of Figures 4.2 and 4.3."""
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
    """Physical parameters (7, 12) of an estimate: one row for each link, ordered as in (3.40) of the thesis."""
    standard = fitted.fit.standard
    assert standard is not None  # estimators of bodies have them
    return physical_of_standard(setting.hanging.dynamics, standard.values)


def _pictures(base: Fitted, physical: Fitted) -> Pictures:
    """Data of Figures 4.2 and 4.3 of the thesis for two estimates.

    The predicted torque is filtered if the columns of the regressor are filtered.

    Args:
        base: Estimate of the base parameters.
        physical: Estimate of the physical parameters.
    """
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
    time, dq = run.motion.time[rows], run.motion.dq[rows]
    drawn = slice(None, None, max(1, round(1.0 / (TEST_RATE * (time[1] - time[0])))))
    time, dq = time[drawn], dq[drawn]
    shown, base_line, physical_line = measured[drawn], predicted[0][drawn], predicted[1][drawn]
    return Pictures(
        time,
        shown,
        base_line,
        physical_line,
        limit,
        np.sqrt(np.mean(off**2, axis=1)),
        np.mean(np.abs(off[0]) > limit, axis=0),
        np.array([oscillation(x, dq, time) for x in (shown, base_line)]),
        np.array([ringing(x, dq, time) for x in (shown, base_line)]),
    )
