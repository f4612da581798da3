"""Part of a term in the automatic selection of friction, `terms = "auto"`, as data that the selection reads.

A candidate is a friction law with one shape, such as the Stribeck effect at one velocity. An option of a family is a
set of candidates that a joint gets together. Families are tried in their order: first what explains most of the
friction of real arms, last what can imitate gravity or an offset. `VELOCITY` and `ASYMMETRY` have several terms;
other families are in the file of their term.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from armid.model.symbolic_expression import Expression

if TYPE_CHECKING:
    from armid.model.terms.term import Term


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


Option = tuple[Candidate, ...]
"""Candidates that a joint gets together."""


@dataclass(frozen=True, slots=True)
class CandidateFamily:
    """Candidates for one kind of friction.

    Attributes:
        name: Name of the kind.
        options: Sets of candidates that a joint gets together.
        order: Position among the families; those with smaller numbers are tried first.
        shared: Whether the joints of one arm are alike in it, so that the evidence of all joints counts for each.
        position: Whether it could imitate gravity or an offset, and must therefore gain in other poses too.
        rounds: Largest number of options that a joint may get one after another.
        margin: Standard errors by which a gain must exceed zero.
        min_gain: Smallest gain that justifies a term, as a share of the remaining squared error.
        reselect: Whether the family is selected again once all others have been: near standstill most friction laws
            resemble each other.
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
"""Laws of the velocity beside Coulomb and viscous friction."""

ASYMMETRY = CandidateFamily("asymmetry", order=50, position=True, min_gain=0.05)
"""Friction that depends on the direction."""


@dataclass(frozen=True, slots=True)
class AutomaticChoice:
    """Part of a term in the automatic selection of friction.

    Attributes:
        make: Makes the term from the shapes that joints were given, the width of the model's Coulomb friction, and
            the names of these joints; `None` for all.
        options: What a joint may get, each with its family; candidates of other terms may be among them.
        saturation: Ratio of joint speed to the shape above which a law of the velocity is saturated. A joint that was
            never so fast is not offered the law: below saturation it resembles viscous friction, and would
            extrapolate wrongly.
        one_shape: Whether a joint can have the term only once, with one shape.
        resolution: What the band must resolve of a term that acts for a short time after a reversal: the `height` of
            a law of the velocity, or the `transition` of a hysteresis element.
        log_slope: Derivative of the law's expression by the logarithm of its shape, from expression and shape; with
            it the shape is refined by least squares once the term is selected.
        revolute_only: Whether only revolute joints may have it.
        is_sum: Whether a joint has a sum of its shapes, from which single ones, but not the largest, may be dropped.
    """

    make: Callable[[tuple[float, ...], float, tuple[str, ...] | None], Term]
    options: tuple[tuple[CandidateFamily, Option], ...]
    saturation: float = 0.0
    one_shape: bool = False
    resolution: Literal["", "height", "transition"] = ""
    log_slope: Callable[[Expression, float], Expression] | None = None
    revolute_only: bool = False
    is_sum: bool = False


def one_by_one(
    family: CandidateFamily, term: str, shapes: Sequence[float] = (0.0,)
) -> tuple[tuple[CandidateFamily, Option], ...]:
    """Options of a single candidate each, one for each shape.

    Args:
        family: Family of the options.
        term: Name of the term.
        shapes: Its shapes; one without a shape if not given.
    """
    return tuple((family, (Candidate(term, shape),)) for shape in shapes)


def automatic_choice(term: type[Term]) -> AutomaticChoice | None:
    """Part of a term in the automatic selection of friction; `None` for one that is only selected by name."""
    return getattr(term, "automatic", None)
