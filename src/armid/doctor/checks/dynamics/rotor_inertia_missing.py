"""Rotors that show in the torque and are not in the study's model."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from armid.doctor.evidence import LogEvidence
from armid.doctor.explanation import LogState
from armid.doctor.quick_fit import QuickRows, solve
from armid.doctor.remedy_trial import try_out
from armid.errors import Finding
from armid.measurement.remedy import lines

__all__ = ["check"]

GAIN = 0.04
"""Fall of the residual, as a logarithm, that rotors must bring."""

SURE = 8.0
"""Standard deviations by which a rotor's inertia must be positive."""


def check(evidence: LogEvidence) -> list[Finding]:
    """One finding for all joints whose rotors show."""
    state = evidence.understood
    if state is None or (evidence.model is not None and any(t.name == "rotor-inertia" for t in evidence.model.terms)):
        return []
    without = _without_rotors(state)
    gain = solve(without).cost - state.fit.cost
    values, deviation = state.fit.values, state.fit.deviation
    symbols = [state.model.parameters[k] for k in state.base.kept]
    rotors, spread = np.array([p.symbol == "IA" for p in symbols]), deviation[: len(symbols)]
    shown = np.flatnonzero(rotors & (spread > 0.0) & (values[: len(symbols)] > SURE * spread))
    if gain < GAIN or not len(shown):
        return []
    trial = try_out(without, state.rows)
    if not trial.helps:
        return []
    listed = ", ".join(f"{state.base.names[k]} {values[k]:.3g} ± {deviation[k]:.1g}" for k in shown)
    return [
        Finding(
            "rotor-inertia-missing",
            "warning",
            ", ".join(symbols[k].joint for k in shown),
            f"With the inertia of rotors {1 - np.exp(-gain):.0%} less of the torque is left: {listed} kg·m². {trial}",
            lines("in [model]", terms=[*_named(evidence), "rotor-inertia"]),
        )
    ]


def _named(evidence: LogEvidence) -> list[str]:
    """Terms that the study has, or would have if it named none."""
    own = () if evidence.model is None else evidence.model.terms
    return [term.name for term in own] or ["rigid-body", "viscous", "coulomb", "offset"]


def _without_rotors(state: LogState) -> QuickRows:
    """Rows without the columns of rotors."""
    rows = state.rows
    keep = [
        np.array([state.model.parameters[state.base.kept[p]].symbol != "IA" for p in own]) for own in rows.parameters
    ]
    return replace(
        rows,
        columns=tuple(columns[k] for columns, k in zip(rows.columns, keep, strict=True)),
        parameters=tuple(own[k] for own, k in zip(rows.parameters, keep, strict=True)),
    )
