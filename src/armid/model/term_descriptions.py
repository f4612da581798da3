"""Torque terms in words with the units of their shapes: `Stribeck effect at 0.05 rad/s`."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

from armid.model.terms.term import Term


def describe_term(term: Term, *, prismatic: bool = False) -> str:
    """Term with its shapes in words, or its name where it has none.

    Args:
        term: The term.
        prismatic: Whether its joint is prismatic: metres in place of radians.
    """
    length = "m" if prismatic else "rad"
    write = _WORDS.get(term.name)
    return write(term, length) if write else term.name.replace("-", " ")


def friction_of_joint(terms: Iterable[Term], joint: str, *, prismatic: bool = False) -> tuple[str, ...]:
    """Descriptions of the terms that act on a joint, each once.

    Args:
        terms: Terms of some joints or of all.
        joint: Name of the joint.
        prismatic: Whether the joint is prismatic.
    """
    own = [term for term in terms if (on := getattr(term, "joints", None)) is None or joint in on]
    return tuple(dict.fromkeys(describe_term(term, prismatic=prismatic) for term in own))


def _listed(values: Iterable[float]) -> str:
    return ", ".join(f"{value:.3g}" for value in values)


_WORDS: dict[str, Callable[[Any, str], str]] = {
    "hysteresis": lambda term, length: f"hysteresis over {_listed(term.widths)} {length}",
    "stribeck": lambda term, length: f"Stribeck effect at {term.velocity:.3g} {length}/s",
    "sigmoid": lambda term, length: f"sigmoid of velocity over {2.0 / term.slope:.3g} {length}/s",
    "power-viscous": lambda term, length: f"viscous, velocity to the power {term.exponent:.3g}",
    "piecewise-viscous": lambda term, length: f"viscous, slope changes at {_listed(term.knots)} {length}/s",
    "asymmetric-coulomb": lambda term, length: "Coulomb, depends on direction",
    "asymmetric-viscous": lambda term, length: "viscous, depends on direction",
    "load-coulomb": lambda term, length: "Coulomb, grows with the load",
    "load-viscous": lambda term, length: "viscous, grows with the load",
    "ripple": lambda term, length: f"ripple, harmonics {_listed(term.harmonics)}",
}
"""Descriptions of terms that have shapes, or whose name needs more words."""
