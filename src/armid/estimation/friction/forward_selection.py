"""Forward selection of friction candidates, family by family and joint by joint, by the error on held-out folds.

The module `acceptance` contains the rules of acceptance. The gain of a candidate is first computed with all other
parameters estimated from all data, because this gain has far less scatter if the bodies have many parameters. Then
the gain is checked with all parameters estimated without the fold. A candidate that depends on the pose could imitate
gravity. Such a candidate must therefore reduce the error in this check, and also on long folds, which contain other
poses.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.estimation.friction.acceptance import (
    LARGE,
    REJECTION_MARGIN,
    CandidateGain,
    choose_for_arm,
    choose_for_joint,
    error_log_ratios,
    standard_error,
)
from armid.estimation.friction.candidates import Candidate, CandidateFamily, CandidateModel, choice_of
from armid.estimation.friction.heldout_gains import HeldOutFolds, Reduced

SHRINKAGE = 0.01
"""Shrinkage of the added friction columns in trial and estimate. The unit is the squared length of the part of each
column that the model without candidates does not explain. The value is just enough to distribute a torque among
similar columns. In units of the whole column, a law that resembles viscous friction was shrunk by a tenth to a third,
far outside its interval."""

PASSES = 4
"""Largest number of passes over all families: a small effect becomes significant only after larger effects are in the
model."""

LEAST_WIDTH_GAIN = 0.002
"""Smallest reduction of a joint's squared held-out error, as a share of this error, with which a single width of
hysteresis stays in the model. With 0.005, a joint of a simulated arm with two elements of hysteresis had 1.37 times
the error of a model with the true friction."""

CLEAR_REMAINDER = 0.5
"""Number of standard errors by which the remaining widths of a hysteresis option must together reduce the held-out
error; otherwise the option is withdrawn. Without this limit, the widest width, which is never removed as a single
width, made the error of joint 3 of the iiwa 14 on a left-out segment 1.29 times that of plain least squares, and
three widths stayed on a joint without hysteresis. An additional minimum of 1 % costs the LWR4+ a tenth of its
accuracy on the other recording, which is faster."""


@dataclass(frozen=True, slots=True)
class HeldOutTrial:
    """Trial of an option on a joint: the option is added to the model that is selected so far.

    Attributes:
        joint: Index of the joint.
        family: The kind of friction.
        candidates: Friction candidates that the option adds together.
        gain: Reduction of the joint's squared held-out error, as a share of this error; negative if the error
            increases.
        deviation: Standard error of the gain, from the scatter between folds.
        chosen: True if the option was selected.
    """

    joint: int
    family: str
    candidates: tuple[Candidate, ...]
    gain: float
    deviation: float
    chosen: bool

    @property
    def ratio(self) -> float:
        """Ratio of the held-out RMS errors with and without the option."""
        return float(np.sqrt(max(1.0 - self.gain, 0.0)))


@dataclass(frozen=True, slots=True)
class SelectedCandidate:
    """Option that was selected for a joint in one round.

    Attributes:
        family: The kind of friction.
        joint: Index of the joint.
        candidates: Friction candidates that the option adds together.
        ridge: Shrinkage of the columns of the option in its trial, in shares of the squared length of each column.
    """

    family: str
    joint: int
    candidates: tuple[Candidate, ...]
    ridge: float


@dataclass(frozen=True, eq=False, slots=True)
class SelectionPath:
    """Result of a forward selection.

    Attributes:
        selected: Selected options in the order of selection, without the options that were withdrawn later.
        columns: Positions of the columns of the extended model that the selected model contains.
        ridge: Shrinkage of each column of the extended model, in shares of its squared length, shape (b,).
        trials: Last trial of every option on every joint.
    """

    selected: tuple[SelectedCandidate, ...]
    columns: NDArray[np.intp]
    ridge: Array
    trials: tuple[HeldOutTrial, ...]

    def chosen(self, joints: int) -> tuple[frozenset[Candidate], ...]:
        """Set of the selected candidates of each joint; `joints` is the number of joints."""
        by_joint: list[set[Candidate]] = [set() for _ in range(joints)]
        for each in self.selected:
            by_joint[each.joint] |= set(each.candidates)
        return tuple(frozenset(candidates) for candidates in by_joint)


def select_forward(
    short_folds: HeldOutFolds,
    long_folds: HeldOutFolds,
    extended: CandidateModel,
    allowed: Sequence[frozenset[Candidate]],
    families: Sequence[CandidateFamily],
    start: SelectionPath | None = None,
) -> SelectionPath:
    """Selects friction candidates by forward selection on held-out folds.

    Args:
        short_folds: Data of the extended model in folds.
        long_folds: The same data in a few long folds, on which pose-dependent candidates must reduce the error,
            too.
        extended: The model with all candidates.
        allowed: Candidates that may be selected for each joint.
        families: Families to try, in this order.
        start: Selection to continue; if not given, the search starts with the model without candidates.
    """
    search = _Search(short_folds, long_folds, extended, [set(candidates) for candidates in allowed])
    if start is not None:
        search.trials = {(trial.joint, trial.candidates): trial for trial in start.trials}
        for each in start.selected:
            search.add(each)
    search.try_families(families)
    if start is None:
        search.withdraw({family.name for family in families if family.reselect})
        search.try_families(families)
    search.prune({family.name for family in families if not family.shared})
    search.drop_widths()
    search.withdraw_remainders()
    return SelectionPath(tuple(search.selected), search.columns, search.ridge, tuple(search.trials.values()))


class _Search:
    """State of a forward selection."""

    def __init__(
        self,
        short_folds: HeldOutFolds,
        long_folds: HeldOutFolds,
        extended: CandidateModel,
        allowed: list[set[Candidate]],
    ) -> None:
        self.short_folds = short_folds
        self.long_folds = long_folds
        self.extended = extended
        self.allowed = allowed
        self.chosen: list[set[Candidate]] = [set() for _ in allowed]
        self.selected: list[SelectedCandidate] = []
        self.ridge = np.zeros(extended.count)
        self.trials: dict[tuple[int, tuple[Candidate, ...]], HeldOutTrial] = {}
        self.cache: dict[tuple[bool, bool], tuple[tuple[SelectedCandidate, ...], Reduced]] = {}

    @property
    def columns(self) -> NDArray[np.intp]:
        """Positions of the columns of the extended model that the present model contains."""
        kept = self.extended.in_model.copy()
        for joint, candidates in enumerate(self.chosen):
            kept[self._columns(joint, candidates)] = True
        return np.flatnonzero(kept)

    def try_families(self, families: Sequence[CandidateFamily]) -> None:
        """Tries all families repeatedly, until no further option is selected."""
        for _ in range(PASSES):
            before = sum(len(candidates) for candidates in self.chosen)
            for family in families:
                for _ in range(family.rounds):
                    if not self.try_family(family):
                        break
            self.try_family(self.combined())
            if sum(len(candidates) for candidates in self.chosen) == before:
                break

    def withdraw(self, families: set[str]) -> None:
        """Withdraws all selected options of some families."""
        for each in tuple(self.selected):
            if each.family in families:
                self._withdraw(each)

    def try_family(self, family: CandidateFamily) -> bool:
        """Adds the best acceptable option of a family to each joint; true if an option was added."""
        strict = self._reduced(self.short_folds, refit_all=True)
        all_data = self._reduced(self.short_folds, refit_all=False)
        on_long_folds = self._reduced(self.long_folds, refit_all=True) if family.position else None
        measured = self._measured(family, all_data)
        shared = choose_for_arm(family, measured) if family.shared else None
        selected: list[CandidateGain] = []
        for joint in range(len(self.allowed)):
            of_joint = [each_gain for each_gain in measured if each_gain.joint == joint]
            choice = choose_for_joint(
                family, of_joint, None if shared is None else [o for o in shared if o.joint == joint]
            )
            if choice is not None and not self._contradicted(choice, strict, on_long_folds):
                selected.append(choice)
            self._record(family, of_joint, choice if choice in selected else None)
        for choice in selected:
            self.add(SelectedCandidate(family.name, choice.joint, choice.candidates, choice.ridge))
        return bool(selected)

    def combined(self) -> CandidateFamily:
        """Makes a family with at most one option for each joint, which combines options that were not accepted.

        Two effects that are missing in the model can hide each other. So for each joint, the best option of every
        family becomes part of the combination if its gain is above `LARGE`, although it was not significant.
        """
        options: list[tuple[Candidate, ...]] = []
        for joint, chosen in enumerate(self.chosen):
            best: dict[str, HeldOutTrial] = {}
            for trial in self.trials.values():
                is_open = trial.joint == joint and not trial.chosen and chosen.isdisjoint(trial.candidates)
                if is_open and trial.gain > max(LARGE, best[trial.family].gain if trial.family in best else 0.0):
                    best[trial.family] = trial
            candidates = dict.fromkeys(candidate for trial in best.values() for candidate in trial.candidates)
            if len(best) > 1:
                options.append(tuple(candidates))
        return CandidateFamily("together", tuple(options), position=True, min_gain=LARGE)

    def add(self, selected: SelectedCandidate) -> None:
        """Adds a selected option to the model."""
        self.chosen[selected.joint] |= set(selected.candidates)
        self.ridge[self._columns(selected.joint, selected.candidates)] = selected.ridge
        self.selected.append(selected)

    def prune(self, families: set[str]) -> None:
        """Removes options of some families that no longer reduce the held-out error of the whole model.

        The option that was selected last is tested first.
        """
        error = self._errors().sum()
        for each in tuple(reversed(self.selected)):
            if each.family not in families:
                continue
            self.chosen[each.joint] -= set(each.candidates)
            without = self._errors().sum()
            if without < error:
                error = without
                self._withdraw(each)
            else:
                self.chosen[each.joint] |= set(each.candidates)

    def drop_widths(self) -> None:
        """Removes single widths of hysteresis terms that hardly reduce the held-out error of their joint.

        The largest width is kept: it is needed for motions with fewer reversals than the recorded motion, and no fold
        contains such a motion.
        """
        while True:
            error = self._errors()
            removable: list[tuple[float, SelectedCandidate, Candidate]] = []
            for each in self.selected:
                widths = sorted((p for p in each.candidates if choice_of(p.term).is_sum), key=lambda p: p.shape)
                for candidate in widths[:-1]:
                    self.chosen[each.joint].discard(candidate)
                    increase = self._errors() - error
                    self.chosen[each.joint].add(candidate)
                    if increase[each.joint] <= LEAST_WIDTH_GAIN * error[each.joint]:
                        removable.append((float(increase[each.joint] / error[each.joint]), each, candidate))
            if not removable:
                return
            _, each, candidate = min(removable, key=lambda entry: entry[0])
            others = tuple(other for other in each.candidates if other != candidate)
            self.chosen[each.joint].discard(candidate)
            self.selected[self.selected.index(each)] = replace(each, candidates=others)
            trial = self.trials.pop((each.joint, each.candidates))
            self.trials[each.joint, others] = replace(trial, candidates=others)

    def withdraw_remainders(self) -> None:
        """Withdraws hysteresis options whose remaining widths together have no significant gain in the whole model.

        An option is accepted for the gain of all of its widths. The widths that remain after the removal of single
        widths may have no gain: the widest one is never removed as a single width, and it resembles a spring.
        """
        for each in tuple(self.selected):
            if not choice_of(each.candidates[0].term).is_sum:
                continue
            error = self._fold_errors()[:, each.joint]
            self.chosen[each.joint] -= set(each.candidates)
            gains = (self._fold_errors()[:, each.joint] - error) / error.sum()
            self.chosen[each.joint] |= set(each.candidates)
            if gains.sum() <= CLEAR_REMAINDER * standard_error(gains):
                self._withdraw(each)

    def _reduced(self, short_folds: HeldOutFolds, *, refit_all: bool) -> Reduced:
        """Products of the candidates after elimination of the columns of the present model.

        The result is stored until the model changes.

        Args:
            short_folds: Data in folds.
            refit_all: True if all parameters are estimated without the fold; false if only those of a candidate are.
        """
        key, state = (short_folds is self.long_folds, refit_all), tuple(self.selected)
        if key not in self.cache or self.cache[key][0] != state:
            self.cache[key] = state, short_folds.reduced(self.columns, self.ridge, refit_all=refit_all)
        return self.cache[key][1]

    def _withdraw(self, selected: SelectedCandidate) -> None:
        self.chosen[selected.joint] -= set(selected.candidates)
        self.selected.remove(selected)
        key = selected.joint, selected.candidates
        self.trials[key] = replace(self.trials[key], chosen=False)

    def _errors(self) -> Array:
        """Weighted squared error (n,) of each joint on all folds, with all parameters estimated without the fold."""
        return self._fold_errors().sum(axis=0)

    def _fold_errors(self) -> Array:
        """Weighted squared error (F, n) of each joint and fold, with all parameters estimated without the fold."""
        return self.short_folds.errors(self.columns, self.ridge) * self.short_folds.weights**2

    def _columns(self, joint: int, candidates: set[Candidate] | tuple[Candidate, ...]) -> NDArray[np.intp]:
        columns = [self.extended.columns[joint, candidate] for candidate in candidates]
        return np.concatenate([np.zeros(0, dtype=np.intp), *columns])

    def _measured(self, family: CandidateFamily, reduced: Reduced) -> list[CandidateGain]:
        """Gains of all options of a family on all joints."""
        measured: list[CandidateGain] = []
        for joint, allowed in enumerate(self.allowed):
            available = allowed - self.chosen[joint]
            used_terms = {candidate.term for candidate in self.chosen[joint] if choice_of(candidate.term).one_shape}
            seen: set[tuple[Candidate, ...]] = set()
            for option, candidates in enumerate(family.options):
                remaining = tuple(
                    candidate
                    for candidate in candidates
                    if candidate in available and candidate.term not in used_terms
                )
                squares = reduced.squares[:, joint]
                if not remaining or remaining in seen or squares.sum() <= 0.0:
                    continue
                seen.add(remaining)
                columns = self._columns(joint, remaining)
                gains = reduced.gains(joint, columns, SHRINKAGE)
                if gains is not None:
                    changes = error_log_ratios(gains[0], squares)
                    measured.append(
                        CandidateGain(joint, option, remaining, SHRINKAGE, gains[0] / squares.sum(), changes)
                    )
        return measured

    def _contradicted(self, choice: CandidateGain, strict: Reduced, on_long_folds: Reduced | None) -> bool:
        """True if the gain of an option is not confirmed when all parameters are estimated without the fold.

        The option must not increase the error significantly. An option that depends on the pose must reduce the
        error, also on long folds.

        Args:
            choice: Gain of the option, with all other parameters estimated from all data.
            strict: Products with all parameters estimated without the fold.
            on_long_folds: Products on long folds for an option that depends on the pose; otherwise `None`.
        """
        columns = self._columns(choice.joint, choice.candidates)
        gains = strict.gains(choice.joint, columns, choice.ridge)
        if gains is None or any(each.sum() < -REJECTION_MARGIN * standard_error(each) for each in gains):
            return True
        if on_long_folds is None:
            return False
        if gains[0].sum() <= 0.0:
            return True
        gains = on_long_folds.gains(choice.joint, columns, choice.ridge)
        if gains is None:
            return True
        gain, squares = gains[0], on_long_folds.squares[:, choice.joint]
        return bool(gain.sum() <= 0.0 and error_log_ratios(gain, squares).sum() >= 0.0)

    def _record(self, family: CandidateFamily, of_joint: list[CandidateGain], choice: CandidateGain | None) -> None:
        """Records the trials of all options of a family on one joint.

        Args:
            family: The family.
            of_joint: Gains of its options on the joint.
            choice: The option that was selected; `None` if none was.
        """
        for each_gain in sorted(of_joint, key=lambda each_gain: (each_gain is choice, each_gain.gain)):
            deviation = standard_error(each_gain.gains)
            self.trials[each_gain.joint, each_gain.candidates] = HeldOutTrial(
                each_gain.joint, family.name, each_gain.candidates, each_gain.gain, deviation, each_gain is choice
            )
