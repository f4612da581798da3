"""Descriptions of torque terms with the values and units of their shapes: `Stribeck effect at 0.05 rad/s`."""

from __future__ import annotations

from collections.abc import Iterable

from armid.model.terms.term import DescribedTerm, Term


def describe_term(term: Term, *, prismatic: bool = False) -> str:
    """Description of a torque term with its shapes, or its name if it has no shapes.

    Args:
        term: The term.
        prismatic: True if the joint of the term is prismatic; the units then have metres in place of radians.
    """
    length = "m" if prismatic else "rad"
    return term.describe(length) if isinstance(term, DescribedTerm) else term.name.replace("-", " ")


def friction_of_joint(terms: Iterable[Term], joint: str, *, prismatic: bool = False) -> tuple[str, ...]:
    """Descriptions of those torque terms that act on a joint, each listed once.

    Args:
        terms: Torque terms, each of which acts on some or all joints.
        joint: Name of the joint.
        prismatic: True if the joint is prismatic.
    """
    own = [term for term in terms if (on := getattr(term, "joints", None)) is None or joint in on]
    return tuple(dict.fromkeys(describe_term(term, prismatic=prismatic) for term in own))
