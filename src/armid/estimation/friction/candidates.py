"""Friction candidates by family, the model extended by all of them, and the torque terms that they become.

A candidate is a friction law with one shape, such as the Stribeck effect at one velocity. An option of a family is a
set of candidates that a joint gets together. The extended model holds the candidates of all joints, so that their
columns are computed once. The selected candidates become ordinary torque terms, each restricted to the joints that
have its shapes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from armid.estimation.friction.resolution import RESOLVED, passed_height, passed_transition
from armid.information.hysteresis_states import with_hysteresis_states
from armid.measurement.observations import Observations
from armid.model.base_parameters import BaseParameters
from armid.model.dynamics import DynamicsModel
from armid.model.expression import Expression, derivative, symbol
from armid.model.terms import (
    AsymmetricCoulomb,
    AsymmetricViscous,
    Coulomb,
    Hysteresis,
    Law,
    LoadCoulomb,
    PiecewiseViscous,
    PowerViscous,
    Ripple,
    Sigmoid,
    Stribeck,
    Term,
)
from armid.robot.robot import Robot

WIDTHS = (0.001, 0.003, 0.01, 0.03, 0.1)
"""Deflections of hysteresis [rad or m], half a decade apart: from the resolution of encoders to a few degrees, where
the law begins to resemble a spring. A sum of such elements approximates any hysteresis curve."""

BETWEEN = (0.002, 0.005, 0.02, 0.05)
"""Deflections between those of `WIDTHS`, for recordings that show the difference."""

FINEST = (0.0014, 0.007, 0.014, 0.035, 0.07)
"""Deflections between the widest steps of both, one at a time."""

STRIBECK = (0.02, 0.05, 0.1, 0.2, 0.4)
"""Stribeck velocities [rad/s or m/s]: factors of two, since the fit is flat in them."""

SIGMOID = (0.05, 0.2, 0.5)
"""Velocity scales of a sigmoid [rad/s or m/s]."""

KNOTS = (0.1, 0.3, 0.6)
"""Speeds at which viscous friction may change its slope [rad/s or m/s]."""

HARMONICS = (2.0, 3.0, 4.0, 5.0, 6.0)
"""Harmonics of the joint's angle. Gravity has the first; none above the sixth was seen in the recordings at hand."""

SATURATION = {Stribeck.name: 2.0, Sigmoid.name: 2.0, PiecewiseViscous.name: 1.5}
"""Ratio of joint speed to the shape of a velocity law above which the law is saturated. A joint that was never so
fast is not offered the law: below saturation it resembles viscous friction, and would extrapolate wrongly."""

SPEED_QUANTILE = 0.95
"""Quantile of the speeds in a joint's rows that counts as the speed it reached."""

MAX_UNKNOWN = 0.2
"""Largest share of a joint's rows that may be excluded because the state of a hysteresis is not known yet: excluding
more costs more than the term usually gains."""


@dataclass(frozen=True, slots=True)
class Candidate:
    """A friction law with one shape.

    Attributes:
        term: Name of the torque term.
        shape: Its shape; 0 where the term has no shape.
        slope: Whether it stands for the derivative of the law by the logarithm of the shape, not for the law itself.
    """

    term: str
    shape: float = 0.0
    slope: bool = False


@dataclass(frozen=True, slots=True)
class CandidateFamily:
    """Candidates for one kind of friction.

    Attributes:
        name: Name of the kind.
        options: Sets of candidates that a joint gets together.
        shared: Whether the joints of one arm are alike in it, so that the evidence of all joints counts for each.
        position: Whether it could imitate gravity or an offset, and must therefore gain in other poses too.
        rounds: Largest number of options that a joint may get one after another.
        margin: Standard errors by which a gain must exceed zero.
        min_gain: Smallest gain that justifies a term, as a share of the remaining squared error.
        reselect: Whether the family is selected again once all others have been: near standstill most friction laws
            resemble each other.
    """

    name: str
    options: tuple[tuple[Candidate, ...], ...]
    shared: bool = False
    position: bool = False
    rounds: int = 1
    margin: float = 2.0
    min_gain: float = 0.01
    reselect: bool = False


def _singles(term: str, shapes: Sequence[float]) -> tuple[tuple[Candidate, ...], ...]:
    return tuple((Candidate(term, shape),) for shape in shapes)


_WIDTHS = tuple(Candidate(Hysteresis.name, width) for width in WIDTHS)
_BETWEEN = tuple(Candidate(Hysteresis.name, width) for width in BETWEEN)

FAMILIES: tuple[CandidateFamily, ...] = (
    CandidateFamily("hysteresis", (_WIDTHS, _WIDTHS[:-1], _WIDTHS[1:]), shared=True, margin=2.5),
    CandidateFamily("load", ((Candidate(LoadCoulomb.name),),)),
    CandidateFamily(
        "velocity",
        (
            *_singles(Stribeck.name, STRIBECK),
            *_singles(Sigmoid.name, SIGMOID),
            *_singles(PowerViscous.name, (0.5,)),
            tuple(Candidate(PiecewiseViscous.name, knot) for knot in KNOTS),
        ),
        rounds=2,
        min_gain=0.03,
        reselect=True,
    ),
    CandidateFamily("ripple", _singles(Ripple.name, HARMONICS), position=True, rounds=3, margin=3.0, min_gain=0.05),
    CandidateFamily(
        "asymmetry",
        (
            (Candidate(AsymmetricCoulomb.name),),
            (Candidate(AsymmetricViscous.name),),
            (Candidate(AsymmetricCoulomb.name), Candidate(AsymmetricViscous.name)),
        ),
        position=True,
        min_gain=0.05,
    ),
    CandidateFamily(
        "finer hysteresis", (_BETWEEN, *((candidate,) for candidate in (*_BETWEEN, *_WIDTHS))), min_gain=0.02
    ),
    CandidateFamily("finest hysteresis", _singles(Hysteresis.name, FINEST), rounds=2, min_gain=0.02),
)
"""The families in the order in which they are tried: first what explains most of the friction of real arms, last what
can imitate gravity or an offset."""

REFINED = frozenset({Stribeck.name, Sigmoid.name})
"""Terms whose shape is refined by least squares once they are selected."""

TRANSIENT = REFINED | {Hysteresis.name}
"""Terms that act for a short time after a reversal, which the band must resolve."""

ONE_SHAPE = frozenset({Stribeck.name, Sigmoid.name, PowerViscous.name})
"""Terms that a joint can have once, with one shape."""


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
        base: Base parameters of the model and one parameter for each law of a candidate, in the order of the standard
            parameters.
        in_model: Parameters that belong to the model without candidates, shape (b,): base parameters, and those that
            the information has beyond them.
        columns: Positions of each candidate's parameters among the base ones, by joint and candidate.
    """

    model: DynamicsModel
    base: BaseParameters
    in_model: NDArray[np.bool_]
    columns: dict[tuple[int, Candidate], NDArray[np.intp]]

    @property
    def count(self) -> int:
        """Number b of parameters of its information."""
        return len(self.in_model)


def allowed_candidates(model: DynamicsModel, observations: Observations) -> tuple[frozenset[Candidate], ...]:
    """Candidates that each joint may get.

    A velocity law needs speeds that saturate it, hysteresis a state that is known early, both a band that resolves
    them near standstill, ripple a revolute joint, and all of them a joint that moves.
    """
    candidates = {candidate for family in FAMILIES for option in family.options for candidate in option}
    present = {term.name for term in model.terms}
    known = model.load_parameters is not None
    candidates = {
        candidate
        for candidate in candidates
        if candidate.term not in present and (known or candidate.term != LoadCoulomb.name)
    }
    lost = {
        candidate: _unknown_share(model, candidate, observations)
        for candidate in candidates
        if candidate.term == Hysteresis.name
    }
    resolved = {
        candidate: _resolved_share(model, candidate, observations)
        for candidate in candidates
        if candidate.term in TRANSIENT
    }
    fast = _speeds(model, observations)
    moved = np.any([np.ptp(run.motion.q, axis=0) > 0.0 for run in observations.runs], axis=0)
    result: list[frozenset[Candidate]] = []
    for j, joint in enumerate(model.robot.joints):
        allowed = {
            candidate for candidate in candidates if candidate not in lost or lost[candidate][j] <= MAX_UNKNOWN
        }
        if joint.is_prismatic:
            allowed = {candidate for candidate in allowed if candidate.term != Ripple.name}
        allowed = {
            candidate for candidate in allowed if candidate.shape * SATURATION.get(candidate.term, 0.0) <= fast[j]
        }
        allowed = {
            candidate for candidate in allowed if candidate not in resolved or resolved[candidate][j] >= RESOLVED
        }
        result.append(frozenset(allowed if moved[j] else ()))
    return tuple(result)


def candidate_model(
    model: DynamicsModel, base: BaseParameters, allowed: Sequence[frozenset[Candidate]]
) -> CandidateModel:
    """Extends a model by all candidates that its joints may get.

    Args:
        model: Arm and terms, with `load_parameters` where a candidate depends on the load.
        base: Base parameters of the model.
        allowed: Candidates of each joint.
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
    """Text of a set of candidates: `hysteresis 0.01, 0.03`."""
    words: list[str] = []
    for term in dict.fromkeys(candidate.term for candidate in candidates):
        shapes = sorted(candidate.shape for candidate in candidates if candidate.term == term and candidate.shape)
        words.append(f"{term} {', '.join(f'{shape:g}' for shape in shapes)}".rstrip())
    return " + ".join(words)


def _width(model: DynamicsModel) -> float:
    """Velocity over which the model's Coulomb friction changes its sign [rad/s or m/s]; 0 where it has none."""
    return next((term.width for term in model.terms if isinstance(term, Coulomb)), 0.0)


def _term(name: str, shapes: tuple[float, ...], width: float, joints: tuple[str, ...] | None = None) -> Term:
    """Torque term of a name with the shapes of candidates."""
    makers = {
        Hysteresis.name: lambda: Hysteresis(shapes, joints),
        LoadCoulomb.name: lambda: LoadCoulomb(width, joints),
        Stribeck.name: lambda: Stribeck(shapes[0], 2.0, width, joints),
        Sigmoid.name: lambda: Sigmoid(2.0 / shapes[0], 0.0, joints),
        PowerViscous.name: lambda: PowerViscous(shapes[0], max(width, 0.02), joints),
        PiecewiseViscous.name: lambda: PiecewiseViscous(shapes, joints),
        AsymmetricCoulomb.name: lambda: AsymmetricCoulomb(width, joints),
        AsymmetricViscous.name: lambda: AsymmetricViscous(joints),
        Ripple.name: lambda: Ripple(shapes, joints=joints),
    }
    return makers[name]()


def _resolved_share(model: DynamicsModel, candidate: Candidate, observations: Observations) -> NDArray[np.float64]:
    """Share of a law's effect near standstill that the band leaves, shape (n,)."""
    width = _width(model)
    term = _term(candidate.term, (candidate.shape,), width)
    if candidate.term in REFINED:
        return passed_height(model, term, width, observations)
    if not all(run.consecutive for run in observations.runs):
        return np.ones(model.n)  # separate rows have no known memory in any case
    return passed_transition(model, term, width, observations)


def _speeds(model: DynamicsModel, observations: Observations) -> NDArray[np.float64]:
    """Speed that each joint has reached in its rows, shape (n,) [rad/s or m/s]."""
    result = np.zeros(model.n)
    for j in range(model.n):
        speeds = [np.abs(run.motion.dq[run.rows, j][run.mask[:, j]]) for run in observations.runs]
        if any(len(each) for each in speeds):
            result[j] = np.quantile(np.concatenate(speeds), SPEED_QUANTILE)
    return result


def _slope(candidate: Candidate, law: Expression) -> Expression:
    """Derivative of the law of a term in `REFINED` by the logarithm of its shape."""
    velocity = symbol("dq")
    if candidate.term == Stribeck.name:  # exp(-(dq / shape)²); the width of the sign does not depend on the shape
        return 2.0 * (velocity * (1.0 / candidate.shape)) ** 2.0 * law
    return -velocity * derivative(law, "dq")  # a sigmoid is a function of dq / shape


def _unknown_share(model: DynamicsModel, candidate: Candidate, observations: Observations) -> NDArray[np.float64]:
    """Share of each joint's rows before the hysteresis state of a candidate is known, shape (n,)."""
    if not all(run.consecutive for run in observations.runs):
        return np.ones(model.n)
    alone = DynamicsModel(model.robot, (Hysteresis((candidate.shape,)),))
    had = np.sum([run.mask.sum(axis=0) for run in observations.runs], axis=0)
    left = np.sum(
        [with_hysteresis_states(alone, run, observations.band).mask.sum(axis=0) for run in observations.runs], axis=0
    )
    return 1.0 - left / np.maximum(had, 1)
