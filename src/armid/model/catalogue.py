"""Catalogue `TERMS` of torque terms: a new term is a new file and one line here."""

from __future__ import annotations

from typing import TYPE_CHECKING

from armid.lazy_catalogue import Catalogue

if TYPE_CHECKING:
    from armid.model.terms.term import Term

TERMS: Catalogue[type[Term]] = Catalogue(
    {
        "rigid-body": "armid.model.terms.rigid_body:RigidBody",
        "viscous": "armid.model.terms.friction.viscous:Viscous",
        "coulomb": "armid.model.terms.friction.coulomb:Coulomb",
        "offset": "armid.model.terms.offset:Offset",
        "rotor-inertia": "armid.model.terms.rotor_inertia:RotorInertia",
        "coupling": "armid.model.terms.coupling:Coupling",
        "asymmetric-coulomb": "armid.model.terms.friction.asymmetric_coulomb:AsymmetricCoulomb",
        "asymmetric-viscous": "armid.model.terms.friction.asymmetric_viscous:AsymmetricViscous",
        "stribeck": "armid.model.terms.friction.stribeck:Stribeck",
        "sigmoid": "armid.model.terms.friction.sigmoid:Sigmoid",
        "power-viscous": "armid.model.terms.friction.power_viscous:PowerViscous",
        "piecewise-viscous": "armid.model.terms.friction.piecewise_viscous:PiecewiseViscous",
        "hysteresis": "armid.model.terms.friction.hysteresis:Hysteresis",
        "ripple": "armid.model.terms.ripple:Ripple",
        "load-coulomb": "armid.model.terms.friction.load_coulomb:LoadCoulomb",
        "load-viscous": "armid.model.terms.friction.load_viscous:LoadViscous",
    }
)
"""Terms by their names in a study. The automatic selection tries the friction laws of one family in this order."""
