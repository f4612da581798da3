"""The search for friction: rung by rung, joint by joint, what lowers the error on stretches that were left out.

A candidate is accepted on evidence (`friction_evidence`). Gains are measured with the bodies as all data have them,
which is far more certain where bodies have many parameters, and then checked with all parameters estimated anew
without the stretch. What could imitate gravity must gain there too, and on long stretches with other poses: it shows
nowhere else.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from armid.estimation.friction.acceptance import (
    LARGE,
    CandidateGain,
    of_the_arm,
    of_the_joint,
    proportions,
    standard_error,
)
from armid.estimation.friction.candidates import ONE_SHAPE, Candidate, CandidateFamily, CandidateModel
from armid.estimation.friction.heldout_gains import HeldOutFolds, Reduced
from armid.model.terms import Hysteresis
from armid.values import Array

__all__ = ["HeldOutTrial", "SelectedCandidate", "SelectionPath", "select_forward"]

RIDGES = (0.003, 0.03)
"""Shrinkage of added columns that is tried, in shares of their squared length: enough to share a torque out among
columns that resemble each other, and ten times that."""

CONTRARY = 1.0
"""Standard errors by which a candidate must lose to be turned down by the stricter way of judging."""

PASSES = 4
"""Times that all rungs are climbed at most: what was hidden behind something larger shows once that is explained."""


@dataclass(frozen=True, slots=True)
class HeldOutTrial:
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
    pieces: tuple[Candidate, ...]
    gain: float
    deviation: float
    chosen: bool

    @property
    def ratio(self) -> float:
        """Held-out RMS with the candidate over that without."""
        return float(np.sqrt(max(1.0 - self.gain, 0.0)))


@dataclass(frozen=True, slots=True)
class SelectedCandidate:
    """Choice of a joint in one round.

    Attributes:
        rung: The kind of friction.
        joint: Index of the joint.
        pieces: What it consists of.
        ridge: Shrinkage with which it was judged.
    """

    rung: str
    joint: int
    pieces: tuple[Candidate, ...]
    ridge: float


@dataclass(frozen=True, eq=False, slots=True)
class SelectionPath:
    """Choice of friction.

    Attributes:
        taken: What joints took and kept, in its order.
        kept: Positions of the columns of the superset that the model then has.
        ridge: Shrinkage of each column of the superset, in shares of its squared length, shape (b,).
        trials: All candidates that were looked at.
    """

    taken: tuple[SelectedCandidate, ...]
    kept: NDArray[np.intp]
    ridge: Array
    trials: tuple[HeldOutTrial, ...]

    def chosen(self, joints: int) -> tuple[frozenset[Candidate], ...]:
        """Pieces of each of so many joints."""
        own: list[set[Candidate]] = [set() for _ in range(joints)]
        for each in self.taken:
            own[each.joint] |= set(each.pieces)
        return tuple(frozenset(pieces) for pieces in own)


def select_forward(
    stretches: HeldOutFolds,
    long: HeldOutFolds,
    superset: CandidateModel,
    allowed: Sequence[frozenset[Candidate]],
    rungs: Sequence[CandidateFamily],
    start: SelectionPath | None = None,
) -> SelectionPath:
    """Choose friction.

    Args:
        stretches: The data of the superset, in stretches that are left out in turn.
        long: The same in few long stretches, in which what depends on the pose must gain as well.
        superset: The model with all pieces.
        allowed: Pieces that each joint may get.
        rungs: What to try, in order.
        start: From where to go on; pieces of the superset. Not given, from the model without any.
    """
    search = _Search(stretches, long, superset, [set(pieces) for pieces in allowed])
    if start is not None:
        search.trials = {(trial.joint, trial.pieces): trial for trial in start.trials}
        for each in start.taken:
            search.take(each)
    search.passes(rungs)
    if start is None:
        search.forget({rung.name for rung in rungs if rung.anew})
        search.passes(rungs)
    search.prune({rung.name for rung in rungs if not rung.shared})
    search.thin()
    return SelectionPath(tuple(search.taken), search.kept, search.ridge, tuple(search.trials.values()))


class _Search:
    """The state of a search."""

    def __init__(
        self, stretches: HeldOutFolds, long: HeldOutFolds, superset: CandidateModel, allowed: list[set[Candidate]]
    ) -> None:
        self.stretches = stretches
        self.long = long
        self.superset = superset
        self.allowed = allowed
        self.chosen: list[set[Candidate]] = [set() for _ in allowed]
        self.taken: list[SelectedCandidate] = []
        self.ridge = np.zeros(superset.count)
        self.trials: dict[tuple[int, tuple[Candidate, ...]], HeldOutTrial] = {}
        self.made: dict[tuple[bool, bool], tuple[tuple[SelectedCandidate, ...], Reduced]] = {}

    @property
    def kept(self) -> NDArray[np.intp]:
        """Positions of the columns that the model has by now."""
        kept = self.superset.own.copy()
        for joint, pieces in enumerate(self.chosen):
            kept[self._columns(joint, pieces)] = True
        return np.flatnonzero(kept)

    def passes(self, rungs: Sequence[CandidateFamily]) -> None:
        """Climb all rungs, again and again until nothing is taken any more."""
        for _ in range(PASSES):
            before = sum(len(pieces) for pieces in self.chosen)
            for rung in rungs:
                for _ in range(rung.rounds):
                    if not self.round(rung):
                        break
            self.round(self.together())
            if sum(len(pieces) for pieces in self.chosen) == before:
                break

    def forget(self, rungs: set[str]) -> None:
        """Take back what joints took of some rungs."""
        for each in tuple(self.taken):
            if each.rung in rungs:
                self._give_back(each)

    def round(self, rung: CandidateFamily) -> bool:
        """Offer every joint one more candidate of a rung; whether any took one."""
        strict = self._left(self.stretches, all_anew=True)
        fair = self._left(self.stretches, all_anew=False)
        elsewhere = self._left(self.long, all_anew=True) if rung.position else None
        offers = self._offers(rung, fair)
        shared = of_the_arm(rung, offers) if rung.shared else None
        taken: list[CandidateGain] = []
        for joint in range(len(self.allowed)):
            own = [offer for offer in offers if offer.joint == joint]
            pick = of_the_joint(rung, own, None if shared is None else [o for o in shared if o.joint == joint])
            if pick is not None and not self._contradicted(pick, strict, elsewhere):
                taken.append(pick)
            self._record(rung, own, pick if pick in taken else None)
        for pick in taken:
            self.take(SelectedCandidate(rung.name, pick.joint, pick.pieces, pick.ridge))
        return bool(taken)

    def together(self) -> CandidateFamily:
        """Return what is large on a joint but not clear by itself, one of each rung: things that hide each other."""
        options: list[tuple[Candidate, ...]] = []
        for joint, chosen in enumerate(self.chosen):
            best: dict[str, HeldOutTrial] = {}
            for trial in self.trials.values():
                open_ = trial.joint == joint and not trial.chosen and chosen.isdisjoint(trial.pieces)
                if open_ and trial.gain > max(LARGE, best[trial.rung].gain if trial.rung in best else 0.0):
                    best[trial.rung] = trial
            pieces = dict.fromkeys(piece for trial in best.values() for piece in trial.pieces)
            if len(best) > 1:
                options.append(tuple(pieces))
        return CandidateFamily("together", tuple(options), position=True, least=LARGE)

    def take(self, taken: SelectedCandidate) -> None:
        """Give a joint what it takes."""
        self.chosen[taken.joint] |= set(taken.pieces)
        self.ridge[self._columns(taken.joint, taken.pieces)] = taken.ridge
        self.taken.append(taken)

    def prune(self, rungs: set[str]) -> None:
        """Let go of what no longer lowers the error once all is together, the last taken first."""
        error = self._errors().sum()
        for each in tuple(reversed(self.taken)):
            if each.rung not in rungs:
                continue
            self.chosen[each.joint] -= set(each.pieces)
            without = self._errors().sum()
            if without < error:
                error = without
                self._give_back(each)
            else:
                self.chosen[each.joint] |= set(each.pieces)

    def thin(self) -> None:
        """Let go of single widths of what was taken together that do not lower the error of their joint.

        The widest stays: motion that turns less often than the recorded needs it, and no stretch says so.
        """
        while True:
            error = self._errors()
            idle: list[tuple[float, SelectedCandidate, Candidate]] = []
            for each in self.taken:
                widths = sorted((p for p in each.pieces if p.term == Hysteresis.name), key=lambda p: p.shape)
                for piece in widths[:-1]:
                    self.chosen[each.joint].discard(piece)
                    lost = self._errors() - error
                    self.chosen[each.joint].add(piece)
                    if lost[each.joint] <= 0.0:
                        idle.append((float(lost[each.joint] / error[each.joint]), each, piece))
            if not idle:
                return
            _, each, piece = min(idle, key=lambda found: found[0])
            rest = tuple(other for other in each.pieces if other != piece)
            self.chosen[each.joint].discard(piece)
            self.taken[self.taken.index(each)] = replace(each, pieces=rest)
            trial = self.trials.pop((each.joint, each.pieces))
            self.trials[each.joint, rest] = replace(trial, pieces=rest)

    def _left(self, stretches: HeldOutFolds, *, all_anew: bool) -> Reduced:
        """Return what the model by now leaves, made anew only where it has changed."""
        key, state = (stretches is self.long, all_anew), tuple(self.taken)
        if key not in self.made or self.made[key][0] != state:
            self.made[key] = state, stretches.reduced(self.kept, self.ridge, all_anew=all_anew)
        return self.made[key][1]

    def _give_back(self, taken: SelectedCandidate) -> None:
        self.chosen[taken.joint] -= set(taken.pieces)
        self.taken.remove(taken)
        key = taken.joint, taken.pieces
        self.trials[key] = replace(self.trials[key], chosen=False)

    def _errors(self) -> Array:
        """Weighted squared error (n,) of each joint on all stretches, all parameters estimated without each."""
        return self.stretches.errors(self.kept, self.ridge).sum(axis=0) * self.stretches.weights**2

    def _columns(self, joint: int, pieces: set[Candidate] | tuple[Candidate, ...]) -> NDArray[np.intp]:
        found = [self.superset.columns[joint, piece] for piece in pieces]
        return np.concatenate([np.zeros(0, dtype=np.intp), *found])

    def _offers(self, rung: CandidateFamily, reduced: Reduced) -> list[CandidateGain]:
        """All candidates of a rung on all joints."""
        offers: list[CandidateGain] = []
        for joint, allowed in enumerate(self.allowed):
            free = allowed - self.chosen[joint]
            done = {piece.term for piece in self.chosen[joint]} & ONE_SHAPE
            seen: set[tuple[Candidate, ...]] = set()
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
                        changes = proportions(gains[0], squares)
                        offers.append(CandidateGain(joint, option, left, ridge, gains[0] / squares.sum(), changes))
        return offers

    def _contradicted(self, pick: CandidateGain, strict: Reduced, elsewhere: Reduced | None) -> bool:
        """Tell whether the stricter ways of judging speak against a candidate."""
        columns = self._columns(pick.joint, pick.pieces)
        gains = strict.gains(pick.joint, columns, pick.ridge)
        if gains is None or any(each.sum() < -CONTRARY * standard_error(each) for each in gains):
            return True
        if elsewhere is None:
            return False
        if gains[0].sum() <= 0.0:
            return True
        gains = elsewhere.gains(pick.joint, columns, pick.ridge)
        if gains is None:
            return True
        own, squares = gains[0], elsewhere.squares[:, pick.joint]
        return bool(own.sum() <= 0.0 and proportions(own, squares).sum() >= 0.0)

    def _record(self, rung: CandidateFamily, own: list[CandidateGain], pick: CandidateGain | None) -> None:
        """Keep the better shrinkage of every candidate as evidence."""
        for offer in sorted(own, key=lambda offer: (offer is pick, offer.gain)):
            deviation = standard_error(offer.gains)
            self.trials[offer.joint, offer.pieces] = HeldOutTrial(
                offer.joint, rung.name, offer.pieces, offer.gain, deviation, offer is pick
            )
