"""Errata of the thesis: printed form, correct form, and a number as evidence for each erratum."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armid.thesis.algorithm_corrections import Estimates, Steps
from armid.thesis.audit import Audit
from armid.thesis.design_trials import Designs
from armid.thesis.dynamics_check import Dynamics
from armid.thesis.published import published
from armid.thesis.reduction import Reduction
from armid.thesis.setting import PERIOD, Setting

NONE = float("nan")


@dataclass(frozen=True, slots=True)
class Erratum:
    """Erratum: an error in the thesis and its correction.

    Attributes:
        item: Place in the thesis: number of the equation, section or table.
        printed: Text or equation as the thesis prints it.
        right: Correct text or equation.
        shown: Meaning of `printed_value` and `right_value`; without these values, the reason why the printed form is
            wrong.
        printed_value: Number that follows from the printed form; NaN if the erratum has no such number.
        right_value: Number that follows from the correct form; NaN if the erratum has no such number.
        typesetting: True if the error may be one of typesetting, or of the copy of the thesis that was used.
    """

    item: str
    printed: str
    right: str
    shown: str
    printed_value: float = NONE
    right_value: float = NONE
    typesetting: bool = False


def errata(
    setting: Setting,
    dynamics: Dynamics,
    reduction: Reduction,
    designs: Designs,
    steps: Steps,
    audit: Audit,
    estimates: Estimates,
) -> tuple[Erratum, ...]:
    """All errata of the thesis, in the order of its pages, with numbers from the results of the study."""
    return (
        *_of_theory(dynamics, estimates),
        *_of_model(dynamics, reduction, audit),
        *_of_method(setting, designs, steps, audit),
        *_of_results(setting, audit),
    )


def _of_theory(dynamics: Dynamics, estimates: Estimates) -> tuple[Erratum, ...]:
    """Errata of chapter 2 of the thesis."""
    fit = estimates.printed.fit
    squares = float(np.sum(fit.rows * fit.residual_rms**2))
    rows, b = int(fit.rows.sum()), len(fit.names)
    least = 100.0 * np.sqrt(fit.deviation**2 + fit.values**2) / np.abs(fit.values)
    return (
        Erratum(
            "(2.5), before it", "Ṙ = dR(θ)/dθ", "Ṙ = dR/dt", "the time derivative is meant, because S(ω) is a rate",
            typesetting=True,
        ),
        Erratum(
            "(2.16)", "ḋ = ∂d/∂q", "ḋ = (∂d/∂q) q̇", "a 3 × 7 matrix is not a velocity; the other side is right",
            typesetting=True,
        ),
        Erratum(
            "(2.21), (2.30)–(2.33), (3.12)",
            "U = + Σ m_i g_0ᵀ p_i with g_0 along gravity",
            "U = − Σ m_i g_0ᵀ p_i",
            "largest imbalance of power along Table A.1 in 20 s, in W",
            dynamics.literal_imbalance,
            dynamics.imbalance,
        ),
        Erratum(
            "(2.33), (3.12)", "second vector garbled, indices repeat", "as (3.8) orders them, v × ω + Rᵀ g for m r",
            "with the correct form, Y equals that of Newton and Euler", typesetting=True,
        ),
        Erratum(
            "§2.4.1", "m > n and A has rank m", "m > n and A has rank n",
            "number m of rows of the stacked Y_b, and its rank", float(rows), float(b),
        ),
        Erratum("(2.40), (3.49), (3.50), (3.54)", "x̂ := min …", "x̂ := arg min …", "a minimum is one number"),
        Erratum(
            "(2.44)", "σ̂² = ‖b − A x̂‖ / (m − n)", "σ̂² = ‖b − A x̂‖² / (m − n)",
            "σ̂ of Algorithm 3 as printed, in N·m",
            float(np.sqrt(np.sqrt(squares) / (rows - b))),
            float(np.sqrt(squares / (rows - b))),
        ),
        Erratum(
            "(2.45)", "A† E[b bᵀ] A†ᵀ", "A† Cov(b) A†ᵀ", "smallest relative deviation of a parameter, in %",
            float(least.min()), float(fit.relative_deviation.min()),
        ),
    )  # fmt: skip


def _of_model(dynamics: Dynamics, reduction: Reduction, audit: Audit) -> tuple[Erratum, ...]:
    """Errata of section 3.1 of the thesis and of its appendix."""
    identity = next(each for each in reduction.identities if each.right)
    lines = {line.column: line for line in reduction.dependences}
    wrong_labels = sum(line.label != line.column for line in reduction.dependences)
    return (
        Erratum(
            "(3.7), YY_i", "I_yy + m (r_y² + r_z²)", "I_yy + m (r_x² + r_z²)",
            "relative difference of Table 4.2 from Table 4.1, inertial part",
            audit.carried.printed_mismatch, audit.carried.mismatch, typesetting=True,
        ),
        Erratum(
            "(3.7), labels", "MX_i three times, XX_i for XY_i and XZ_i", "MX_i, MY_i, MZ_i; XX_i, XY_i, XZ_i",
            "(3.8) has the right ones", typesetting=True,
        ),
        Erratum(
            identity.number, "… + d_n² (β_XX + β_YY)_{n−2}", "… + d_n² (β_XX + β_ZZ)_{n−2}",
            "largest difference of the two sides, divided by the largest β_M; (3.30) is right", identity.error,
            identity.right_error, typesetting=True,
        ),
        Erratum(
            "(3.31c)", "an index as a factor; a product of vectors with two and three elements",
            "Y of M_n, a zero row first",
            "(A.1) has its lines", typesetting=True,
        ),
        Erratum(
            "(A.1), M_7", f"Y_M7 = {lines['M_7'].printed}", lines["M_7"].right,
            "largest error of the column, divided by the largest entry; (3.39) uses the right line",
            lines["M_7"].printed_error, lines["M_7"].right_error, typesetting=True,
        ),
        Erratum(
            "(A.1), YY_2", f"Y_{lines['YY_2'].label} = {lines['YY_2'].printed}", f"Y_YY2 = {lines['YY_2'].right}",
            "the same", lines["YY_2"].printed_error, lines["YY_2"].right_error, typesetting=True,
        ),
        Erratum(
            "(A.1), labels", "labels of other lines repeat or are no columns", "as in the table of (A.1)",
            "number of lines with the label of another column", float(wrong_labels), 0.0, typesetting=True,
        ),
        Erratum(
            "(3.42)", "d/dt (∂β_i/∂q_j)", "d/dt (∂β_i/∂q̇_j)", "largest error of Y, divided by its largest entry",
            dynamics.printed_derivative_error, dynamics.regressor_error, typesetting=True,
        ),
        Erratum(
            "(3.43)", "y_12, y_13, … right of the diagonal", "y_21, y_31, …: row j, column i",
            "largest entry of these blocks, divided by the largest of Y", *dynamics.triangle,
        ),
        Erratum(
            "§3.2.1", "Y is 84 × 7", "Y is 7 × 84", "rows of Y", float(reduction.columns),
            float(len(published().frames)), typesetting=True,
        ),
    )  # fmt: skip


def _of_method(setting: Setting, designs: Designs, steps: Steps, audit: Audit) -> tuple[Erratum, ...]:
    """Errata of sections 3.2 and 3.3 of the thesis."""
    by_key = {step.key: step.errors for step in steps.rows}
    sound = [
        value
        for link, value in enumerate(audit.eigenvalues.tolist(), 1)
        if not {("(3.52d)", link), ("(3.53a)", link)} & {(each.constraint, each.link) for each in audit.broken}
    ]
    return (
        Erratum(
            "§3.2.2", "τ is filtered at 3.5 Hz, sgn(q̇) is not", "the same filter on every column of Y_b",
            "torque error on Table A.2, in N·m", by_key["one-sided"].unseen, by_key["columns"].unseen,
        ),
        Erratum(
            "(3.52d), (3.53a)", "inertia positive definite, triangle on its diagonal",
            "pseudo-inertia positive semidefinite",
            "smallest eigenvalue in Table 4.2 for links that keep both conditions", min(sound), 0.0,
        ),
        Erratum(
            "(3.54)", "cond(Y)", "cond(Y_b)", "condition number of Table A.1 in 20 s",
            audit.conditions.every_column, float(audit.conditions.hanging[0]),
        ),
        Erratum(
            "(3.55a), Algorithm 2", "min over a; x_0 from [−1.5, 1.5] to the power 2L", "min over a and b; 2 · 7 · L",
            "coefficients", float(designs.unknowns // setting.hanging.dynamics.n), float(designs.unknowns),
        ),
        Erratum("(3.55c)", "sums from l = 0", "sums from l = 1", "b_0 / 0 is not defined", typesetting=True),
        Erratum(
            "(3.55f)", "l ω_f / L · q_max", "l ω_f · q_max", "number of pairs in Tables A.1 and A.2 above the bound",
            float(sum(each.above_literal for each in audit.tables)),
            float(sum(each.above for each in audit.tables)),
        ),
    )  # fmt: skip


def _of_results(setting: Setting, audit: Audit) -> tuple[Erratum, ...]:
    """Errata of chapter 4 of the thesis and of the tables of its appendix."""
    names = setting.hanging.base.names
    outlier = audit.deviations.outlier
    return (
        Erratum(
            "§4.1", "7 · 8000 · 27 = 392 000 rows", "1 512 000 rows", "rows of Y_b at 8 kHz in 27 s", 392000.0,
            setting.hanging.dynamics.n * 8000.0 * PERIOD,
        ),
        Erratum(
            "Table 4.1, names", "YZ_3, YZ_5", "YZR_3, YZR_5", "(3.39) regroups both", typesetting=True
        ),
        Erratum(
            f"Table 4.1, {outlier}", "its σ", "as the other 56 deviations imply", "relative standard deviation, in %",
            published().base[outlier][1], float(audit.deviations.shape[names.index(outlier)]), typesetting=True,
        ),
        Erratum(
            "Table A.1, b_10", "the row is missing", "b_10 = − Σ l b_l / 10 over l ≤ 9",
            "largest |Σ b_l / l|, which (3.55c) sets to zero, too, and which was not used for b_10",
            float(audit.tables[0].without_last[0]), float(audit.tables[0].sums[0]), typesetting=True,
        ),
    )  # fmt: skip
