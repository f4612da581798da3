"""Estimation of a model whose friction was chosen, as far as the study leaves that open."""

from __future__ import annotations

import dataclasses

from armid.estimation.estimate import Estimate
from armid.estimation.estimators import ESTIMATORS
from armid.estimation.friction.selection import FrictionSelection
from armid.study.config import EstimationChoice

__all__ = ["as_chosen", "credited", "lean_on_prior"]

GIVEN, CHOSEN = "given", "as chosen with the friction"
"""How a weight was found, as methods say it of one in their options, and where the ladder put it there."""


def as_chosen(choice: EstimationChoice, ladder: FrictionSelection, *, described: bool) -> EstimationChoice:
    """The choice with the prior and the offsets that friction was chosen under.

    Args:
        choice: As the study has it.
        ladder: Friction that was chosen.
        described: Whether the description has bodies that can be a prior.
    """
    apart = choice.offset_per_recording or ladder.offset_per_recording
    leaning = lean_on_prior(choice, ladder.prior_weight, described=described)
    return dataclasses.replace(leaning, offset_per_recording=apart)


def lean_on_prior(choice: EstimationChoice, weight: float | None, *, described: bool) -> EstimationChoice:
    """The choice with the prior that friction was chosen under, as far as the study leaves the method's own open.

    Args:
        choice: As the study has it.
        weight: Of the prior; `None` where nothing was judged.
        described: Whether the description has bodies that can be a prior.
    """
    if weight is None:
        return choice
    names = {f.name for f in dataclasses.fields(ESTIMATORS[choice.method])}  # pyright: ignore[reportArgumentType]
    own = {"weight": weight, "prior": "log-det" if described else "mass"}
    given = choice.options.get(choice.method, {})
    if "weight" not in names or given.get("weight", "auto") != "auto" or "prior" in given:
        return choice
    options = {**given, **{name: value for name, value in own.items() if name in names}}
    return dataclasses.replace(choice, options={**choice.options, choice.method: options})


def credited(estimate: Estimate, ladder: FrictionSelection | None) -> Estimate:
    """The estimate whose prior's weight is said to come from the choice of friction, where it does."""
    if ladder is None or ladder.prior_weight is None:
        return estimate
    said = f"weighs {ladder.prior_weight:.3g} "
    findings = tuple(
        dataclasses.replace(finding, evidence=finding.evidence.replace(f", {GIVEN}.", f", {CHOSEN}."))
        if finding.code == "prior-weight" and said in finding.evidence
        else finding
        for finding in estimate.findings
    )
    fit = estimate.fit
    if (
        fit.standard is not None
        and fit.standard.prior.how == GIVEN
        and fit.standard.prior.weight == ladder.prior_weight
    ):
        prior = dataclasses.replace(fit.standard.prior, how=CHOSEN)
        fit = dataclasses.replace(fit, standard=dataclasses.replace(fit.standard, prior=prior))
    return dataclasses.replace(estimate, fit=fit, findings=findings)
