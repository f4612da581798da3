"""Addition of rotor inertia to the default model of a study, if the recordings show that the rotors have inertia."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from armid.doctor.checks.dynamics.rotor_inertia_missing import CODE as ROTOR_INERTIA_MISSING
from armid.errors import Finding
from armid.measurement.remedy_builders import lines
from armid.model.dynamics_model import DynamicsModel
from armid.model.terms import RotorInertia
from armid.study.config import DEFAULT, ModelChoice, RecordingChoice, build_model


def add_rotor_inertia(
    model: DynamicsModel,
    choice: ModelChoice,
    recordings: Sequence[RecordingChoice],
    findings: Sequence[tuple[int, Finding]],
) -> tuple[DynamicsModel, list[tuple[int, Finding]]]:
    """Adds rotor inertia to a default model if a training recording shows its effect.

    Without rotor inertia in the model, the inertia of rotors counts as inertia of the links: the torque error stays
    small, but intervals of the links miss the true values. Validation recordings do not decide whether the term is
    added, because they are used to judge the model.

    Args:
        model: Model with the default terms.
        choice: Terms of the study; if the study names its terms, the model is not changed.
        recordings: Recordings of the study.
        findings: Findings of the doctor, each with the index of its recording.

    Returns:
        The model, and the findings; the doctor's warning is replaced by the information that the term was added.
    """
    missing = [k for k, finding in findings if finding.code == ROTOR_INERTIA_MISSING]
    if choice.terms or choice.automatic or not any(recordings[k].role == "train" for k in missing):
        return model, list(findings)
    told = [
        (k, _added(finding)) if finding.code == ROTOR_INERTIA_MISSING else (k, finding)
        for k, finding in findings
        if finding.code != ROTOR_INERTIA_MISSING or recordings[k].role == "train"
    ]
    return build_model(model.robot, replace(choice, terms=(DEFAULT, RotorInertia.name))), told


def _added(finding: Finding) -> Finding:
    """Finding that rotor inertia was added to the model, with the evidence of the doctor's finding."""
    evidence = f"{finding.evidence} The default model therefore includes rotor inertia."
    remedy = lines("for a model without rotor inertia", table="model", terms=[DEFAULT])
    return Finding("rotor-inertia-added", "info", finding.channel, evidence, remedy)
