"""Candidates for the friction of a joint, rung by rung, their columns, and the terms that they become.

A piece is a law of one shape, such as the Stribeck effect at one velocity. A candidate is a set of pieces that a
joint gets together. All pieces of all joints stand beside the model in one superset whose columns are made once;
whichever are chosen then become ordinary torque terms, each restricted to the joints that have its shapes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

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

__all__ = [
    "REFINED",
    "RUNGS",
    "Candidate",
    "CandidateFamily",
    "CandidateModel",
    "candidate_model",
    "candidates",
    "described",
    "terms_of",
]

WIDTHS = (0.001, 0.003, 0.01, 0.03, 0.1)
"""Deflections of hysteresis [rad or m]: from what encoders resolve to a few degrees, where it begins to look like a
spring, half a decade apart; a sum of such elements comes near any curve between."""

BETWEEN = (0.002, 0.005, 0.02, 0.05)
"""Deflections between these, for recordings that show the difference."""

FINEST = (0.0014, 0.007, 0.014, 0.035, 0.07)
"""And between the widest steps of both, one at a time."""

STRIBECK = (0.02, 0.05, 0.1, 0.2, 0.4)
"""Stribeck velocities [rad/s or m/s]: factors of two, since the fit is flat in them."""

SIGMOID = (0.05, 0.2, 0.5)
"""Velocities over which a sigmoid turns [rad/s or m/s]."""

KNOTS = (0.1, 0.3, 0.6)
"""Speeds at which viscous friction may change its slope [rad/s or m/s]."""

HARMONICS = (2.0, 3.0, 4.0, 5.0, 6.0)
"""Harmonics of the joint's angle. The first is what gravity does; above the sixth, arms of which recordings are at
hand have none."""

FALLEN = {Stribeck.name: 2.0, Sigmoid.name: 2.0, PiecewiseViscous.name: 1.5}
"""Speed over the shape of a velocity law at which it has done what it does. A joint that was never as fast does not
get it: what is seen of it would be viscous friction under another name, and go on otherwise where it moves faster."""

SLOWER = 0.95
"""Share of a joint's rows that are slower than the speed that counts as reached."""

UNKNOWN = 0.2
"""Share of a joint's rows that a memory may cost for not being known yet: more rows than that are worth more than
what it usually brings."""


@dataclass(frozen=True, slots=True)
class Candidate:
    """A law of one shape.

    Attributes:
        term: Name of the torque term.
        shape: Its shape; 0 where it has none of its own.
        slope: Not the law itself but its derivative by the logarithm of the shape.
    """

    term: str
    shape: float = 0.0
    slope: bool = False


@dataclass(frozen=True, slots=True)
class CandidateFamily:
    """One kind of friction.

    Attributes:
        name: Name of the rung.
        options: Candidates, each a set of pieces.
        shared: Joints of one arm are alike in it, so that all of them together are evidence for each.
        position: It could imitate gravity or an offset, and must gain in other poses too.
        rounds: Candidates that a joint may get one after another.
        clear: Standard errors by which a gain must stand out.
        least: Least gain in squared error that is worth a term, as a share of what is left.
        anew: Whether the choice is made a second time once all else is there: near standstill nearly everything looks
            like something else.
    """

    name: str
    options: tuple[tuple[Candidate, ...], ...]
    shared: bool = False
    position: bool = False
    rounds: int = 1
    clear: float = 2.0
    least: float = 0.01
    anew: bool = False


def _singles(term: str, shapes: Sequence[float]) -> tuple[tuple[Candidate, ...], ...]:
    return tuple((Candidate(term, shape),) for shape in shapes)


_SPECTRUM = tuple(Candidate(Hysteresis.name, width) for width in WIDTHS)
_FINER = tuple(Candidate(Hysteresis.name, width) for width in BETWEEN)

RUNGS: tuple[CandidateFamily, ...] = (
    CandidateFamily("hysteresis", (_SPECTRUM, _SPECTRUM[:-1], _SPECTRUM[1:]), shared=True, clear=2.5),
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
        least=0.03,
        anew=True,
    ),
    CandidateFamily("ripple", _singles(Ripple.name, HARMONICS), position=True, rounds=3, clear=3.0, least=0.05),
    CandidateFamily(
        "asymmetry",
        (
            (Candidate(AsymmetricCoulomb.name),),
            (Candidate(AsymmetricViscous.name),),
            (Candidate(AsymmetricCoulomb.name), Candidate(AsymmetricViscous.name)),
        ),
        position=True,
        least=0.05,
    ),
    CandidateFamily("finer hysteresis", (_FINER, *((piece,) for piece in (*_FINER, *_SPECTRUM))), least=0.02),
    CandidateFamily("finest hysteresis", _singles(Hysteresis.name, FINEST), rounds=2, least=0.02),
)
"""The rungs in the order in which they are climbed: what explains most of real arms first, what can imitate gravity
or an offset last."""

REFINED = frozenset({Stribeck.name, Sigmoid.name})
"""Terms whose shape is refined by least squares once they are chosen."""

ONE_SHAPE = frozenset({Stribeck.name, Sigmoid.name, PowerViscous.name})
"""Terms that a joint can have once, with one shape."""


@dataclass(frozen=True, slots=True)
class _Shelf:
    """The laws of all pieces as one term; it never leaves the search."""

    pieces: tuple[Law, ...]
    name: ClassVar[str] = "candidates"

    def laws(self, robot: Robot) -> tuple[Law, ...]:
        del robot
        return self.pieces


@dataclass(frozen=True, eq=False, slots=True)
class CandidateModel:
    """A model with all pieces beside its own terms.

    Attributes:
        model: Arm, terms and pieces.
        base: The model's base parameters, then one for each piece's laws, in the order of the standard ones.
        own: Which parameters of its information are the model's own, shape (b,): of the base ones, and whatever the
            information has beyond them.
        columns: Positions of each piece's parameters among the base ones, by joint and piece.
    """

    model: DynamicsModel
    base: BaseParameters
    own: NDArray[np.bool_]
    columns: dict[tuple[int, Candidate], NDArray[np.intp]]

    @property
    def count(self) -> int:
        """Number b of parameters of its information."""
        return len(self.own)


def candidates(model: DynamicsModel, observations: Observations) -> tuple[frozenset[Candidate], ...]:
    """Pieces that each joint may get: what its speeds show whole, memory known early, ripple where it turns."""
    pieces = {piece for rung in RUNGS for option in rung.options for piece in option}
    present = {term.name for term in model.terms}
    known = model.load_parameters is not None
    pieces = {piece for piece in pieces if piece.term not in present and (known or piece.term != LoadCoulomb.name)}
    lost = {piece: _unknown(model, piece, observations) for piece in pieces if piece.term == Hysteresis.name}
    fast = _speeds(model, observations)
    moved = np.any([np.ptp(run.motion.q, axis=0) > 0.0 for run in observations.runs], axis=0)
    result: list[frozenset[Candidate]] = []
    for j, joint in enumerate(model.robot.joints):
        own = {piece for piece in pieces if piece not in lost or lost[piece][j] <= UNKNOWN}
        if joint.is_prismatic:
            own = {piece for piece in own if piece.term != Ripple.name}
        own = {piece for piece in own if piece.shape * FALLEN.get(piece.term, 0.0) <= fast[j]}
        result.append(frozenset(own if moved[j] else ()))
    return tuple(result)


def candidate_model(
    model: DynamicsModel, base: BaseParameters, allowed: Sequence[frozenset[Candidate]]
) -> CandidateModel:
    """The model with all pieces that its joints may get.

    Args:
        model: Arm and terms, with `load_parameters` where a piece depends on the load.
        base: Base parameters of the model.
        allowed: Pieces of each joint.
    """
    width = _width(model)
    shelf: list[Law] = []
    named: dict[tuple[int, Candidate], list[str]] = {}
    for j, pieces in enumerate(allowed):
        for k, piece in enumerate(sorted(pieces, key=lambda p: (p.term, p.shape, p.slope))):
            term = _term(piece.term, (piece.shape,), width, (model.robot.joint_names[j],))
            laws = [replace(law, symbol=f"C{k}.{i}") for i, law in enumerate(term.laws(model.robot))]
            if piece.slope:
                laws = [replace(law, expression=_slope(piece, law.expression)) for law in laws]
            named[j, piece] = [f"{law.symbol}_{law.joint + 1}" for law in laws]
            shelf += laws
    if not shelf:
        return CandidateModel(model, base, np.ones(base.count, dtype=np.bool_), {})
    whole = replace(model, terms=(*model.terms, _Shelf(tuple(shelf))))
    names = tuple(parameter.name for parameter in whole.parameters)
    place = {name: k for k, name in enumerate(names)}
    known = np.array([place[name] for name in base.standard_names])
    added = np.setdiff1d(np.arange(len(names)), known)
    kept = np.concatenate([known[base.kept], added])
    order = np.argsort(kept)
    regrouping = np.zeros((len(kept), len(names)))
    regrouping[: base.count, known] = base.regrouping
    regrouping[np.arange(base.count, len(kept)), added] = 1.0
    units = tuple(parameter.unit for parameter in whole.parameters)
    wide = BaseParameters(names, units, kept[order], regrouping[order], base.gravity)
    position = {names[k]: row for row, k in enumerate(wide.kept)}
    columns = {key: np.array([position[name] for name in each]) for key, each in named.items()}
    return CandidateModel(whole, wide, order < base.count, columns)


def terms_of(model: DynamicsModel, chosen: Sequence[frozenset[Candidate]]) -> tuple[Term, ...]:
    """The terms that the chosen pieces of each joint become; joints with the same shapes share a term."""
    width = _width(model)
    shapes: dict[tuple[str, tuple[float, ...]], list[str]] = {}
    for name, pieces in zip(model.robot.joint_names, chosen, strict=True):
        for term in sorted({piece.term for piece in pieces}):
            own = tuple(sorted(piece.shape for piece in pieces if piece.term == term))
            shapes.setdefault((term, own), []).append(name)
    return tuple(_term(term, own, width, tuple(joints)) for (term, own), joints in sorted(shapes.items()))


def described(pieces: Sequence[Candidate]) -> str:
    """Pieces in words: `hysteresis 0.01, 0.03`."""
    words: list[str] = []
    for term in dict.fromkeys(piece.term for piece in pieces):
        shapes = sorted(piece.shape for piece in pieces if piece.term == term and piece.shape)
        words.append(f"{term} {', '.join(f'{shape:g}' for shape in shapes)}".rstrip())
    return " + ".join(words)


def _width(model: DynamicsModel) -> float:
    """Velocity over which the sign turns in the model's own Coulomb friction."""
    return next((term.width for term in model.terms if isinstance(term, Coulomb)), 0.0)


def _term(name: str, shapes: tuple[float, ...], width: float, joints: tuple[str, ...]) -> Term:
    """A torque term with the shapes of pieces."""
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


def _speeds(model: DynamicsModel, observations: Observations) -> NDArray[np.float64]:
    """Speed that each joint has reached in some of its rows, shape (n,) [rad/s or m/s]."""
    result = np.zeros(model.n)
    for j in range(model.n):
        speeds = [np.abs(run.motion.dq[run.rows, j][run.mask[:, j]]) for run in observations.runs]
        if any(len(each) for each in speeds):
            result[j] = np.quantile(np.concatenate(speeds), SLOWER)
    return result


def _slope(piece: Candidate, law: Expression) -> Expression:
    """Derivative of a refined term's law by the logarithm of its shape."""
    velocity = symbol("dq")
    if piece.term == Stribeck.name:  # exp(-(dq / shape)²), the sign having a width of its own
        return 2.0 * (velocity * (1.0 / piece.shape)) ** 2.0 * law
    return -velocity * derivative(law, "dq")  # a sigmoid is a function of dq / shape


def _unknown(model: DynamicsModel, piece: Candidate, observations: Observations) -> NDArray[np.float64]:
    """Share of each joint's rows that come before the memory of a width is known, shape (n,)."""
    if not all(run.consecutive for run in observations.runs):
        return np.ones(model.n)
    alone = DynamicsModel(model.robot, (Hysteresis((piece.shape,)),))
    had = np.sum([run.mask.sum(axis=0) for run in observations.runs], axis=0)
    left = np.sum(
        [with_hysteresis_states(alone, run, observations.band).mask.sum(axis=0) for run in observations.runs], axis=0
    )
    return 1.0 - left / np.maximum(had, 1)
