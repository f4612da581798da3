"""The search for friction: rung by rung, joint by joint, what lowers the error on stretches that were left out.

A candidate is accepted on evidence: its gain over the folds must exceed its own standard error by a margin, and a
share of what is left. In a rung where the joints of an arm are alike (hysteresis of the same kind of gear), the sum
of their gains is evidence for each, and a joint goes its own way only where it clearly says so. Gains are measured
with the bodies as all data have them, which is far more certain where bodies have many parameters, and then checked
with all parameters estimated anew without the stretch. What could imitate gravity must gain there too, and on long
stretches with other poses: it shows nowhere else.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from armid.estimation.friction_candidates import ONE_SHAPE, Piece, Rung, Superset
from armid.estimation.friction_folds import Reduced, Stretches
from armid.values import Array

__all__ = ["Climb", "Trial", "climb"]

RIDGES = (0.003, 0.03)
"""Shrinkage of added columns that is tried, in shares of their squared length: enough to share a torque out among
columns that resemble each other, and ten times that."""

CONTRARY = 1.0
"""Standard errors by which a candidate must lose to be turned down by the stricter way of judging."""

LOWEST = 0.1
"""Smallest share of a fold's error that counts as left: one fold explained by chance must not outweigh all others."""

PASSES = 4
"""Times that all rungs are climbed at most: what was hidden behind something larger shows once that is explained."""

HALF = 0.5
"""Share of the evidence that a joint needs by itself where its arm has it."""

BETTER = 2.0
"""Standard errors by which a joint's own choice must beat that of its arm."""


@dataclass(frozen=True, slots=True)
class Trial:
    """A candidate on a joint, beside what the joint had when it was last looked at.

    Attributes:
        joint: Index of the joint.
        rung: The kind of friction.
        pieces: What it consists of.
        gain: Share of the joint's squared held-out error that it takes away; negative where it adds to it.
        deviation: Standard error of the gain, from the scatter between folds.
        chosen: Whether it was taken.
    """

    joint: int
    rung: str
    pieces: tuple[Piece, ...]
    gain: float
    deviation: float
    chosen: bool

    @property
    def ratio(self) -> float:
        """Held-out RMS with the candidate over that without."""
        return float(np.sqrt(max(1.0 - self.gain, 0.0)))


@dataclass(frozen=True, eq=False, slots=True)
class Climb:
    """What was chosen.

    Attributes:
        chosen: Pieces of each joint.
        kept: Positions of the columns of the superset that the model then has.
        ridge: Shrinkage of each column of the superset, in shares of its squared length, shape (b,).
        trials: All candidates that were looked at.
    """

    chosen: tuple[frozenset[Piece], ...]
    kept: NDArray[np.intp]
    ridge: Array
    trials: tuple[Trial, ...]


@dataclass(frozen=True, eq=False, slots=True)
class _Offer:
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
    pieces: tuple[Piece, ...]
    ridge: float
    gains: Array
    changes: Array

    @property
    def gain(self) -> float:
        return float(self.gains.sum())


def climb(
    stretches: Stretches,
    long: Stretches,
    superset: Superset,
    allowed: Sequence[frozenset[Piece]],
    rungs: Sequence[Rung],
) -> Climb:
    """Choose friction.

    Args:
        stretches: The data of the superset, in stretches that are left out in turn.
        long: The same in few long stretches, in which what depends on the pose must gain as well.
        superset: The model with all pieces.
        allowed: Pieces that each joint may get.
        rungs: What to try, in order.
    """
    search = _Search(stretches, long, superset, [set(pieces) for pieces in allowed])
    for _ in range(PASSES):
        before = sum(len(pieces) for pieces in search.chosen)
        for rung in rungs:
            for _ in range(rung.rounds):
                if not search.round(rung):
                    break
        if sum(len(pieces) for pieces in search.chosen) == before:
            break
    search.prune({rung.name for rung in rungs if not rung.shared})
    chosen = tuple(frozenset(pieces) for pieces in search.chosen)
    return Climb(chosen, search.kept, search.ridge, tuple(search.trials.values()))


class _Search:
    """The state of a search."""

    def __init__(self, stretches: Stretches, long: Stretches, superset: Superset, allowed: list[set[Piece]]) -> None:
        self.stretches = stretches
        self.long = long
        self.superset = superset
        self.allowed = allowed
        self.chosen: list[set[Piece]] = [set() for _ in allowed]
        self.taken: list[tuple[str, _Offer]] = []
        self.ridge = np.zeros(superset.base.count)
        self.trials: dict[tuple[int, tuple[Piece, ...]], Trial] = {}

    @property
    def kept(self) -> NDArray[np.intp]:
        """Positions of the columns that the model has by now."""
        kept = self.superset.own.copy()
        for joint, pieces in enumerate(self.chosen):
            kept[self._columns(joint, pieces)] = True
        return np.flatnonzero(kept)

    def round(self, rung: Rung) -> bool:
        """Offer every joint one more candidate of a rung; whether any took one."""
        strict = self.stretches.reduced(self.kept, self.ridge, all_anew=True)
        fair = self.stretches.reduced(self.kept, self.ridge, all_anew=False)
        elsewhere = self.long.reduced(self.kept, self.ridge, all_anew=True) if rung.position else None
        offers = self._offers(rung, fair)
        shared = _of_the_arm(rung, offers) if rung.shared else None
        taken: list[_Offer] = []
        for joint in range(len(self.allowed)):
            own = [offer for offer in offers if offer.joint == joint]
            pick = _of_the_joint(rung, own, None if shared is None else [o for o in shared if o.joint == joint])
            if pick is not None and not self._contradicted(pick, strict, elsewhere):
                taken.append(pick)
            self._record(rung, own, pick if pick in taken else None)
        for pick in taken:
            self._take(rung, pick)
        return bool(taken)

    def prune(self, rungs: set[str]) -> None:
        """Let go of what no longer lowers the error once all is together, the last taken first."""
        error = self._error()
        for rung, offer in reversed(self.taken):
            if rung not in rungs:
                continue
            self.chosen[offer.joint] -= set(offer.pieces)
            without = self._error()
            if without < error:
                error = without
                key = offer.joint, offer.pieces
                self.trials[key] = replace(self.trials[key], chosen=False)
            else:
                self.chosen[offer.joint] |= set(offer.pieces)

    def _error(self) -> float:
        """Weighted squared error on all stretches, all parameters estimated without each."""
        return float((self.stretches.errors(self.kept, self.ridge) @ self.stretches.weights**2).sum())

    def _columns(self, joint: int, pieces: set[Piece] | tuple[Piece, ...]) -> NDArray[np.intp]:
        found = [self.superset.columns[joint, piece] for piece in pieces]
        return np.concatenate([np.zeros(0, dtype=np.intp), *found])

    def _offers(self, rung: Rung, reduced: Reduced) -> list[_Offer]:
        """All candidates of a rung on all joints."""
        offers: list[_Offer] = []
        for joint, allowed in enumerate(self.allowed):
            free = allowed - self.chosen[joint]
            done = {piece.term for piece in self.chosen[joint]} & ONE_SHAPE
            seen: set[tuple[Piece, ...]] = set()
            for option, pieces in enumerate(rung.options):
                left = tuple(piece for piece in pieces if piece in free and piece.term not in done)
                squares = reduced.squares[:, joint]
                if not left or left in seen or squares.sum() <= 0.0:
                    continue
                seen.add(left)
                columns = self._columns(joint, left)
                for ridge in RIDGES:
                    gains = reduced.gains(joint, columns, ridge)
                    if gains is not None:
                        changes = _changes(gains[0], squares)
                        offers.append(_Offer(joint, option, left, ridge, gains[0] / squares.sum(), changes))
        return offers

    def _contradicted(self, pick: _Offer, strict: Reduced, elsewhere: Reduced | None) -> bool:
        """Whether the stricter ways of judging speak against a candidate."""
        columns = self._columns(pick.joint, pick.pieces)
        gains = strict.gains(pick.joint, columns, pick.ridge)
        if gains is None or any(each.sum() < -CONTRARY * _deviation(each) for each in gains):
            return True
        if elsewhere is None:
            return False
        if gains[0].sum() <= 0.0:
            return True
        gains = elsewhere.gains(pick.joint, columns, pick.ridge)
        if gains is None:
            return True
        own, squares = gains[0], elsewhere.squares[:, pick.joint]
        return bool(own.sum() <= 0.0 and _changes(own, squares).sum() >= 0.0)

    def _take(self, rung: Rung, pick: _Offer) -> None:
        self.chosen[pick.joint] |= set(pick.pieces)
        self.ridge[self._columns(pick.joint, pick.pieces)] = pick.ridge
        self.taken.append((rung.name, pick))

    def _record(self, rung: Rung, own: list[_Offer], pick: _Offer | None) -> None:
        """Keep the better shrinkage of every candidate as evidence."""
        for offer in sorted(own, key=lambda offer: (offer is pick, offer.gain)):
            deviation = _deviation(offer.gains)
            self.trials[offer.joint, offer.pieces] = Trial(
                offer.joint, rung.name, offer.pieces, offer.gain, deviation, offer is pick
            )


def _of_the_arm(rung: Rung, offers: list[_Offer]) -> list[_Offer] | None:
    """The candidate with the largest gain over all joints, where all of them together make it clear."""
    groups: dict[tuple[int, float], list[_Offer]] = {}
    for offer in offers:
        groups.setdefault((offer.option, offer.ridge), []).append(offer)
    if not groups:
        return None
    best = max(groups.values(), key=lambda group: sum(offer.gain for offer in group))
    gains = np.mean([offer.gains for offer in best], axis=0)
    changes = np.mean([offer.changes for offer in best], axis=0)
    return best if _is_clear(gains, changes, rung.clear, rung.least) else None


def _of_the_joint(rung: Rung, own: list[_Offer], shared: list[_Offer] | None) -> _Offer | None:
    """What a joint takes: that of its arm unless it clearly does better otherwise, else what is clear by itself."""
    if not own:
        return None
    best = max(own, key=lambda offer: offer.gain)
    if not shared:
        return best if _is_clear(best.gains, best.changes, rung.clear, rung.least) else None
    arm = shared[0]
    more = best.gains - arm.gains
    if more.sum() > BETTER * _deviation(more):
        return best
    return arm if _is_clear(arm.gains, arm.changes, HALF * rung.clear, 0.0) else None


def _is_clear(gains: Array, changes: Array, clear: float, least: float) -> bool:
    """Whether a gain is worth it and stands out of its scatter between folds, in size or in proportion.

    One fold on which the model was far off may bring most of the gain and of its scatter; proportions then tell, or
    that there is a gain on every fold, which happens by chance once in 256.
    """
    if gains.sum() <= least:
        return False
    by_size = gains.sum() > clear * _deviation(gains)
    return bool(by_size or -changes.sum() > clear * _deviation(changes) or gains.min() > 0.0)


def _changes(gains: Array, squares: Array) -> Array:
    """Logarithms of what is left of each fold's error over what was."""
    share = np.divide(gains, squares, out=np.zeros_like(gains), where=squares > 0.0)
    return np.log(np.maximum(1.0 - share, LOWEST))


def _deviation(gains: Array) -> float:
    """Standard error of the sum of gains over the folds."""
    return float(np.std(gains, ddof=1) * np.sqrt(len(gains)))
