"""Default options of the estimator if armid selects the friction terms, and the finding about this selection."""

from __future__ import annotations

import dataclasses
from typing import Any

from armid.errors import Finding
from armid.estimation.catalogue import ESTIMATORS
from armid.estimation.estimate_record import Estimate
from armid.estimation.friction.forward_selection import SHRINKAGE
from armid.estimation.friction.selection import FrictionSelection
from armid.estimation.prior import CHOSEN, GIVEN, INFORMED, weight_finding
from armid.study.config import AUTOMATIC_METHOD, EstimationChoice


def as_chosen(choice: EstimationChoice, selection: FrictionSelection, *, described: bool) -> EstimationChoice:
    """Estimation options with the method, prior, noise and offsets of the friction selection.

    Args:
        choice: Options of the study; the method `auto` becomes that of the selection.
        selection: Result of the friction selection.
        described: True if the description has masses and inertias that can be a prior.
    """
    method = selection.method if choice.method == AUTOMATIC_METHOD else choice.method
    separate_offsets = choice.offset_per_recording or selection.offset_per_recording
    named = dataclasses.replace(choice, method=method, offset_per_recording=separate_offsets)
    return with_selection_prior(named, selection, described=described)


def with_selection_prior(
    choice: EstimationChoice, selection: FrictionSelection, *, described: bool
) -> EstimationChoice:
    """Estimation options with the prior of the friction selection, unless the study sets the prior of the estimator.

    Noise and shrinkage are those with which friction was selected, so that the held-out error of the selection is
    valid for the estimate.

    Args:
        choice: Options of the study.
        selection: Result of the friction selection.
        described: True if the description has masses and inertias that can be a prior.
    """
    names = {f.name for f in dataclasses.fields(ESTIMATORS[choice.method])}  # pyright: ignore[reportArgumentType]
    given = choice.options.get(choice.method, {})
    options: dict[str, Any] = {}
    if selection.noise:
        options |= {"noise": selection.noise, "shrinkage": SHRINKAGE}
    weight = selection.weight_for(choice.method)
    if weight is not None and "weight" in names and given.get("weight", "auto") == "auto" and "prior" not in given:
        options |= {"weight": weight, "prior": "log-det" if described else "mass"}
    own = {
        name: value for name, value in options.items() if name in names and (name == "weight" or name not in given)
    }
    return dataclasses.replace(choice, options={**choice.options, choice.method: {**given, **own}}) if own else choice


def with_origin_of_weight(estimate: Estimate, selection: FrictionSelection | None) -> Estimate:
    """Estimate whose findings say that the friction selection determined the weight of the prior, if this is so."""
    weight = None if selection is None else selection.weight_for(estimate.method)
    if weight is None:
        return estimate
    chosen = {
        weight_finding(prior, weight, GIVEN): weight_finding(prior, weight, CHOSEN)
        for prior in (*(f"{kind} prior" for kind in INFORMED), "prior towards the description", "prior towards zero")
    }
    fit = estimate.fit
    if fit.standard is not None and (fit.standard.prior.how, fit.standard.prior.weight) == (GIVEN, weight):
        prior = dataclasses.replace(fit.standard.prior, how=CHOSEN)
        fit = dataclasses.replace(fit, standard=dataclasses.replace(fit.standard, prior=prior))
    findings = tuple(chosen.get(finding, finding) for finding in estimate.findings)
    return dataclasses.replace(estimate, fit=fit, findings=findings)


def chosen_finding(selection: FrictionSelection, method: str) -> Finding:
    """Finding about the friction selection and the method with which the selected friction was estimated."""
    if selection.prior_weight is None:
        return Finding(
            "friction-not-chosen",
            "warning",
            "",
            selection.why,
            "record longer, or give the torque terms by name with the key `terms` of [model].",
        )
    evidence = (
        "While friction was selected, a prior was used for the inertial parameters. The weight of the prior with the "
        f"smallest error on held-out motion is {selection.prior_weight:.3g} independent samples. The "
        f"parameters were then estimated with the method {method}, with the noise of each joint as in the selection. "
        "The selection is valid for speeds and poses similar to the recorded ones."
    )
    return Finding("friction-chosen", "info", "", evidence, "validate the model on another recording.")
