"""Plausibility checks of an estimate against the recordings and the description."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array
from armid.doctor.checks.dynamics.excitation_weak import (
    WEAK_CONDITION,
    excitation_severity,
    poorly_determined,
    separable_combinations,
)
from armid.errors import Finding
from armid.estimation.crossvalidation import FOLDS
from armid.estimation.fit_result import Fit
from armid.estimation.friction.selection import FEWEST
from armid.estimation.friction_per_recording import offset_names
from armid.estimation.problem import EstimationProblem, StandardParameters
from armid.estimation.standard_parameter_resolution import NOT_JUDGED
from armid.estimation.uncertainty.covariance_choice_thresholds import FEWEST_BLOCKS, FEWEST_ROWS
from armid.information.information import Information, stack, total
from armid.maths.linalg import inverse_of, scaled_condition, unit_columns
from armid.measurement.observations import Observations
from armid.measurement.remedy_builders import lines
from armid.model.base_parameters import find_base_parameters
from armid.model.dynamics_model import DynamicsModel
from armid.remedy import Remedy, setting
from armid.validation.gravity_sign import gravity_finding

FAR = 20.0
"""Factor between the estimated mass of a link and its mass in the description above which a finding is reported."""

NAMED = 4

TELLING = 0.5
"""A value counts as determined by the prior if less than this share of its information comes from the data."""


def plausibility_findings(
    model: DynamicsModel, information: Information, problem: EstimationProblem, fit: Fit, *, chosen: bool
) -> list[Finding]:
    """Findings that give reasons why an estimate may be wrong.

    Args:
        model: Arm and torque terms.
        information: Information with one set of friction parameters for all recordings.
        problem: Estimation problem, with its samples.
        fit: The estimate.
        chosen: True if friction was selected.
    """
    _, _, observations = problem.require_samples("identify")
    found = [
        gravity_finding(model.robot),
        excitation_finding(information, model, observations),
        few_blocks_finding(fit),
        negative_finding(model, fit),
        drift_finding(model, fit),
        weak_finding(problem.information, observations, fit, chosen=chosen),
        *far_findings(problem.standard, fit),
    ]
    return [finding for finding in found if finding is not None]


def drift_finding(model: DynamicsModel, fit: Fit) -> Finding | None:
    """Finding about offsets that differ between recordings by more than the RMS residual of the joint, or `None`."""
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
        f"Offsets differ between recordings: {'; '.join(drifts)}. The offsets of other recordings are unknown, "
        "so the mean offset is used for them, and the scatter of the offsets widens the prediction interval.",
        "set the torque sensors to zero before a recording, or estimate the offsets again from a short "
        "recording (armid recalibrate).",
    )


def far_findings(standard: StandardParameters | None, fit: Fit) -> list[Finding]:
    """Findings about link masses that are far from the description.

    Masses that the data determine get a separate finding, because a prior hardly affects them, so that another prior
    is no remedy.
    """
    standard_fit = fit.standard
    if standard_fit is None or standard is None or standard.nominal is None:
        return []
    masses = standard.inertial[:, 0]
    names = [standard.names[k] for k in masses]
    # By name, since the fit has copies of friction parameters for several recordings.
    own = [standard_fit.names.index(name) for name in names]
    values, nominal = standard_fit.values[own], standard.nominal[masses]
    far = far_masses(values, nominal) & ~standard.placeholders
    determined = np.array([standard_fit.status[k] == "identified" for k in own], dtype=bool)
    found: list[Finding] = []
    if (which := far & determined).any():
        found.append(
            _far(
                "The data determine these masses, but they are far from the masses of the description: "
                f"{listed_masses(names, values, nominal, which)}. The description may be of another arm or "
                "load than the recordings, or the unit of the torque may be wrong.",
                "check that description and recordings are of the same arm with the same load, and check the unit of "
                "the torque; armid doctor finds the usual faults",
            )
        )
    if (which := far & ~determined).any():
        found.append(
            _far(
                "The data do not determine these masses, or only in part, and they are far from the masses of the "
                f"description: {listed_masses(names, values, nominal, which)}. Torques of the model are not "
                "affected, but simulations that use single links are.",
                _nearer(standard_fit.prior.kind),
            )
        )
    return found


def _far(evidence: str, remedy: Remedy | str) -> Finding:
    """Finding about masses that are far from the description."""
    return Finding("mass-far-from-description", "warning", "", evidence, remedy)


def _nearer(prior: str) -> Remedy | str:
    """Remedy for masses far from the description that the data do not determine; it depends on the kind of prior."""
    if prior == "log-det":
        return "if better masses are known, write them into the description and identify again"
    return lines(
        "values that the data do not determine then stay near the description",
        "estimation",
        physical={"prior": "log-det"},
    )


def far_masses(found: Array, described: Array) -> NDArray[np.bool_]:
    """Mask of the masses (K,) [kg] that differ from those of the description (K,) by more than the factor `FAR`."""
    return (described > 0.0) & ((found < described / FAR) | (found > described * FAR))


def listed_masses(names: Sequence[str], found: Array, described: Array, which: NDArray[np.bool_]) -> str:
    """Text that lists selected masses (K,) [kg] of an estimate, with the masses of the description (K,) [kg]."""
    texts = [
        f"{name} has a mass of {mass:.3g} kg (description: {nominal:.3g} kg)"
        for name, mass, nominal, wanted in zip(names, found, described, which, strict=True)
        if wanted
    ]
    return ", ".join(texts[:NAMED]) + (" and more" if len(texts) > NAMED else "")


def excitation_finding(information: Information, model: DynamicsModel, observations: Observations) -> Finding | None:
    """Finding that some parameters can hardly be distinguished with the recorded motion, or `None`."""
    columns = stack(total(information))[0]
    _, values, directions = np.linalg.svd(unit_columns(columns)[0], full_matrices=False)
    condition = float(values[0] / values[-1])
    if condition > WEAK_CONDITION and not model.nodes:
        change = separable_combinations(model, find_base_parameters(model), information.names)
        condition = min(condition, scaled_condition(columns @ change))
    if condition <= WEAK_CONDITION:
        return None
    fastest = np.max([np.abs(run.motion.dq[run.rows]).max(axis=0) for run in observations.runs], axis=0)
    return Finding(
        "excitation-weak",
        excitation_severity(condition, model.robot, fastest),
        "",
        poorly_determined(information.names, directions[-1], condition),
        "record a motion that moves all joints at the same time, fast and over a wide range; otherwise the "
        "torque error may be large on other motion.",
    )


def few_blocks_finding(fit: Fit) -> Finding | None:
    """Finding that intervals assume white residuals because the data are too few for a test, or `None`."""
    if fit.covariance_kind != "white" or fit.report.whiteness is not None:
        return None
    return Finding(
        "few-blocks",
        "warning",
        "",
        f"There are fewer than {FEWEST_BLOCKS} blocks of rows, so the intervals are computed as if residuals "
        "were uncorrelated; they are too narrow.",
        "record longer.",
    )


def weak_finding(information: Information, observations: Observations, fit: Fit, *, chosen: bool) -> Finding | None:
    """Finding about data that are too weak for the parameters or for the selection of friction, or `None`.

    Estimators without a prior raise an error if the data do not determine a parameter. Estimators with a prior
    estimate such a parameter nevertheless.

    Args:
        information: Information of the training recordings.
        observations: Observations of the training recordings.
        fit: The estimate.
        chosen: True if friction was selected.
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
        reasons.append(
            f"{rows} rows are too few for {parameters} parameters; at least {FEWEST_ROWS} rows for each parameter "
            "are needed"
        )
        weak = True
    if blocks < needed:
        longer = max(longer, needed / blocks)
        choice = (
            "select friction by cross-validation"
            if chosen
            else "determine the weight of the prior, which is therefore one sample"
        )
        reasons.append(f"{blocks} blocks of rows are too few to {choice}; at least {needed} are needed")
        weak = weak or chosen
    open_ = _count_prior_determined(information, fit)
    if 2 * open_ > parameters:
        kind = "" if fit.standard is None else f"{fit.standard.prior.kind} "
        reasons.append(
            f"{open_} of {parameters} base parameters are determined more by the {kind}prior and by physical "
            "constraints than by the data"
        )
        weak = True
    if not reasons:
        return None
    seconds = sum(float(run.mask.any(axis=1).sum()) * run.step / run.rate for run in observations.runs)
    remedy = "move all joints at the same time, fast and over a wide range"
    if longer > 1.0:
        remedy = f"record {np.ceil(longer * seconds):.0f} s or more instead of {seconds:.2g} s, and {remedy}"
    meaning = (
        "The weight of the prior could not be determined from the data, so a wrong description may have too "
        "much influence."
    )
    if weak:
        meaning = (
            "The data do not determine the model: it is physically possible, but its torque error may be large "
            "on other motion."
        )
    return Finding("weak-data", "warning" if weak else "info", "", f"{'; '.join(reasons)}. {meaning}", f"{remedy}.")


def _count_prior_determined(information: Information, fit: Fit) -> int:
    """Number of base parameters that a prior of one sample and the constraints determine more than the data.

    The number is always computed with the weight of one sample, because a larger weight of a correct description does
    not mean that the data are weak.
    """
    if fit.prior_precision is None or fit.standard is None:
        return 0
    prior = fit.prior_precision / max(fit.standard.prior.weight, 1.0)
    rows = stack(total(information), fit.weights)[0]
    data_precision = rows.T @ rows
    share = np.sum(inverse_of(data_precision + prior) * data_precision, axis=1)
    return int(np.count_nonzero(share < TELLING))


def negative_finding(model: DynamicsModel, fit: Fit) -> Finding | None:
    """Finding about friction or rotor inertia whose whole interval is negative, or `None`."""
    forbidden = {parameter.name for parameter in model.parameters if parameter.nonnegative}
    names = [
        name
        for name, (_, high) in zip(fit.names, fit.intervals, strict=True)
        if name.of_all in forbidden and high < 0.0
    ]
    if not names:
        return None
    others = f" and {len(names) - NAMED} more" if len(names) > NAMED else ""
    joints = [model.robot.joint_names[k] for k in sorted({name.number - 1 for name in names if name.number})]
    reasons = ""
    if any(name.symbol in ("FS", "FV") for name in names):
        reasons = " A torque or a position with the wrong sign at a joint also gives it a negative friction."
        if 2 * len({name.number for name in names if name.symbol in ("FS", "FV")}) >= model.n > 1:
            reasons = (
                " Half of the joints or more have a negative friction: a controller has probably subtracted a model "
                "of the friction from the logged torque. Log the torque without this compensation."
            )
    return Finding(
        "not-physical",
        "warning",
        ", ".join(joints),
        f"{', '.join(names[:NAMED])}{others}: the whole 95 % interval is negative, which is physically "
        "impossible. Either the model lacks an effect that is present in the motion, or the motion does not "
        f"separate these parameters from others.{reasons}",
        Remedy("use ", setting("method", "physical"), ", and check the residuals in the report."),
    )
