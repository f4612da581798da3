"""Friction candidates by family, the model with all candidates, and the torque terms of the selected candidates.

The modules of the torque terms define the candidates and their properties
(`armid.model.terms.selection_candidates`). The extended model contains the candidates of all joints, so that their
columns are computed once. The selected candidates become ordinary torque terms, each restricted to the joints for
which its shapes were selected.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from armid.estimation.friction.laws_resolved_by_band import RESOLVED, passed_height, passed_transition
from armid.information.hysteresis_states import with_hysteresis_states
from armid.information.joint_rests import resting_rows
from armid.measurement.observations import Observations
from armid.model.base_parameters import BaseParameters
from armid.model.dynamics_model import DynamicsModel
from armid.model.terms import TERMS, Coulomb, Law, Term
from armid.model.terms.selection_candidates import (
    AutomaticChoice,
    Candidate,
    CandidateFamily,
    Option,
    automatic_choice,
)
from armid.model.torque_law_expression import Expression, symbols
from armid.robot.robot import Robot

SPEED_QUANTILE = 0.95
"""Quantile of the speeds in a joint's rows that counts as the speed that the joint has reached."""

MAX_UNKNOWN = 0.2
"""Largest share of a joint's rows that may be excluded because the state of a hysteresis term is not known yet. To
exclude more rows loses more accuracy than the term usually gains."""

TURN = 2.0 * np.pi
"""Smallest range of the phase of a ripple in a joint's rows with which the ripple is a candidate [rad]: one period.
Over less, a ripple resembles gravity or an offset, and its torque at other positions is an extrapolation."""


def friction_families() -> tuple[CandidateFamily, ...]:
    """Families with the options of all terms, in the order in which they are tried."""
    options: dict[CandidateFamily, list[Option]] = {}
    for choice in map(automatic_choice, TERMS.values()):
        for family, candidates in () if choice is None else choice.options:
            options.setdefault(family, []).append(candidates)
    found = sorted(options.items(), key=lambda item: item[0].order)
    return tuple(replace(family, options=tuple(each)) for family, each in found)


def choice_of(term: str) -> AutomaticChoice:
    """Properties of a torque term, given by its name, in the automatic selection of friction."""
    choice = automatic_choice(TERMS[term])
    assert choice is not None, f"{term} is no candidate"
    return choice


@dataclass(frozen=True, slots=True)
class _AllCandidates:
    """The laws of all candidates as one torque term, used only during the selection."""

    candidates: tuple[Law, ...]
    name: ClassVar[str] = "candidates"

    def laws(self, robot: Robot) -> tuple[Law, ...]:
        del robot
        return self.candidates


@dataclass(frozen=True, eq=False, slots=True)
class CandidateModel:
    """A model extended by friction candidates.

    Attributes:
        model: Arm, its terms and the candidates.
        base: Base parameters of the model, and one parameter for each law of each candidate, in the order of the
            standard parameters.
        in_model: Mask of the parameters that belong to the model without candidates, shape (b,): base parameters, and
            further parameters of the information, such as offsets for each recording.
        columns: Positions of each candidate's parameters among the b parameters, by joint and candidate.
    """

    model: DynamicsModel
    base: BaseParameters
    in_model: NDArray[np.bool_]
    columns: dict[tuple[int, Candidate], NDArray[np.intp]]

    @property
    def count(self) -> int:
        """Number b of parameters in the information of the extended model."""
        return len(self.in_model)


def allowed_candidates(model: DynamicsModel, observations: Observations) -> tuple[frozenset[Candidate], ...]:
    """Finds the candidates for which each joint has suitable data.

    All candidates need a joint that moves. A velocity law needs speeds at which the law is nearly constant.
    Hysteresis needs a state that is known early in the recording. Both need a pass band that is wide enough for their
    effect near standstill. Ripple needs a revolute joint.
    """
    present = {term.name for term in model.terms}
    offered = {candidate for family in friction_families() for option in family.options for candidate in option}
    laws = {candidate: _laws(model, candidate) for candidate in offered if candidate.term not in present}
    if model.load_parameters is None:
        laws = {candidate: each for candidate, each in laws.items() if not depends_on_load(each)}
    candidates = set(laws)
    lost = {
        candidate: _unknown_share(model, candidate, observations)
        for candidate, each in laws.items()
        if any(law.memory is not None for law in each)
    }
    resolved = {
        candidate: _resolved_share(model, candidate, observations)
        for candidate in candidates
        if choice_of(candidate.term).resolution
    }
    fast, turned = _speeds(model, observations), _angles(model, observations)
    moved = np.any([np.ptp(run.motion.q, axis=0) > 0.0 for run in observations.runs], axis=0)
    result: list[frozenset[Candidate]] = []
    for j, joint in enumerate(model.robot.joints):
        allowed = {
            candidate for candidate in candidates if candidate not in lost or lost[candidate][j] <= MAX_UNKNOWN
        }
        allowed = {
            candidate
            for candidate in allowed
            if not choice_of(candidate.term).periodic
            or (not joint.is_prismatic and turned[j] * candidate.shape >= TURN)
        }
        allowed = {
            candidate for candidate in allowed if candidate.shape * choice_of(candidate.term).saturation <= fast[j]
        }
        allowed = {
            candidate for candidate in allowed if candidate not in resolved or resolved[candidate][j] >= RESOLVED
        }
        result.append(frozenset(allowed if moved[j] else ()))
    return tuple(result)


def candidate_model(
    model: DynamicsModel, base: BaseParameters, allowed: Sequence[frozenset[Candidate]]
) -> CandidateModel:
    """Extends a model by all friction laws that the automatic selection may choose for its joints (candidates).

    Args:
        model: Arm and terms, with `load_parameters` if a candidate depends on the load.
        base: Base parameters of the model.
        allowed: Candidates that may be selected for each joint.
    """
    width = _width(model)
    all_laws: list[Law] = []
    law_names: dict[tuple[int, Candidate], list[str]] = {}
    for j, candidates in enumerate(allowed):
        for k, candidate in enumerate(sorted(candidates, key=lambda p: (p.term, p.shape, p.slope))):
            term = _term(candidate.term, (candidate.shape,), width, (model.robot.joint_names[j],))
            laws = [replace(law, symbol=f"C{k}.{i}") for i, law in enumerate(term.laws(model.robot))]
            if candidate.slope:
                laws = [replace(law, expression=_slope(candidate, law.expression)) for law in laws]
            law_names[j, candidate] = [f"{law.symbol}_{law.joint + 1}" for law in laws]
            all_laws += laws
    if not all_laws:
        return CandidateModel(model, base, np.ones(base.count, dtype=np.bool_), {})
    extended = replace(model, terms=(*model.terms, _AllCandidates(tuple(all_laws))))
    names = tuple(parameter.name for parameter in extended.parameters)
    place = {name: k for k, name in enumerate(names)}
    known = np.array([place[name] for name in base.standard_names])
    added = np.setdiff1d(np.arange(len(names)), known)
    kept = np.concatenate([known[base.kept], added])
    order = np.argsort(kept)
    regrouping = np.zeros((len(kept), len(names)))
    regrouping[: base.count, known] = base.regrouping
    regrouping[np.arange(base.count, len(kept)), added] = 1.0
    units = tuple(parameter.unit for parameter in extended.parameters)
    wide = BaseParameters(names, units, kept[order], regrouping[order], base.gravity)
    position = {names[k]: row for row, k in enumerate(wide.kept)}
    columns = {key: np.array([position[name] for name in each]) for key, each in law_names.items()}
    return CandidateModel(extended, wide, order < base.count, columns)


def terms_of(model: DynamicsModel, chosen: Sequence[frozenset[Candidate]]) -> tuple[Term, ...]:
    """Torque terms of the selected candidates of each joint; joints with the same shapes share a term."""
    width = _width(model)
    shapes: dict[tuple[str, tuple[float, ...]], list[str]] = {}
    for name, candidates in zip(model.robot.joint_names, chosen, strict=True):
        for term in sorted({candidate.term for candidate in candidates}):
            joint_shapes = tuple(sorted(candidate.shape for candidate in candidates if candidate.term == term))
            shapes.setdefault((term, joint_shapes), []).append(name)
    return tuple(
        _term(term, joint_shapes, width, tuple(joints)) for (term, joint_shapes), joints in sorted(shapes.items())
    )


def describe(candidates: Sequence[Candidate]) -> str:
    """Describes candidates by terms and shapes, for instance `hysteresis 0.01, 0.03`."""
    words: list[str] = []
    for term in dict.fromkeys(candidate.term for candidate in candidates):
        shapes = sorted(candidate.shape for candidate in candidates if candidate.term == term and candidate.shape)
        words.append(f"{term} {', '.join(f'{shape:g}' for shape in shapes)}".rstrip())
    return " + ".join(words)


def _width(model: DynamicsModel) -> float:
    """Velocity over which the sign of the model's Coulomb friction changes [rad/s or m/s]; 0 if it has none."""
    return next((term.width for term in model.terms if isinstance(term, Coulomb)), 0.0)


def _term(name: str, shapes: tuple[float, ...], width: float, joints: tuple[str, ...] | None = None) -> Term:
    """Makes the torque term with a given name and given shapes of its laws.

    Args:
        name: Name of the term.
        shapes: Shapes of the laws.
        width: Velocity over which the sign of Coulomb friction changes [rad/s or m/s].
        joints: Names of the joints on which the term acts; all joints if not given.
    """
    return choice_of(name).make(shapes, width, joints)


def _laws(model: DynamicsModel, candidate: Candidate) -> tuple[Law, ...]:
    """Laws of a candidate on all joints."""
    return _term(candidate.term, (candidate.shape,), _width(model)).laws(model.robot)


def depends_on_load(laws: Iterable[Law]) -> bool:
    """True if a law depends on the load of its joint."""
    return any("load" in symbols(law.expression) for law in laws)


def _resolved_share(model: DynamicsModel, candidate: Candidate, observations: Observations) -> NDArray[np.float64]:
    """Share of a candidate's effect near standstill that remains after the low-pass filter, for each joint, (n,)."""
    width = _width(model)
    term = _term(candidate.term, (candidate.shape,), width)
    if choice_of(candidate.term).resolution == "height":
        return passed_height(model, term, width, observations)
    if not all(run.consecutive for run in observations.runs):
        return np.ones(model.n)  # separate rows have no known memory in any case
    return passed_transition(model, term, width, observations)


def _speeds(model: DynamicsModel, observations: Observations) -> NDArray[np.float64]:
    """Speed that each joint has reached in its rows: quantile `SPEED_QUANTILE`, shape (n,) [rad/s or m/s]."""
    result = np.zeros(model.n)
    for j in range(model.n):
        speeds = [np.abs(run.motion.dq[run.rows, j][run.mask[:, j]]) for run in observations.runs]
        if any(len(each) for each in speeds):
            result[j] = np.quantile(np.concatenate(speeds), SPEED_QUANTILE)
    return result


def _angles(model: DynamicsModel, observations: Observations) -> NDArray[np.float64]:
    """Range of the position of each joint in its rows, shape (n,) [rad or m]."""
    low, high = np.full(model.n, np.inf), np.full(model.n, -np.inf)
    for run in observations.runs:
        q = run.motion.q[run.rows]
        low = np.minimum(low, np.where(run.mask, q, np.inf).min(axis=0, initial=np.inf))
        high = np.maximum(high, np.where(run.mask, q, -np.inf).max(axis=0, initial=-np.inf))
    return np.maximum(high - low, 0.0)


def _slope(candidate: Candidate, law: Expression) -> Expression:
    """Expression for the derivative of a candidate's friction law with respect to the logarithm of its shape."""
    log_slope = choice_of(candidate.term).log_slope
    assert log_slope is not None, f"the shape of {candidate.term} is not refined"
    return log_slope(law, candidate.shape)


def _unknown_share(model: DynamicsModel, candidate: Candidate, observations: Observations) -> NDArray[np.float64]:
    """Share of each joint's rows in motion in which the hysteresis state of a candidate is unknown, shape (n,)."""
    if not all(run.consecutive for run in observations.runs):
        return np.ones(model.n)
    alone = DynamicsModel(model.robot, (_term(candidate.term, (candidate.shape,), _width(model)),))
    had, left = np.zeros(model.n), np.zeros(model.n)
    for run in observations.runs:
        moving = run.mask & ~resting_rows(run, observations.band)
        had += moving.sum(axis=0)
        left += (moving & with_hysteresis_states(alone, run, observations.band).mask).sum(axis=0)
    return 1.0 - left / np.maximum(had, 1)
