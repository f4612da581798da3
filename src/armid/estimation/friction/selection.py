"""The friction ladder: which friction each joint has, as unseen motion judges it.

Hysteresis at reversals, friction under load, velocity laws, ripple and asymmetry stand beside the model as
candidates. All of their columns are made once; the rest is small algebra on the factors (`friction_search`). A prior
keeps the bodies near the description, since data that leave the bodies open cannot tell friction from them; its
weight is found on the same stretches. What is chosen are ordinary torque terms: the estimate itself is made the usual
way, from a model that has them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from armid.errors import EstimationError
from armid.estimation.crossvalidation import can_cross_validate, folds, one_standard_error
from armid.estimation.estimate import torque_parameters
from armid.estimation.estimators.ridge import Ridge
from armid.estimation.friction.candidates import (
    RUNGS,
    Candidate,
    CandidateModel,
    candidate_model,
    candidates,
    described,
    terms_of,
)
from armid.estimation.friction.heldout_gains import GainPrior, HeldOutFolds, make_folds
from armid.estimation.friction.search import HeldOutTrial, SelectionPath, select_forward
from armid.estimation.friction.shape_fit import refine
from armid.estimation.per_recording import contrasted, offset_names, separate_by_recording
from armid.estimation.prior import make_prior, project_covariance
from armid.estimation.problem import EstimationProblem, standard_of
from armid.estimation.whitening import WhitenedSystem, whiten
from armid.information.accumulate import accumulate_information
from armid.information.information import Information, restrict, total
from armid.maths.linalg import inverse_of
from armid.measurement.observations import Observations
from armid.model.base_parameters import find_base_parameters
from armid.model.dynamics import DynamicsModel
from armid.model.terms import LoadCoulomb, Term
from armid.values import Array

__all__ = ["FrictionSelection", "SelectionEvidence", "choose_friction"]

FOLDS = 8
"""Stretches that are left out in turn: each trains on most of the data, and a standard error has seven degrees."""

LONG = 3
"""Long stretches, in which other poses come than in the rest: what imitates gravity fails there."""

FEWEST = 8
"""Blocks below which nothing is chosen: a few seconds of motion are no evidence for or against friction."""

LOWEST = 1e-3
"""Ratios below count as this where a deviation is divided by them; noise-free data would give none."""

STRENGTHS = np.logspace(4.0, -4.0, 17)
"""Weights of the prior that are tried, strongest first, in independent samples."""


@dataclass(frozen=True, slots=True)
class SelectionEvidence:
    """Evidence of left-out stretches for a candidate on a joint, beside what the joint then had.

    Attributes:
        joint: Name of the joint.
        rung: The kind of friction.
        candidate: The terms in words, with their shapes.
        ratio: Held-out RMS with it over that without.
        deviation: Standard error of the ratio, from the scatter between stretches.
        chosen: Whether the joint has it.
    """

    joint: str
    rung: str
    candidate: str
    ratio: float
    deviation: float
    chosen: bool


@dataclass(frozen=True, eq=False, slots=True)
class FrictionSelection:
    """Friction that was chosen, and why.

    Attributes:
        model: The model with the chosen terms, and with `load_parameters` where one of them needs the load.
        added: The terms that were added, restricted to their joints.
        evidence: Every candidate of every joint that was looked at.
        ratio: Held-out RMS with the chosen terms over that without, shape (n,); one where nothing was judged. It is
            that of the stretches that made the choice, so it is optimistic; a recording for validation is not.
        deviation: Standard error of the ratio, shape (n,).
        prior_weight: Weight of the prior towards the description that errs least on stretches left out, in
            independent samples of the data as the chosen model explains them: what an estimate with this model best
            uses. Friction was chosen under one as strong or stronger. `None` where nothing was judged, or where the
            unit is not known.
        offset_per_recording: Whether each recording had an offset of its own, as the estimate then should.
        why: Why nothing was looked at, or why there is no prior's weight; empty where all is as it should be.
    """

    model: DynamicsModel
    added: tuple[Term, ...]
    evidence: tuple[SelectionEvidence, ...]
    ratio: Array
    deviation: Array
    prior_weight: float | None
    offset_per_recording: bool = False
    why: str = ""


def choose_friction(model: DynamicsModel, observations: Observations, *, threads: int = 1) -> FrictionSelection:
    """Choose friction for each joint by the error on stretches of motion that were left out.

    Args:
        model: Arm with the terms that it has in any case: rigid bodies, viscous and Coulomb friction, offset.
        observations: The training recordings.
        threads: Threads of the kernel.

    Raises:
        ArmidError: No row counts.
    """
    base = find_base_parameters(model)
    problem = EstimationProblem(
        accumulate_information(model, base, observations, threads=threads), standard_of(model, base), model, base
    )
    used = int(problem.information.rows.any(axis=1).sum())
    if used < FEWEST:
        ones = np.ones(model.n)
        why = f"{used} blocks of rows are too few to judge friction on; {FEWEST} are the least."
        return FrictionSelection(model, (), (), ones, np.zeros(model.n), None, why=why)
    drifting = _drifting(problem.information, model)
    data = contrasted(problem.information, drifting)
    weighted = whiten(data)
    strong, best, prior = _prior(problem, data, weighted)
    loaded = _loaded(problem, strong)
    allowed = candidates(loaded, observations)

    def widen(pieces: Sequence[frozenset[Candidate]]) -> tuple[CandidateModel, Information]:
        wide = candidate_model(loaded, base, pieces)
        information = contrasted(
            accumulate_information(wide.model, wide.base, observations, threads=threads), drifting
        )
        return replace(wide, own=np.append(wide.own, np.ones(information.count - wide.count, np.bool_))), information

    def climbed(start: SelectionPath | None) -> tuple[CandidateModel, Information, HeldOutFolds, SelectionPath]:
        own = [frozenset[Candidate]()] * model.n if start is None else start.chosen(model.n)
        may = [pieces | more for pieces, more in zip(allowed, own, strict=True)]
        wide, information = widen(may)
        spread = prior.spread(wide.count, np.flatnonzero(wide.own))
        stretches, long = (
            make_folds(information, folds(information, count), weighted.weights, spread) for count in (FOLDS, LONG)
        )
        return wide, information, stretches, select_forward(stretches, long, wide, may, RUNGS, start)

    first = climbed(None)[-1]
    refined = refine(first, widen, prior, weighted.weights, model.n)
    wide, information, stretches, found = climbed(refined)
    added = terms_of(loaded, found.chosen(model.n))
    needs = any(isinstance(term, LoadCoulomb) for term in added)
    chosen = replace(loaded if needs else model, terms=(*model.terms, *added))
    handed, why = _handed_on(best * weighted.correlation, restrict(information, found.kept))
    outcome = _outcome(stretches, wide, found)
    return FrictionSelection(chosen, added, _evidence(model, found.trials), *outcome, handed, bool(drifting), why)


def _drifting(information: Information, model: DynamicsModel) -> tuple[str, ...]:
    """Parameters that each recording may have for itself: offsets, since a sensor is zeroed anew and drifts.

    None where there is one recording, or one in which a joint does not count or that is too short to be cut: such
    offsets could not be estimated and validated.
    """
    names = offset_names(model)
    own = np.isin(information.names, names)
    recordings = np.unique(information.recording[information.rows.any(axis=1)])
    told = all(information.rows[information.recording == each].any(axis=0).all() for each in recordings)
    if len(recordings) < 2 or not own.any() or not told:
        return ()
    return names if can_cross_validate(separate_by_recording(information, own), FOLDS) else ()


def _loaded(problem: EstimationProblem, weight: float) -> DynamicsModel:
    """The model with the bodies of a first estimate for what depends on the load, unless it knows them already."""
    model, base = problem.model, problem.base
    assert model is not None and base is not None  # `choose_friction` gives them
    if model.load_parameters is not None or not model.has_rigid_bodies:
        return model
    theta = torque_parameters(base, Ridge(weight=weight).estimate(problem))
    return replace(model, load_parameters=theta[model.inertial_columns].reshape(model.n, 10))


def _handed_on(rows: float, information: Information) -> tuple[float | None, str]:
    """Weight of the prior in independent samples as the chosen model explains them, and why there is none.

    Args:
        rows: The weight in rows.
        information: For the chosen model.
    """
    try:
        return rows / whiten(information).correlation, ""
    except EstimationError as error:  # weights that do not settle, where rows hardly outnumber the parameters
        return None, (
            "The prior's weight is left to the method: how many rows of the chosen model count as one independent "
            f"sample is not known. {error.problem}"
        )


def _prior(problem: EstimationProblem, data: Information, weighted: WhitenedSystem) -> tuple[float, float, GainPrior]:
    """Weights of the prior on the base parameters by stretches left out: to choose under, to estimate with.

    Friction is chosen under the strongest prior that is within a standard error of the best one: bodies that give way
    to friction look as good on the same recording and fail on others. It is estimated with the best.

    Args:
        problem: With the model's own parameters.
        data: Its information with what differs between recordings.
        weighted: The same, whitened.

    Returns:
        The stronger weight, the best, and the prior with the stronger.
    """
    standard = problem.require_standard("friction ladder")
    whole = total(problem.information)
    belief = make_prior("log-det" if standard.described else "mass", standard, replace(weighted, whole=whole))
    mean = standard.regrouping @ belief.mean
    precision = weighted.correlation * inverse_of(project_covariance(belief.precision, standard.regrouping))
    kept, ridge = np.arange(data.count), np.zeros(data.count)
    stretches = make_folds(
        data, folds(data, FOLDS), weighted.weights, GainPrior(mean, 0.0 * precision).spread(data.count, kept)
    )
    errors = np.stack(
        [
            replace(stretches, prior=GainPrior(mean, strength * precision).spread(data.count, kept)).errors(
                kept, ridge
            )
            @ weighted.weights**2
            for strength in STRENGTHS
        ]
    )
    strong, best = (float(STRENGTHS[k]) for k in (one_standard_error(errors), int(np.argmin(errors.sum(axis=1)))))
    return strong, best, GainPrior(mean, strong * precision)


def _outcome(stretches: HeldOutFolds, wide: CandidateModel, found: SelectionPath) -> tuple[Array, Array]:
    """Held-out RMS of each joint with the chosen friction over that without, and its standard error, shapes (n,)."""
    own = np.flatnonzero(wide.own)
    without = stretches.errors(own, found.ridge)
    with_ = stretches.errors(found.kept, found.ridge)
    total = np.where(without.sum(axis=0) > 0.0, without.sum(axis=0), 1.0)
    ratio = np.sqrt(np.where(without.sum(axis=0) > 0.0, with_.sum(axis=0) / total, 1.0))
    scatter = np.std((with_ - ratio**2 * without) / total, axis=0, ddof=1) * np.sqrt(len(without))
    return ratio, scatter / (2.0 * np.maximum(ratio, LOWEST))


def _evidence(model: DynamicsModel, trials: Sequence[HeldOutTrial]) -> tuple[SelectionEvidence, ...]:
    """Trials in words, joint by joint."""
    names = model.robot.joint_names
    return tuple(
        SelectionEvidence(
            names[trial.joint],
            trial.rung,
            described(trial.pieces),
            trial.ratio,
            trial.deviation / (2.0 * max(trial.ratio, LOWEST)),
            trial.chosen,
        )
        for trial in sorted(trials, key=lambda trial: trial.joint)
    )
