"""Torque terms, one a file. `TERMS` is the catalogue: a new term is a new file and one line here."""

from armid.model.terms.coulomb import Coulomb
from armid.model.terms.coupling import Coupling
from armid.model.terms.offset import Offset
from armid.model.terms.rigid_body import RigidBody
from armid.model.terms.rotor_inertia import RotorInertia
from armid.model.terms.term import Law, Term
from armid.model.terms.viscous import Viscous

__all__ = ["TERMS", "Coulomb", "Coupling", "Law", "Offset", "RigidBody", "RotorInertia", "Term", "Viscous"]

TERMS: dict[str, type[Term]] = {
    term.name: term for term in (RigidBody, Viscous, Coulomb, Offset, RotorInertia, Coupling)
}
"""Terms by their names in a study, in the order in which their parameters stand."""
