"""Rule by which the stretches that were left out show a candidate of friction.

Its gain over the folds must exceed its own standard error by a margin, and a share of what is left. In a rung where
the joints of an arm are alike (hysteresis of the same kind of gear), the sum of their gains is evidence for each, and
a joint goes its own way only where it clearly says so.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armid.estimation.friction.candidates import Candidate, CandidateFamily
from armid.values import Array

__all__ = ["LARGE", "CandidateGain", "of_the_arm", "of_the_joint", "proportions", "standard_error"]

LOWEST = 0.1
"""Smallest share of a fold's error that counts as left: one fold explained by chance must not outweigh all others."""

LARGE = 0.1
"""Share of the squared error that a gain takes at least where few stretches show it, such as slow reversals."""

REST = 0.02
"""What must then be gained beyond the best stretch, as a share, so that no stretch decides alone."""

TIMES = 10.0
"""And by how many times that must exceed what all others lose: their scatter says nothing of what a few show."""

HALF = 0.5
"""Share of the evidence that a joint needs by itself where its arm has it."""

BETTER = 2.0
"""Standard errors by which a joint's own choice must beat that of its arm."""


@dataclass(frozen=True, eq=False, slots=True)
class CandidateGain:
    """A candidate with a shrinkage on one joint.

    Attributes:
        joint: Index of the joint.
        option: Which of the rung's options.
        pieces: What it adds.
        ridge: Its shrinkage.
        gains: What it takes away on each fold, as shares of the joint's error on all, shape (F,).
        changes: Logarithms of the joint's error with it over that without on each fold, shape (F,).
    """

    joint: int
    option: int
    pieces: tuple[Candidate, ...]
    ridge: float
    gains: Array
    changes: Array

    @property
    def gain(self) -> float:
        """Return what it takes away on all folds."""
        return float(self.gains.sum())


def of_the_arm(rung: CandidateFamily, offers: list[CandidateGain]) -> list[CandidateGain] | None:
    """The candidate with the largest gain over all joints, where all of them together make it clear."""
    groups: dict[tuple[int, float], list[CandidateGain]] = {}
    for offer in offers:
        groups.setdefault((offer.option, offer.ridge), []).append(offer)
    if not groups:
        return None
    best = max(groups.values(), key=lambda group: sum(offer.gain for offer in group))
    gains = np.mean([offer.gains for offer in best], axis=0)
    changes = np.mean([offer.changes for offer in best], axis=0)
    return best if _is_clear(gains, changes, rung.clear, rung.least) else None


def of_the_joint(
    rung: CandidateFamily, own: list[CandidateGain], shared: list[CandidateGain] | None
) -> CandidateGain | None:
    """Choose for a joint: as its arm does unless it clearly does better otherwise, else what is clear by itself."""
    if not own:
        return None
    best = max(own, key=lambda offer: offer.gain)
    if not shared:
        return best if _is_clear(best.gains, best.changes, rung.clear, rung.least) else None
    arm = shared[0]
    more = best.gains - arm.gains
    if more.sum() > BETTER * standard_error(more):
        return best
    return arm if _is_clear(arm.gains, arm.changes, HALF * rung.clear, 0.0) else None


def _is_clear(gains: Array, changes: Array, clear: float, least: float) -> bool:
    """Tell whether a gain is worth it and stands out of its scatter between folds, in size or in proportion.

    One fold on which the model was far off may bring most of the gain and of its scatter; proportions then tell, or
    that there is a gain on every fold, which happens by chance once in 256.
    """
    if gains.sum() <= least:
        return False
    by_size = gains.sum() > clear * standard_error(gains)
    in_proportion = -changes.sum() > clear * standard_error(changes)
    return bool(by_size or in_proportion or gains.min() > 0.0 or _shown_by_few(gains))


def _shown_by_few(gains: Array) -> bool:
    """Tell whether a few stretches gain much, more than one of them, while the others hardly lose.

    What only slow reversals show is in two or three stretches, and no scatter of eight is small beside that.
    """
    beyond = float(np.maximum(gains, 0.0).sum() - gains.max())
    lost = float(np.maximum(-gains, 0.0).sum())
    return float(gains.sum()) > LARGE and beyond > max(TIMES * lost, REST)


def proportions(gains: Array, squares: Array) -> Array:
    """Logarithms of what is left of each fold's error over what was."""
    share = np.divide(gains, squares, out=np.zeros_like(gains), where=squares > 0.0)
    return np.log(np.maximum(1.0 - share, LOWEST))


def standard_error(gains: Array) -> float:
    """Standard error of the sum of gains over the folds."""
    return float(np.std(gains, ddof=1) * np.sqrt(len(gains)))
