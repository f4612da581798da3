"""Acceptance rule for friction candidates, from their gains on held-out folds.

A candidate is accepted where its gain over the folds exceeds a multiple of the gain's standard error and a minimum
share of the remaining error. Some families act alike on all joints of an arm (hysteresis of the same kind of gear).
There the mean gain over the joints decides for all of them; a joint departs from that choice only where another
candidate is significantly better on it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armid.checked_array import Array
from armid.estimation.friction.candidates import Candidate, CandidateFamily

LOWEST_RATIO = 0.1
"""Lower limit of the error ratio of a fold: one fold explained by chance must not outweigh all others."""

LARGE = 0.1
"""Minimum gain, as a share of the squared error, of an effect that only a few folds show, such as slow reversals."""

BEYOND_BEST = 0.02
"""Minimum gain of such an effect on all folds but the best, as a share, so that no fold decides alone."""

GAIN_OVER_LOSS = 10.0
"""Minimum ratio of that gain to the loss on the other folds, in place of the standard error, which is large here."""

SHARED_MARGIN = 0.5
"""Factor on the margin that a joint itself must reach where the arm as a whole accepts the candidate."""

OWN_CHOICE_MARGIN = 2.0
"""Standard errors by which a joint's best candidate must beat the candidate chosen for the arm."""

REJECTION_MARGIN = 1.0
"""Standard errors by which a candidate must lose with all parameters estimated anew to be rejected."""


@dataclass(frozen=True, eq=False, slots=True)
class CandidateGain:
    """Gain of an option of a family on one joint, with one shrinkage.

    Attributes:
        joint: Index of the joint.
        option: Index of the option in its family.
        candidates: Candidates of the option.
        ridge: Shrinkage of their columns, in shares of the squared length of each.
        gains: Reduction of the joint's squared error on each fold, as a share of its error on all folds, shape (F,).
        changes: Logarithm of the ratio of the joint's squared error, with over without, on each fold, shape (F,).
    """

    joint: int
    option: int
    candidates: tuple[Candidate, ...]
    ridge: float
    gains: Array
    changes: Array

    @property
    def gain(self) -> float:
        """Reduction of the joint's squared error on all folds, as a share."""
        return float(self.gains.sum())


def choose_for_arm(family: CandidateFamily, measured: list[CandidateGain]) -> list[CandidateGain] | None:
    """Chooses the option with the largest gain over all joints; `None` where their mean gain is not significant."""
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
    """Chooses the option of a joint.

    The arm's choice stands unless another option is significantly better on the joint. Where there is no arm's
    choice, the joint's best option is taken if its gain is significant.
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
    """Checks whether a gain is large enough and significant against its scatter between folds.

    One fold on which the model was far off may contribute most of the gain and of its scatter. So the gain is also
    significant where the ratios of the errors are, or where every fold gains: that happens by chance once in 256.
    """
    if gains.sum() <= min_gain:
        return False
    by_size = gains.sum() > margin * standard_error(gains)
    in_proportion = -changes.sum() > margin * standard_error(changes)
    return bool(by_size or in_proportion or gains.min() > 0.0 or _gains_on_few(gains))


def _gains_on_few(gains: Array) -> bool:
    """Checks whether two or more folds gain much while the others lose little.

    Effects that only slow reversals show appear in two or three of eight folds. The scatter between folds is then as
    large as the gain, and the standard error cannot decide.
    """
    beyond = float(np.maximum(gains, 0.0).sum() - gains.max())
    lost = float(np.maximum(-gains, 0.0).sum())
    return float(gains.sum()) > LARGE and beyond > max(GAIN_OVER_LOSS * lost, BEYOND_BEST)


def error_log_ratios(gains: Array, squares: Array) -> Array:
    """Logarithm of the ratio of each fold's squared error, after over before a gain, shape (F,)."""
    share = np.divide(gains, squares, out=np.zeros_like(gains), where=squares > 0.0)
    return np.log(np.maximum(1.0 - share, LOWEST_RATIO))


def standard_error(gains: Array) -> float:
    """Standard error of the sum of gains over the folds."""
    return float(np.std(gains, ddof=1) * np.sqrt(len(gains)))
