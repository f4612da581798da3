"""Does what was measured look like the arm that the description tells of? Questions worth asking before any fit."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from armid.doctor.checks.dynamics.excitation_weak import WEAK_CONDITION, excitation_severity, poorly_determined
from armid.errors import Finding
from armid.estimation.crossvalidation import FOLDS
from armid.estimation.estimators.physical import NOT_JUDGED
from armid.estimation.fit import Fit
from armid.estimation.friction.selection import FEWEST, FrictionSelection
from armid.estimation.per_recording import offset_names
from armid.estimation.problem import EstimationProblem, StandardParameters
from armid.estimation.uncertainty.covariance import FEWEST_BLOCKS, FEWEST_ROWS
from armid.information.information import Information, stack, total
from armid.maths.linalg import inverse_of, unit_columns
from armid.measurement.observations import Observations
from armid.model.dynamics import DynamicsModel
from armid.robot import Robot
from armid.validation.gravity_sign import gravity_finding
from armid.values import Array

__all__ = [
    "chosen_finding",
    "drift_finding",
    "excitation_finding",
    "far_finding",
    "far_masses",
    "few_blocks_finding",
    "gravity_finding",
    "negative_finding",
    "plausibility_findings",
    "weak_finding",
]

FAR = 20.0
"""Factor between the mass of a link and the described one from which on they have nothing to do with each other."""

NAMED = 4

TELLING = 0.5
"""Share of a value below which it is more the prior's than the data's."""


def plausibility_findings(
    model: DynamicsModel, information: Information, problem: EstimationProblem, fit: Fit, *, chosen: bool
) -> list[Finding]:
    """Return what speaks against taking an estimate at its word.

    Args:
        model: Arm and torque terms.
        information: Factors with friction that all recordings share.
        problem: What the estimate was made from, with its samples.
        fit: The estimate.
        chosen: Whether friction was to be chosen by what it predicts.
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
    """Offsets that differ between recordings by more than is left of the joint's torque, or `None`."""
    said: list[str] = []
    for parameter in (each for each in model.parameters if each.name in offset_names(model)):
        own = [k for k, name in enumerate(fit.names) if name.split("[", 1)[0] == parameter.name]
        low, high = fit.intervals[own].T
        values = fit.values[own]
        if len(own) > 1 and np.ptp(values) > fit.residual_rms[parameter.number - 1] and low.max() > high.min():
            each = ", ".join(f"{value:.2g}" for value in values)
            said.append(f"{parameter.name} {each} {parameter.unit}")
    if not said:
        return None
    return Finding(
        "offset-drift",
        "warning",
        "",
        f"Offsets differ between recordings: {'; '.join(said)}. The mean stands for another recording, whose own "
        "offset nobody knows; its band is wider by their scatter.",
        "zero the torque sensors before a recording, or estimate offsets anew from a short one (armid recalibrate).",
    )


def far_finding(standard: StandardParameters | None, fit: Fit) -> Finding | None:
    """Links whose mass the data leave open and that came out far from the described one, or `None`."""
    found = fit.standard
    if found is None or standard is None or standard.nominal is None:
        return None
    masses = standard.inertial[:, 0]
    names = [standard.names[k] for k in masses]
    # By name: friction of several recordings has copies among the parameters that were found.
    values = np.array([found.values[found.names.index(name)] for name in names])
    said = far_masses(names, values, standard.nominal[masses])
    if not said:
        return None
    return Finding(
        "mass-far-from-description",
        "warning",
        "",
        f"Torques do not tell these masses apart from others, and they came out far from the description's: {said}. "
        "Torque is the same; a body that is shown or simulated on its own is not.",
        'physical = { prior = "log-det" }  # in [estimation]: what data leave open stays near the description',
    )


def far_masses(names: Sequence[str], found: Array, described: Array) -> str:
    """Masses (K,) [kg] that have nothing to do with those described (K,), in words; empty where there are none."""
    far = (described > 0.0) & ((found < described / FAR) | (found > described * FAR))
    said = [
        f"{name} {mass:.3g} kg (described: {nominal:.3g})"
        for name, mass, nominal, told in zip(names, found, described, far, strict=True)
        if told
    ]
    return ", ".join(said[:NAMED]) + (" and more" if len(said) > NAMED else "")


def excitation_finding(information: Information, robot: Robot, observations: Observations) -> Finding | None:
    """A motion that hardly tells some parameters apart, with their names, or `None`; as the doctor's."""
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


def chosen_finding(ladder: FrictionSelection, method: str) -> Finding:
    """Tell how friction that was chosen is estimated, which a study need not have said."""
    if ladder.prior_weight is None:
        return Finding("friction-not-chosen", "warning", "", ladder.why, "record longer, or name the terms.")
    evidence = (
        "Friction was chosen with the bodies under a prior of the weight that erred least on left-out motion, "
        f"{ladder.prior_weight:.3g} independent samples; the estimate is by {method}. The choice holds for speeds "
        "and poses like those recorded."
    )
    return Finding("friction-chosen", "info", "", evidence, "validate on another recording.")


def few_blocks_finding(fit: Fit) -> Finding | None:
    """Intervals that take residuals as white without a test having said so, or `None`."""
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
    """Data that say next to nothing where prior, physics or candidates of friction fill the gap, or `None`.

    Plain methods refuse what the data leave open. These answer all the same, and it looks like any other estimate.

    Args:
        information: What the estimate was made from.
        observations: The same, as rows.
        fit: The estimate.
        chosen: Whether friction was to be chosen by what it predicts.
    """
    if fit.standard is None and not chosen:
        return None
    rows, parameters = int(information.rows.sum()), information.count
    blocks = int(np.count_nonzero(information.rows.any(axis=1)))
    unjudged = fit.standard is not None and fit.standard.prior.how == NOT_JUDGED
    needed = FEWEST if chosen else FOLDS if unjudged else 0
    longer, said, weak = 1.0, list[str](), False
    if rows < FEWEST_ROWS * parameters:
        longer = FEWEST_ROWS * parameters / rows
        said.append(f"{rows} rows are few for {parameters} parameters, {FEWEST_ROWS} for each are the least")
        weak = True
    if blocks < needed:
        longer = max(longer, needed / blocks)
        choice = "choose friction by what is left out" if chosen else "judge the prior's weight, which is one sample"
        said.append(f"{blocks} blocks of rows are too few to {choice}; {needed} are the least")
        weak = weak or chosen
    open_ = _decided_otherwise(information, fit)
    if 2 * open_ > parameters:
        kind = "" if fit.standard is None else f"{fit.standard.prior.kind} "
        said.append(
            f"{open_} of {parameters} base parameters have more of the {kind}prior and physics in them than of data"
        )
        weak = True
    if not said:
        return None
    seconds = sum(float(run.mask.any(axis=1).sum()) * run.step / run.rate for run in observations.runs)
    remedy = "move all joints together, fast and wide"
    if longer > 1.0:
        remedy = f"record {np.ceil(longer * seconds):.0f} s or more instead of {seconds:.2g} s, and {remedy}"
    told = "What the data tell is the same; a description that is wrong may be followed too far or too little."
    meaning = "The estimate is an arm that could be, not this one; it may fail on other motion." if weak else told
    return Finding("weak-data", "warning" if weak else "info", "", f"{'; '.join(said)}. {meaning}", f"{remedy}.")


def _decided_otherwise(information: Information, fit: Fit) -> int:
    """Tell how many base parameters would be more of a prior of one sample, and of physics, than of the data.

    A description that foretells what was left out may weigh more; data are not weak because it is right.
    """
    if fit.prior_precision is None or fit.standard is None:
        return 0
    prior = fit.prior_precision / max(fit.standard.prior.weight, 1.0)
    rows = stack(total(information), fit.weights)[0]
    told = rows.T @ rows
    share = np.sum(inverse_of(told + prior) * told, axis=1)
    return int(np.count_nonzero(share < TELLING))


def negative_finding(model: DynamicsModel, fit: Fit) -> Finding | None:
    """Friction or rotor inertia whose whole interval lies where physics forbids it, or `None`."""
    forbidden = {parameter.name for parameter in model.parameters if parameter.nonnegative}
    names = [
        name
        for name, (_, high) in zip(fit.names, fit.intervals, strict=True)
        if name.split("[", 1)[0] in forbidden and high < 0.0
    ]
    if not names:
        return None
    more = f" and {len(names) - NAMED} more" if len(names) > NAMED else ""
    return Finding(
        "not-physical",
        "warning",
        "",
        f"{', '.join(names[:NAMED])}{more}: negative with the whole 95 % interval, as in no arm. The model lacks "
        "something that the motion shows, or the motion does not tell these parameters from others.",
        'use method = "physical", and look at what the report says is left.',
    )
