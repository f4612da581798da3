"""Torque terms. Each module defines one term; `armid.model.catalogue` lists them.

The classes can also be imported from here. A new term needs no line in this module.
"""

from armid.model.catalogue import TERMS
from armid.model.terms.coupling import Coupling
from armid.model.terms.friction.asymmetric_coulomb import AsymmetricCoulomb
from armid.model.terms.friction.asymmetric_viscous import AsymmetricViscous
from armid.model.terms.friction.coulomb import Coulomb
from armid.model.terms.friction.hysteresis import Hysteresis
from armid.model.terms.friction.load_coulomb import LoadCoulomb
from armid.model.terms.friction.load_viscous import LoadViscous
from armid.model.terms.friction.piecewise_viscous import PiecewiseViscous
from armid.model.terms.friction.power_viscous import PowerViscous
from armid.model.terms.friction.sigmoid import Sigmoid
from armid.model.terms.friction.stribeck import Stribeck
from armid.model.terms.friction.viscous import Viscous
from armid.model.terms.offset import Offset
from armid.model.terms.rigid_body import RigidBody
from armid.model.terms.ripple import Ripple
from armid.model.terms.rotor_inertia import RotorInertia
from armid.model.terms.term import Law, Term

__all__ = [
    "DEFAULT_TERMS",
    "TERMS",
    "AsymmetricCoulomb",
    "AsymmetricViscous",
    "Coulomb",
    "Coupling",
    "Hysteresis",
    "Law",
    "LoadCoulomb",
    "LoadViscous",
    "Offset",
    "PiecewiseViscous",
    "PowerViscous",
    "RigidBody",
    "Ripple",
    "RotorInertia",
    "Sigmoid",
    "Stribeck",
    "Term",
    "Viscous",
]

DEFAULT_TERMS: tuple[Term, ...] = (RigidBody(), Viscous(), Coulomb(width=0.02), Offset())
"""Torque terms of a model for which no terms are given. Because of the width of Coulomb friction [rad/s], encoder
noise does not change the sign of the friction at rest."""
