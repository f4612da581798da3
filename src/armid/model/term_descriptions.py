"""Torque terms in words with the units of their shapes: `Stribeck effect at 0.05 rad/s`."""

from __future__ import annotations

from collections.abc import Iterable

from armid.model.terms.term import DescribedTerm, Term


def describe_term(term: Term, *, prismatic: bool = False) -> str:
    """Term with its shapes in words, or its name where it has none.

    Args:
        term: The term.
        prismatic: Whether its joint is prismatic: metres in place of radians.
    """
    length = "m" if prismatic else "rad"
    return term.describe(length) if isinstance(term, DescribedTerm) else term.name.replace("-", " ")


def friction_of_joint(terms: Iterable[Term], joint: str, *, prismatic: bool = False) -> tuple[str, ...]:
    """Descriptions of the terms that act on a joint, each once.

    Args:
        terms: Terms of some joints or of all.
        joint: Name of the joint.
        prismatic: Whether the joint is prismatic.
    """
    own = [term for term in terms if (on := getattr(term, "joints", None)) is None or joint in on]
    return tuple(dict.fromkeys(describe_term(term, prismatic=prismatic) for term in own))
