"""Friction selection: torque terms for the friction of each joint, selected by the error on held-out folds.

The candidates are hysteresis at reversals, load-dependent friction, velocity laws, ripple and asymmetry. Their
columns are computed once; the forward selection (`forward_selection`) then uses only the triangular factors. Data
that do not determine the bodies cannot distinguish them from friction. Therefore a prior keeps the bodies near the
description; its weight is chosen on the same folds. The result is a model with ordinary torque terms, which is then
estimated like any other model.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.errors import EstimationError
from armid.estimation.crossvalidation import can_cross_validate, folds
from armid.estimation.estimators.ridge import Ridge
from armid.estimation.friction.apparent_inertia import with_signed_inertia
from armid.estimation.friction.body_prior import (
    CONSISTENT,
    CONSISTENT_WEIGHT,
    choose_prior,
    make_body_prior,
    suitable_method,
    weight_for_estimate,
    with_load_parameters,
)
from armid.estimation.friction.candidates import (
    Candidate,
    CandidateModel,
    allowed_candidates,
    candidate_model,
    depends_on_load,
    describe,
    friction_families,
    terms_of,
)
from armid.estimation.friction.forward_selection import HeldOutTrial, SelectionPath, select_forward
from armid.estimation.friction.heldout_gains import HeldOutFolds, make_folds
from armid.estimation.friction.shape_fit import refine_shapes
from armid.estimation.friction_per_recording import contrasted, offset_names, separate_by_recording
from armid.estimation.problem import build_problem
from armid.estimation.whitened_system import whiten
from armid.information.accumulate import accumulate_information
from armid.information.hysteresis_states import without_creep
from armid.information.information import Information, JointFactors, restrict
from armid.measurement.observations import Observations
from armid.model.base_parameters import find_base_parameters
from armid.model.dynamics_model import DynamicsModel
from armid.model.terms import Term

FOLDS = 8
"""Number of folds. Each fold leaves most of the data for training, and a standard error over the folds has seven
degrees of freedom."""

LONG = 3
"""Number of long folds of a single recording. Their poses differ from those of the other folds, so a law that
imitates gravity increases the error on them. Where there are several recordings, each of them is a long fold."""

FEWEST = 8
"""Smallest number of blocks of rows for a selection: a few seconds of motion are no evidence for or against a
friction term."""

LOWEST = 1e-3
"""Lower limit of an error ratio by which a standard deviation is divided: noise-free data have ratios of zero."""

LOAD_WEIGHT = 1.0
"""Weight of the prior of the first estimate, from which the load is computed [independent samples]."""


@dataclass(frozen=True, slots=True)
class SelectionEvidence:
    """Held-out errors as evidence for or against a candidate on a joint.

    Attributes:
        joint: Name of the joint.
        family: The kind of friction.
        candidate: Names of the terms, with their shapes.
        ratio: Ratio of the held-out RMS errors with and without the candidate, in the last trial of the candidate.
        deviation: Standard error of the ratio, from the scatter between folds.
        chosen: True if the candidate was selected for the joint.
    """

    joint: str
    family: str
    candidate: str
    ratio: float
    deviation: float
    chosen: bool


@dataclass(frozen=True, eq=False, slots=True)
class FrictionSelection:
    """Selected friction with its evidence.

    Attributes:
        model: The model with the selected terms, and with `load_parameters` if one of the terms depends on the load.
        added: The terms that were added, restricted to their joints.
        evidence: Every candidate of every joint that was tried.
        ratio: Ratio of the held-out RMS errors with and without the selected terms, shape (n,); 1 if nothing was
            tried. The same folds were used for the selection, so the ratio is optimistic; a validation recording
            gives an unbiased ratio.
        deviation: Standard error of the ratio, shape (n,).
        prior_weight: Weight of the prior with the smallest held-out error, in independent samples under the selected
            model; the estimate of this model should use it. The selection used this weight or a larger one. `None` if
            nothing was tried, or if the number of independent samples is not known.
        offset_per_recording: True if each recording had its own offset of the torque; the estimate should then do the
            same.
        why: Reason why no candidate was tried, or why there is no weight of the prior; otherwise empty.
        noise: Standard deviation of each joint's noise, shape (n,) [N·m or N], from the residual of the model without
            further friction; the weights of the rows follow from it. Empty if no candidate was tried.
        method: Estimator that is suitable: `physical` or `ridge`.
    """

    model: DynamicsModel
    added: tuple[Term, ...]
    evidence: tuple[SelectionEvidence, ...]
    ratio: Array
    deviation: Array
    prior_weight: float | None
    offset_per_recording: bool = False
    why: str = ""
    noise: tuple[float, ...] = ()
    method: str = Ridge.name

    def weight_for(self, method: str) -> float | None:
        """Weight of the prior for the estimator `method`, in independent samples; `None` if it is not known."""
        return CONSISTENT_WEIGHT if self.noise and method == CONSISTENT else self.prior_weight


def choose_friction(model: DynamicsModel, observations: Observations, *, threads: int = 1) -> FrictionSelection:
    """Selects friction terms for each joint by the error on held-out folds.

    Args:
        model: Arm with the terms that are not selected: rigid bodies, viscous and Coulomb friction, offset.
        observations: The training recordings.
        threads: Threads of the kernel.

    Raises:
        ArmidError: No row is in use.
    """
    base = find_base_parameters(model)
    observations = without_creep(observations)
    problem = build_problem(model, observations, base=base, threads=threads)
    blocks = int(problem.information.rows.any(axis=1).sum())
    if blocks < FEWEST:
        why = f"{blocks} blocks of rows are too few to select friction: at least {FEWEST} are needed."
        return FrictionSelection(model, (), (), np.ones(model.n), np.zeros(model.n), None, why=why)
    drifting = _drifting_offsets(problem.information, model)
    model, problem = with_signed_inertia(problem, CONSISTENT_WEIGHT, drifting)
    loaded = with_load_parameters(problem, LOAD_WEIGHT)
    allowed = allowed_candidates(loaded, observations)

    def extend(candidates: Sequence[frozenset[Candidate]]) -> tuple[CandidateModel, Information]:
        extended = candidate_model(loaded, base, candidates)
        information = contrasted(
            accumulate_information(extended.model, extended.base, observations, threads=threads), drifting
        )
        in_model = np.append(extended.in_model, np.ones(information.count - extended.count, np.bool_))
        return replace(extended, in_model=in_model), information

    at_first = extend(allowed)
    data = restrict(at_first[1], np.flatnonzero(at_first[0].in_model))
    weighted = whiten(data)
    bodies = make_body_prior(problem, weighted)
    first_weight, prior = choose_prior(bodies, data, weighted.weights)

    def select_from(start: SelectionPath | None) -> tuple[CandidateModel, Information, HeldOutFolds, SelectionPath]:
        started = [frozenset[Candidate]()] * model.n if start is None else start.chosen(model.n)
        available = [candidates | selected for candidates, selected in zip(allowed, started, strict=True)]
        extended, information = at_first if start is None else extend(available)
        embedded = prior.embedded(extended.count, own := np.flatnonzero(extended.in_model))
        short_folds = make_folds(information, folds(information, FOLDS), weighted.weights, embedded, own)
        common = _common_offsets(information, extended.base.count)
        long_folds = make_folds(common, _apart(information), weighted.weights, embedded, own)
        path = select_forward(short_folds, long_folds, extended, available, friction_families(), start)
        return extended, information, short_folds, path

    refined = refine_shapes(select_from(None)[-1], extend, prior, weighted.weights, allowed)
    extended, information, short_folds, path = select_from(refined)
    added = terms_of(loaded, path.chosen(model.n))
    chosen = _with_terms(model, loaded, added)
    noise = tuple(float(each) for each in 1.0 / weighted.weights)
    method, contradicted = suitable_method(problem, weighted, drifting, first_weight)
    errors = bodies.errors(short_folds, np.flatnonzero(extended.in_model), path.columns, path.ridge)
    rows = weighted.correlation * weight_for_estimate(errors, contradicted=contradicted)
    prior_weight, why = _weight_in_samples(rows, restrict(information, path.columns), noise)
    ratio = _error_ratio(short_folds, extended, path)
    tried = _evidence(model, path.trials)
    return FrictionSelection(chosen, added, tried, *ratio, prior_weight, bool(drifting), why, noise, method)


def _with_terms(model: DynamicsModel, loaded: DynamicsModel, added: tuple[Term, ...]) -> DynamicsModel:
    """Model with added terms, and with the load parameters of `loaded` if one of these terms depends on the load."""
    needs_load = depends_on_load(law for term in added for law in term.laws(model.robot))
    return replace(loaded if needs_load else model, terms=(*model.terms, *added))


def _drifting_offsets(information: Information, model: DynamicsModel) -> tuple[str, ...]:
    """Names of the torque offsets that may differ between recordings, because torque sensors drift and are zeroed.

    The result is empty if separate offsets cannot be estimated and cross-validated: there is only one recording, a
    recording has no rows of some joint, or a recording is too short for the folds.
    """
    names = offset_names(model)
    is_offset = np.isin(information.names, names)
    recordings = np.unique(information.recording[information.rows.any(axis=1)])
    every_joint_counts = all(information.rows[information.recording == each].any(axis=0).all() for each in recordings)
    if len(recordings) < 2 or not is_offset.any() or not every_joint_counts:
        return ()
    return names if can_cross_validate(separate_by_recording(information, is_offset), FOLDS) else ()


def _common_offsets(information: Information, count: int) -> Information:
    """Information in which the offsets are common to all recordings: the columns of their differences become zero.

    Args:
        information: Information with parameters for the differences between recordings last.
        count: Number of parameters before these.
    """
    joints: list[JointFactors] = []
    for joint in information.joints:
        R = joint.R.copy()
        R[:, :, np.flatnonzero(joint.parameters >= count)] = 0.0
        joints.append(replace(joint, R=R))
    return replace(information, joints=tuple(joints))


def _apart(information: Information) -> NDArray[np.int64]:
    """Index of the long fold of each block: one fold for each recording, or long parts of a single recording."""
    recordings = np.unique(information.recording[information.rows.any(axis=1)])
    if len(recordings) < 2:
        return folds(information, LONG)
    return np.minimum(np.searchsorted(recordings, information.recording), len(recordings) - 1).astype(np.int64)


def _weight_in_samples(rows: float, information: Information, noise: tuple[float, ...]) -> tuple[float | None, str]:
    """Weight of the prior in independent samples under the selected model, or `None` and the reason.

    Args:
        rows: Weight of the prior in units of one row.
        information: Information about the selected model.
        noise: Standard deviation of each joint's noise.
    """
    try:
        return rows / whiten(information, noise=noise).correlation, ""
    except EstimationError as error:
        return None, (
            "The weight of the prior is determined by the method, because the number of rows of the selected model "
            f"that count as one independent sample is not known. {error.problem}"
        )


def _error_ratio(short_folds: HeldOutFolds, extended: CandidateModel, path: SelectionPath) -> tuple[Array, Array]:
    """Ratio (n,) of the held-out RMS errors with and without the selected friction, and its standard error (n,)."""
    in_model = np.flatnonzero(extended.in_model)
    without = short_folds.errors(in_model, path.ridge)
    with_ = short_folds.errors(path.columns, path.ridge)
    total = np.where(without.sum(axis=0) > 0.0, without.sum(axis=0), 1.0)
    ratio = np.sqrt(np.where(without.sum(axis=0) > 0.0, with_.sum(axis=0) / total, 1.0))
    scatter = np.std((with_ - ratio**2 * without) / total, axis=0, ddof=1) * np.sqrt(len(without))
    return ratio, scatter / (2.0 * np.maximum(ratio, LOWEST))


def _evidence(model: DynamicsModel, trials: Sequence[HeldOutTrial]) -> tuple[SelectionEvidence, ...]:
    """Evidence of all trials, sorted by joint."""
    names = model.robot.joint_names
    return tuple(
        SelectionEvidence(
            names[trial.joint],
            trial.family,
            describe(trial.candidates),
            trial.ratio,
            trial.deviation / (2.0 * max(trial.ratio, LOWEST)),
            trial.chosen,
        )
        for trial in sorted(trials, key=lambda trial: trial.joint)
    )
