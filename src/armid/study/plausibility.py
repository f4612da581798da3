"""Plausibility checks of an estimate against its data and the description."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from armid.doctor.checks.dynamics.excitation_weak import WEAK_CONDITION, excitation_severity, poorly_determined
from armid.errors import Finding
from armid.estimation.crossvalidation import FOLDS
from armid.estimation.estimators.physical import NOT_JUDGED
from armid.estimation.fit_result import Fit
from armid.estimation.friction.selection import FEWEST, FrictionSelection
from armid.estimation.per_recording import offset_names
from armid.estimation.problem import EstimationProblem, StandardParameters
from armid.estimation.uncertainty.thresholds import FEWEST_BLOCKS, FEWEST_ROWS
from armid.information.information import Information, stack, total
from armid.maths.linalg import inverse_of, unit_columns
from armid.measurement.log_format_remedies import lines
from armid.measurement.observations import Observations
from armid.model.dynamics import DynamicsModel
from armid.remedy import Remedy, setting
from armid.robot import Robot
from armid.validation.gravity_sign import gravity_finding
from armid.values import Array

FAR = 20.0
"""Factor between the estimated and the described mass of a link from which it is reported."""

NAMED = 4

TELLING = 0.5
"""Share of information from data below which a value is determined by the prior."""


def plausibility_findings(
    model: DynamicsModel, information: Information, problem: EstimationProblem, fit: Fit, *, chosen: bool
) -> list[Finding]:
    """Findings that question an estimate.

    Args:
        model: Arm and torque terms.
        information: Information with one set of friction parameters for all recordings.
        problem: Estimation problem, with its samples.
        fit: The estimate.
        chosen: Whether friction was selected.
    """
    _, _, observations = problem.require_samples("identify")
    found = [
        gravity_finding(model.robot),
        excitation_finding(information, model.robot, observations),
        few_blocks_finding(fit),
        negative_finding(model, fit),
        drift_finding(model, fit),
        weak_finding(problem.information, observations, fit, chosen=chosen),
        far_finding(problem.standard, fit),
    ]
    return [finding for finding in found if finding is not None]


def drift_finding(model: DynamicsModel, fit: Fit) -> Finding | None:
    """Finding on offsets that differ between recordings by more than the joint's RMS residual, or `None`."""
    drifts: list[str] = []
    for parameter in (each for each in model.parameters if each.name in offset_names(model)):
        copies = [k for k, name in enumerate(fit.names) if name.of_all == parameter.name]
        low, high = fit.intervals[copies].T
        values = fit.values[copies]
        if len(copies) > 1 and np.ptp(values) > fit.residual_rms[parameter.number - 1] and low.max() > high.min():
            each = ", ".join(f"{value:.2g}" for value in values)
            drifts.append(f"{parameter.name} {each} {parameter.unit}")
    if not drifts:
        return None
    return Finding(
        "offset-drift",
        "warning",
        "",
        f"Offsets differ between recordings: {'; '.join(drifts)}. The offset of another recording is unknown, so "
        "their mean is used for it, and its prediction interval is wider by their scatter.",
        "zero the torque sensors before a recording, or estimate offsets anew from a short one (armid recalibrate).",
    )


def far_finding(standard: StandardParameters | None, fit: Fit) -> Finding | None:
    """Finding on links whose mass the data do not determine and that is far from the described one, or `None`."""
    standard_fit = fit.standard
    if standard_fit is None or standard is None or standard.nominal is None:
        return None
    masses = standard.inertial[:, 0]
    names = [standard.names[k] for k in masses]
    # By name, since the fit has copies of friction parameters for several recordings.
    values = np.array([standard_fit.values[standard_fit.names.index(name)] for name in names])
    nominal = standard.nominal[masses]
    far = far_masses(values, nominal)
    if not far.any():
        return None
    masses_text = listed_masses(names, values, nominal, far)
    return Finding(
        "mass-far-from-description",
        "warning",
        "",
        f"The data do not determine these masses, and they are far from the description's: {masses_text}. "
        "Torques are not affected, but a simulation of single links is.",
        lines("what data leave open stays near the description", "estimation", physical={"prior": "log-det"}),
    )


def far_masses(found: Array, described: Array) -> NDArray[np.bool_]:
    """Mask of masses (K,) [kg] that are far from those described (K,)."""
    return (described > 0.0) & ((found < described / FAR) | (found > described * FAR))


def listed_masses(names: Sequence[str], found: Array, described: Array, which: NDArray[np.bool_]) -> str:
    """Text on some masses (K,) [kg], with those described (K,)."""
    texts = [
        f"{name} {mass:.3g} kg (described: {nominal:.3g})"
        for name, mass, nominal, wanted in zip(names, found, described, which, strict=True)
        if wanted
    ]
    return ", ".join(texts[:NAMED]) + (" and more" if len(texts) > NAMED else "")


def excitation_finding(information: Information, robot: Robot, observations: Observations) -> Finding | None:
    """Finding on a motion that hardly separates some parameters, or `None`; as by the doctor."""
    _, values, directions = np.linalg.svd(unit_columns(stack(total(information))[0])[0], full_matrices=False)
    condition = float(values[0] / values[-1])
    if condition <= WEAK_CONDITION:
        return None
    fastest = np.max([np.abs(run.motion.dq[run.rows]).max(axis=0) for run in observations.runs], axis=0)
    return Finding(
        "excitation-weak",
        excitation_severity(condition, robot, fastest),
        "",
        poorly_determined(information.names, directions[-1], condition),
        "record a motion that moves all joints together, fast and wide; on other motion the estimate may fail.",
    )


def chosen_finding(selection: FrictionSelection, method: str) -> Finding:
    """Finding on how selected friction is estimated."""
    if selection.prior_weight is None:
        return Finding("friction-not-chosen", "warning", "", selection.why, "record longer, or name the terms.")
    evidence = (
        "Friction was chosen with the links under a prior, whose weight has the smallest error on held-out motion, "
        f"{selection.prior_weight:.3g} independent samples; the estimate is by {method}. The choice holds for speeds "
        "and poses like those recorded."
    )
    return Finding("friction-chosen", "info", "", evidence, "validate on another recording.")


def few_blocks_finding(fit: Fit) -> Finding | None:
    """Finding on intervals that assume white residuals without a test, or `None`."""
    if fit.covariance_kind != "white" or fit.report.whiteness is not None:
        return None
    return Finding(
        "few-blocks",
        "warning",
        "",
        f"Fewer than {FEWEST_BLOCKS} blocks of rows: intervals take residuals as uncorrelated and are too narrow.",
        "record longer.",
    )


def weak_finding(information: Information, observations: Observations, fit: Fit, *, chosen: bool) -> Finding | None:
    """Finding on weak data, where prior, constraints or selected friction determine much of the estimate, or `None`.

    Plain methods refuse parameters that the data do not determine. Methods with a prior give an estimate all the
    same.

    Args:
        information: Information of the training recordings.
        observations: Their observations.
        fit: The estimate.
        chosen: Whether friction was selected.
    """
    if fit.standard is None and not chosen:
        return None
    rows, parameters = int(information.rows.sum()), information.count
    blocks = int(np.count_nonzero(information.rows.any(axis=1)))
    unjudged = fit.standard is not None and fit.standard.prior.how == NOT_JUDGED
    needed = FEWEST if chosen else FOLDS if unjudged else 0
    longer, reasons, weak = 1.0, list[str](), False
    if rows < FEWEST_ROWS * parameters:
        longer = FEWEST_ROWS * parameters / rows
        reasons.append(f"{rows} rows are few for {parameters} parameters, {FEWEST_ROWS} for each are the least")
        weak = True
    if blocks < needed:
        longer = max(longer, needed / blocks)
        choice = "choose friction by what is left out" if chosen else "judge the prior's weight, which is one sample"
        reasons.append(f"{blocks} blocks of rows are too few to {choice}; {needed} are the least")
        weak = weak or chosen
    open_ = _count_prior_determined(information, fit)
    if 2 * open_ > parameters:
        kind = "" if fit.standard is None else f"{fit.standard.prior.kind} "
        reasons.append(
            f"{open_} of {parameters} base parameters have more of the {kind}prior and physics in them than of data"
        )
        weak = True
    if not reasons:
        return None
    seconds = sum(float(run.mask.any(axis=1).sum()) * run.step / run.rate for run in observations.runs)
    remedy = "move all joints together, fast and wide"
    if longer > 1.0:
        remedy = f"record {np.ceil(longer * seconds):.0f} s or more instead of {seconds:.2g} s, and {remedy}"
    meaning = (
        "The weight of the prior could not be chosen from data; a wrong description may have too much influence."
    )
    if weak:
        meaning = "The data do not determine the model: it is physically possible but may fail on other motion."
    return Finding("weak-data", "warning" if weak else "info", "", f"{'; '.join(reasons)}. {meaning}", f"{remedy}.")


def _count_prior_determined(information: Information, fit: Fit) -> int:
    """Number of base parameters that a prior of one sample and the constraints determine more than the data do.

    The weight is one sample, since a larger weight of a right description does not make the data weak.
    """
    if fit.prior_precision is None or fit.standard is None:
        return 0
    prior = fit.prior_precision / max(fit.standard.prior.weight, 1.0)
    rows = stack(total(information), fit.weights)[0]
    data_precision = rows.T @ rows
    share = np.sum(inverse_of(data_precision + prior) * data_precision, axis=1)
    return int(np.count_nonzero(share < TELLING))


def negative_finding(model: DynamicsModel, fit: Fit) -> Finding | None:
    """Finding on friction or rotor inertia whose whole interval is negative, or `None`."""
    forbidden = {parameter.name for parameter in model.parameters if parameter.nonnegative}
    names = [
        name
        for name, (_, high) in zip(fit.names, fit.intervals, strict=True)
        if name.of_all in forbidden and high < 0.0
    ]
    if not names:
        return None
    others = f" and {len(names) - NAMED} more" if len(names) > NAMED else ""
    return Finding(
        "not-physical",
        "warning",
        "",
        f"{', '.join(names[:NAMED])}{others}: the whole 95 % interval is negative, which cannot be. The model lacks "
        "an effect that the motion shows, or the motion does not separate these parameters from others.",
        Remedy("use ", setting("method", "physical"), ", and look at the residuals in the report."),
    )
