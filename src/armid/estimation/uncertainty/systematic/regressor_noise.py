"""Bias of least squares by noise of the positions in the regressor.

Accelerations that are differences of positions contain noise n, and the columns of the regressor contain it as well.
The normal matrix then contains E[ΔXᵀΔX] with ΔX = Σ_k ∂X/∂q̈_k n_k, so the estimate is wrong by

    -H⁻¹ E[ΔXᵀΔX] π,

mostly in inertias [Soderstrom2007]. The sign of the velocity is wrong near reversals, too, for which there is no such
formula. In simulations of an encoder of 12 bits and slow motion, the whole bias was up to three times this part.
"""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np

from armid import kernel
from armid.checked_array import Array
from armid.errors import Finding
from armid.estimation.problem import EstimationProblem
from armid.estimation.uncertainty.cross_products_by_frequency import column_numbers
from armid.information.base_regressor_layout import column_source
from armid.information.filtering import in_band
from armid.information.hysteresis_states import with_hysteresis_states
from armid.maths.signals.derivatives import central_difference
from armid.measurement.low_pass_band import Band
from armid.measurement.observations import ObservedRun
from armid.remedy import Remedy, setting

MOST_ROWS = 2000
"""Largest number of rows of a run that are evaluated: the mean of the products is then known to a few percent."""

MATTERS = 0.5
"""Smallest bias of the most affected parameter that is reported, in standard deviations by noise of the torque. The
whole bias may be three times as large, and a bias of 1.5 standard deviations lowers the coverage of an interval to
68 %."""

SHARE = 2.0
"""Factor on the computed bias that gives one standard deviation. A 95 % interval then extends by four times the
computed bias; the whole bias was up to three times as large as the computed one."""

REACH = 20.0
"""Length of the computed impulse response of filter and difference quotients [periods of the cut-off frequency]."""

SHORTEST = 8
"""Smallest number of samples of the computed impulse response."""


def regressor_noise_bias(problem: EstimationProblem, values: Array, weights: Array, inverse: Array) -> Array:
    """Bias of the estimate by noise of the positions, times `SHARE`, shape (b,); zero if velocities were recorded.

    The bias arises if accelerations are second differences of positions.

    Args:
        problem: Problem with its samples.
        values: The estimate, shape (b,).
        weights: Weight of each joint's rows, shape (n,).
        inverse: Inverse of the weighted normal matrix, prior included, shape (b, b).
    """
    model, base, observations = problem.require_samples("cover")
    pull = np.zeros(len(values))
    if not observations.position_noise.any():
        return pull
    source = column_source(model, base)
    for given in (each for each in observations.runs if each.consecutive):
        run = with_hysteresis_states(model, given, observations.band)
        parameters = column_numbers(source, problem.information.names, run)
        stride = -(-len(run.rows) // MOST_ROWS)
        level = observations.position_noise * _acceleration_gain(run, observations.band)
        motion, used = run.motion[slice(run.offset, None, run.step * stride)], run.mask[::stride]
        q, dq, ddq = (np.ascontiguousarray(each) for each in (motion.q, motion.dq, motion.ddq))
        zero = np.zeros_like(q)
        still = kernel.columns(source.tree, source.layout, q, dq, ddq, zero, source.term_rows(motion))
        for k in np.flatnonzero(level):
            faster = ddq.copy()
            faster[:, k] += 1.0
            terms = source.term_rows(replace(motion, ddq=faster))
            x = kernel.columns(source.tree, source.layout, q, dq, faster, zero, terms) - still
            for j, (a, b) in enumerate(itertools.pairwise(source.layout.offset)):
                block = weights[j] * x[a : b - 1][:, used[:, j]]
                pull[parameters[j]] += stride * level[k] ** 2 * (block @ (values[parameters[j]] @ block))
    return -SHARE * inverse @ pull


def _acceleration_gain(run: ObservedRun, band: Band) -> float:
    """Ratio of the noise of an acceleration in the band to white noise of the positions, standard deviations [1/s²].

    Positions are filtered before they are differentiated, and columns once more.
    """
    longest = run.motion.samples if band.is_open else min(run.motion.samples, round(REACH * run.rate / band.cutoff))
    impulse = np.zeros((max(longest, SHORTEST), 1))
    impulse[len(impulse) // 2] = 1.0
    filtered = in_band(impulse, run.rate, band)
    return float(np.linalg.norm(in_band(central_difference(filtered, run.rate, 2), run.rate, band)))


def noise_finding(bias: Array, scatter: Array, names: tuple[str, ...]) -> list[Finding]:
    """Finding about a bias by noise of the positions; empty if the bias is below `MATTERS` standard deviations.

    Args:
        bias: Bias of the b parameters, times `SHARE`, shape (b,).
        scatter: Covariance of the estimate by the noise of the data, shape (b, b).
        names: Names of the b parameters.
    """
    deviation = np.sqrt(np.maximum(np.diag(scatter), 0.0))
    ratio = np.divide(np.abs(bias) / SHARE, deviation, out=np.zeros_like(bias), where=deviation > 0.0)
    if not ratio.size or ratio.max() < MATTERS:
        return []
    most = int(np.argmax(ratio))
    evidence = (
        "Noise or rounding of the positions becomes noise of the accelerations. In the band of the filter it makes "
        f"inertias too small: {names[most]} by {ratio[most]:.1f} standard deviations of its noise. The intervals are "
        "widened by this bias; the values are not corrected."
    )
    remedy = Remedy(
        "use ", setting("cutoff", "auto"), ", which lowers the cut-off for slow motions, or record a faster motion."
    )
    return [Finding("regressor-noise", "warning", "", evidence, remedy)]
