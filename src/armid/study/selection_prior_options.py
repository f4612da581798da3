"""Default estimation options for a model with selected friction, and the finding about the selection."""

from __future__ import annotations

import dataclasses

from armid.errors import Finding
from armid.estimation.catalogue import ESTIMATORS
from armid.estimation.estimate_record import Estimate
from armid.estimation.friction.selection import FrictionSelection
from armid.estimation.prior import CHOSEN, GIVEN, INFORMED, weight_finding
from armid.study.config import EstimationChoice


def as_chosen(choice: EstimationChoice, selection: FrictionSelection, *, described: bool) -> EstimationChoice:
    """Estimation options with the prior and the offsets that were used in the selection of friction.

    Args:
        choice: Options of the study.
        selection: Result of the friction selection.
        described: True if the description has masses and inertias that can be a prior.
    """
    separate_offsets = choice.offset_per_recording or selection.offset_per_recording
    with_prior = with_selection_prior(choice, selection.prior_weight, described=described)
    return dataclasses.replace(with_prior, offset_per_recording=separate_offsets)


def with_selection_prior(choice: EstimationChoice, weight: float | None, *, described: bool) -> EstimationChoice:
    """Estimation options with the prior of the friction selection, unless the study sets the prior itself.

    Args:
        choice: Options of the study.
        weight: Weight of the prior; `None` if the selection did not determine a weight.
        described: True if the description has masses and inertias that can be a prior.
    """
    if weight is None:
        return choice
    names = {f.name for f in dataclasses.fields(ESTIMATORS[choice.method])}  # pyright: ignore[reportArgumentType]
    prior_options = {"weight": weight, "prior": "log-det" if described else "mass"}
    given = choice.options.get(choice.method, {})
    if "weight" not in names or given.get("weight", "auto") != "auto" or "prior" in given:
        return choice
    options = {**given, **{name: value for name, value in prior_options.items() if name in names}}
    return dataclasses.replace(choice, options={**choice.options, choice.method: options})


def with_origin_of_weight(estimate: Estimate, selection: FrictionSelection | None) -> Estimate:
    """Estimate whose findings name the friction selection as origin of the prior's weight, if it is the origin."""
    if selection is None or selection.prior_weight is None:
        return estimate
    weight = selection.prior_weight
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
        f"parameters were then estimated with the method {method}. The selection is valid for speeds and "
        "poses similar to the recorded ones."
    )
    return Finding("friction-chosen", "info", "", evidence, "validate the model on another recording.")
