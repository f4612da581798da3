"""Check for rotor inertia that the torque shows, but that is missing in the model of the study."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from armid.doctor.check_definition import LogCheck
from armid.doctor.check_input import LogEvidence
from armid.doctor.fitted_log import LogState
from armid.doctor.quick_fit import QuickRows, solve
from armid.doctor.remedy_trial import try_remedy
from armid.doctor.rows_away_from_reversals import away_from_reversals
from armid.errors import Finding
from armid.measurement.remedy_builders import lines
from armid.model.terms import DEFAULT_TERMS

CODE = "rotor-inertia-missing"

GAIN = 0.04
"""Smallest decrease of the mean logarithm of the RMS residuals by rotor inertia for which it is reported."""

SURE = 8.0
"""Number of standard deviations by which a rotor inertia must be positive."""

MISSES = float(np.log(2.0))
"""Smallest decrease of the mean logarithm of the RMS residuals for which the finding is an error, if the recording
is compared with a run. Half of the residual of the run's model is then caused by rotor inertia, which would
otherwise be attributed to friction, load or links."""

ADDED = "armid identify adds rotor inertia if the study names no terms."


def check(evidence: LogEvidence) -> list[Finding]:
    """Reports the joints whose torque shows rotor inertia, in one finding.

    If the study names no terms, the finding is only information, because an identification then adds rotor inertia
    itself.

    Rows away from reversals are used first: stiction causes much of the residual of all rows and hides rotor inertia
    in slow motion. All rows are used next: if the torque is noisy, more rows are needed to find rotor inertia.
    """
    state = evidence.corrected
    if state is None or (evidence.model is not None and any(t.name == "rotor-inertia" for t in evidence.model.terms)):
        return []
    moving = away_from_reversals(state)
    judged = [each for each in (moving, state) if each.rows.mask.any()]
    shown = next((found for each in judged if (found := _rotors(each)) is not None), None)
    if shown is None:
        return []
    joints, text, gain = shown
    if evidence.model is None:
        return [Finding(CODE, "info", ", ".join(joints), f"{text} {ADDED}")]
    remedy = lines(table="model", terms=[*term_names(evidence), "rotor-inertia"])
    misses = evidence.known is not None and gain > MISSES
    return [Finding(CODE, "error" if misses else "warning", ", ".join(joints), text, remedy)]


def _rotors(state: LogState) -> tuple[list[str], str, float] | None:
    """Names of the joints with rotor inertia, the evidence in words, and the decrease of the residual.

    The result is `None` if no joint has one.
    """
    without = _without_rotors(state)
    gain = solve(without).cost - state.fit.cost
    values, deviation = state.fit.values, state.fit.deviation
    symbols = [state.model.parameters[k] for k in state.base.kept]
    rotors, spread = np.array([p.symbol == "IA" for p in symbols]), deviation[: len(symbols)]
    shown = np.flatnonzero(rotors & (spread > 0.0) & (values[: len(symbols)] > SURE * spread))
    if gain < GAIN or not len(shown):
        return None
    trial = try_remedy(without, state.rows)
    if not trial.helps:
        return None
    listed = ", ".join(f"{state.base.names[k]} {values[k]:.3g} ± {deviation[k]:.1g}" for k in shown)
    text = f"With rotor inertia the residual is {1 - np.exp(-gain):.0%} smaller: {listed} kg·m². {trial}"
    return [symbols[k].joint for k in shown], text, float(gain)


def term_names(evidence: LogEvidence) -> list[str]:
    """Names of the torque terms of the study; the name `default` stands for the default terms."""
    terms = DEFAULT_TERMS if evidence.model is None else evidence.model.terms
    return ["default"] if terms == DEFAULT_TERMS else [term.name for term in terms]


def _without_rotors(state: LogState) -> QuickRows:
    """Rows of the log without the regressor columns of rotor inertia."""
    rows = state.rows
    keep = [
        np.array([state.model.parameters[state.base.kept[p]].symbol != "IA" for p in parameters])
        for parameters in rows.parameters
    ]
    return replace(
        rows,
        columns=tuple(columns[k] for columns, k in zip(rows.columns, keep, strict=True)),
        parameters=tuple(parameters[k] for parameters, k in zip(rows.parameters, keep, strict=True)),
    )


CHECK = LogCheck(
    look=check,
    scope="format",
    effects={
        CODE: "Without the term, rotor inertia is attributed to the links, which are then physically inconsistent.",
    },
)
