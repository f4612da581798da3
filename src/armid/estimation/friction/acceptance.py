"""Acceptance rule for friction candidates, from their gains on held-out folds.

The gain of a candidate is the decrease of the squared held-out error divided by this error. A candidate is accepted
if its gain is larger than a multiple of the standard error of the gain and larger than a minimum. Some families of
friction are similar on all joints of an arm (hysteresis of the same kind of gear). For such a family, the mean gain
over the joints selects one option for all joints; a joint gets another option only if that option is significantly
better on this joint.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armid.checked_array import Array
from armid.estimation.friction.candidates import Candidate, CandidateFamily

LOWEST_RATIO = 0.1
"""Lower limit of the ratio of the squared errors with and without a candidate on one fold, so that one fold that fits
by chance does not outweigh all others."""

LARGE = 0.1
"""Minimum gain of a candidate that reduces the error on few folds only, as a share of the squared error. Effects at
slow reversals, for instance, appear on few folds."""

BEYOND_BEST = 0.02
"""Minimum gain, on all folds except the best, of a candidate that reduces the error on few folds only, as a share of
the squared error. Without it, a single fold could decide."""

GAIN_OVER_LOSS = 10.0
"""Minimum ratio of gain to loss for a candidate that reduces the error on few folds only: gain on all folds except
the best, loss on the folds on which the error increases. It replaces the criterion of the standard error, which is as
large as the gain of such a candidate."""

SHARED_MARGIN = 0.5
"""Factor on the required number of standard errors of an option's gain on a joint, if the option is already accepted
for the whole arm."""

OWN_CHOICE_MARGIN = 2.0
"""Number of standard errors by which a joint's best candidate must be better than the candidate chosen for the
arm."""

REJECTION_MARGIN = 1.0
"""Number of standard errors of the gain: a candidate is rejected if it increases the held-out error by more, when all
parameters are estimated without the held-out fold."""


@dataclass(frozen=True, eq=False, slots=True)
class CandidateGain:
    """Gain of one option of a family of friction laws on one joint, for one value of the shrinkage.

    Attributes:
        joint: Index of the joint.
        option: Index of the option in its family.
        candidates: Friction candidates that the option adds together.
        ridge: Shrinkage of the columns of the candidates, as a share of the squared length of each column.
        gains: Reduction of the joint's squared error on each of the F folds, as a share of its error on all folds,
            shape (F,).
        changes: Logarithm of the ratio of the joint's squared errors with and without the option on each of the F
            folds, shape (F,).
    """

    joint: int
    option: int
    candidates: tuple[Candidate, ...]
    ridge: float
    gains: Array
    changes: Array

    @property
    def gain(self) -> float:
        """Reduction of the joint's squared error on all folds together, as a share of this error."""
        return float(self.gains.sum())


def choose_for_arm(family: CandidateFamily, measured: list[CandidateGain]) -> list[CandidateGain] | None:
    """Chooses the option with the largest sum of gains over all joints.

    Args:
        family: Family of friction laws.
        measured: Gains of all options of the family on all joints.

    Returns:
        Gains of the chosen option on the joints; `None` if the gain is not significant.
    """
    groups: dict[tuple[int, float], list[CandidateGain]] = {}
    for each in measured:
        groups.setdefault((each.option, each.ridge), []).append(each)
    if not groups:
        return None
    largest = max(groups.values(), key=lambda group: sum(each.gain for each in group))
    gains = np.mean([each.gains for each in largest], axis=0)
    changes = np.mean([each.changes for each in largest], axis=0)
    return largest if _is_clear(gains, changes, family.margin, family.min_gain) else None


def choose_for_joint(
    family: CandidateFamily, of_joint: list[CandidateGain], shared: list[CandidateGain] | None
) -> CandidateGain | None:
    """Chooses the option of a family for a joint; `None` if no option has a significant gain.

    The option of the whole arm is used, unless another option is significantly better on this joint. If no option was
    chosen for the arm, the best option of the joint is used, provided that its gain is significant.

    Args:
        family: Family of friction laws.
        of_joint: Gains of all options of the family on this joint.
        shared: Gains of the option of the whole arm on this joint; `None` or empty if no option was chosen.
    """
    if not of_joint:
        return None
    largest = max(of_joint, key=lambda each: each.gain)
    if not shared:
        return largest if _is_clear(largest.gains, largest.changes, family.margin, family.min_gain) else None
    arm_choice = shared[0]
    difference = largest.gains - arm_choice.gains
    if difference.sum() > OWN_CHOICE_MARGIN * standard_error(difference):
        return largest
    return arm_choice if _is_clear(arm_choice.gains, arm_choice.changes, SHARED_MARGIN * family.margin, 0.0) else None


def _is_clear(gains: Array, changes: Array, margin: float, min_gain: float) -> bool:
    """Tests whether a gain is above `min_gain`, and significant compared with its scatter between folds.

    The gain is significant if it is more than `margin` standard errors.
    One fold on which the model is very inaccurate may contribute most of the gain and of its scatter. So the gain is
    also significant if the logarithms of the error ratios are significant, or if the error decreases on every fold,
    which happens by chance once in 256 trials of eight folds.
    """
    if gains.sum() <= min_gain:
        return False
    by_size = gains.sum() > margin * standard_error(gains)
    in_proportion = -changes.sum() > margin * standard_error(changes)
    return bool(by_size or in_proportion or gains.min() > 0.0 or _gains_on_few(gains))


def _gains_on_few(gains: Array) -> bool:
    """Tests whether the error decreases clearly on two or more folds and increases only a little on the others.

    Effects at slow reversals appear in two or three of eight folds. The scatter between folds is then as large as the
    gain, so the standard error cannot be used as a criterion.
    """
    beyond = float(np.maximum(gains, 0.0).sum() - gains.max())
    lost = float(np.maximum(-gains, 0.0).sum())
    return float(gains.sum()) > LARGE and beyond > max(GAIN_OVER_LOSS * lost, BEYOND_BEST)


def error_log_ratios(gains: Array, squares: Array) -> Array:
    """Logarithm of the ratio of squared errors with and without a candidate on each of the F folds, shape (F,).

    Args:
        gains: Reduction of the squared error by the candidate on each fold, shape (F,).
        squares: Squared error without the candidate on each fold, shape (F,).
    """
    share = np.divide(gains, squares, out=np.zeros_like(gains), where=squares > 0.0)
    return np.log(np.maximum(1.0 - share, LOWEST_RATIO))


def standard_error(gains: Array) -> float:
    """Standard error of the sum over the F folds of gains (F,), from their scatter between folds."""
    return float(np.std(gains, ddof=1) * np.sqrt(len(gains)))
