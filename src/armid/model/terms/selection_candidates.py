"""Properties of a torque term for the automatic selection of friction, `terms = "auto"` in a study.

A candidate is a friction law with one shape, such as the Stribeck effect at one velocity. An option of a family is a
set of candidates that a joint gets together. Families are tried in a fixed order: first those that explain most of
the friction of real arms, last those that can imitate gravity or an offset. `VELOCITY` and `ASYMMETRY` contain
several terms; other families are defined in the module of their term.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from armid.model.torque_law_expression import Expression

if TYPE_CHECKING:
    from armid.model.terms.term import Term


@dataclass(frozen=True, slots=True)
class Candidate:
    """Candidate of the selection: a friction law with one shape.

    Attributes:
        term: Name of the torque term.
        shape: Shape of the law; 0 if the term has no shape.
        slope: True if the candidate is the derivative of the law with respect to the logarithm of the shape, instead
            of the law itself.
    """

    term: str
    shape: float = 0.0
    slope: bool = False


Option = tuple[Candidate, ...]
"""Option: candidates that a joint gets together."""


@dataclass(frozen=True, slots=True)
class CandidateFamily:
    """Family of friction laws: all candidates for one kind of friction, for instance the Stribeck effect.

    Attributes:
        name: Name of the kind of friction.
        options: Sets of candidates that a joint gets together.
        order: Position among the families; those with smaller numbers are tried first.
        shared: True if this friction is similar in all joints of an arm, so that one option is selected from the
            errors of all joints together.
        position: True if the friction could imitate gravity or an offset, so that it must reduce the error in
            other poses, too.
        rounds: Largest number of options that a joint may get one after another.
        margin: Smallest ratio of the gain of an option to its standard error. The gain is the decrease of the squared
            held-out error divided by this error.
        min_gain: Smallest gain with which an option is accepted.
        reselect: True if the family is selected again after all others, because near standstill most friction laws
            are similar.
    """

    name: str
    options: tuple[Option, ...] = ()
    order: int = 0
    shared: bool = False
    position: bool = False
    rounds: int = 1
    margin: float = 2.0
    min_gain: float = 0.01
    reselect: bool = False


VELOCITY = CandidateFamily("velocity", order=30, rounds=2, min_gain=0.03, reselect=True)
"""Family of the friction laws that depend on the velocity, in addition to Coulomb and viscous friction."""

ASYMMETRY = CandidateFamily("asymmetry", order=50, position=True, min_gain=0.05)
"""Family of the friction laws that depend on the direction of motion."""


@dataclass(frozen=True, slots=True)
class AutomaticChoice:
    """Properties of a torque term for the automatic selection of friction.

    Attributes:
        make: Function that creates the term from its shapes, the width of the model's Coulomb friction, and the names
            of the joints (`None` for all joints).
        options: Options that a joint may get, each with its family; they may contain candidates of other terms.
        saturation: Ratio of joint speed to shape above which a law of the velocity is saturated. The law is not a
            candidate for a joint that never exceeded this ratio, because below saturation it cannot be distinguished
            from viscous friction and its extrapolation would be wrong.
        one_shape: True if a joint can have the term only once, with one shape.
        resolution: Part of a short effect that must remain after the low-pass filter, so that the term can be a
            candidate. `height`: the peak of a velocity law; `transition`: the change of a hysteresis element after a
            reversal; empty: no requirement.
        log_slope: Function that gives the derivative of the law with respect to the logarithm of its shape, from
            expression and shape. It is used to refine the shape by least squares after the selection.
        periodic: True if the law is periodic in k q, with the angle q of the joint and the shape k. The law is a
            candidate only for a revolute joint that turns by at least one period of the law, 2π / k.
        is_sum: True if the term is a sum over several shapes. The selection may then remove single shapes, but not
            the largest one.
    """

    make: Callable[[tuple[float, ...], float, tuple[str, ...] | None], Term]
    options: tuple[tuple[CandidateFamily, Option], ...]
    saturation: float = 0.0
    one_shape: bool = False
    resolution: Literal["", "height", "transition"] = ""
    log_slope: Callable[[Expression, float], Expression] | None = None
    periodic: bool = False
    is_sum: bool = False


def one_by_one(
    family: CandidateFamily, term: str, shapes: Sequence[float] = (0.0,)
) -> tuple[tuple[CandidateFamily, Option], ...]:
    """Makes one option of a family for each shape of a term; each option has only this candidate.

    Args:
        family: Family of the options.
        term: Name of the term.
        shapes: Shapes of the term, such as Stribeck velocities; if not given, one option without a shape.
    """
    return tuple((family, (Candidate(term, shape),)) for shape in shapes)


def automatic_choice(term: type[Term]) -> AutomaticChoice | None:
    """Properties of a term for the automatic selection of friction; `None` if the selection does not try the term."""
    return getattr(term, "automatic", None)
