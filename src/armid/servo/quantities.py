"""Names and units of the parameters of a servo, for tables; units depend on whether a joint turns or slides."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from armid.robot.robot import Joint


@dataclass(frozen=True, slots=True)
class Quantity:
    """Parameter of a servo or of friction in a table.

    Attributes:
        title: Name.
        turning: Unit for a joint that turns.
        sliding: Unit for a joint that slides.
        scale: Factor from SI units to these units.
    """

    title: str
    turning: str
    sliding: str
    scale: float = 1.0

    def unit(self, joint: Joint) -> str:
        """Unit for a joint."""
        return self.sliding if joint.is_prismatic else self.turning

    def units(self, joints: Sequence[Joint]) -> str:
        """Units for the joints of an arm without repetition, for instance `mrad or mm`."""
        return " or ".join(dict.fromkeys(self.unit(joint) for joint in joints))


QUANTITIES = {
    "stiffness": Quantity("stiffness", "N·m/rad", "N/m"),
    "damping": Quantity("damping", "N·m·s/rad", "N·s/m"),
    "limit": Quantity("largest torque", "N·m", "N"),
    "FV": Quantity("viscous friction", "N·m·s/rad", "N·s/m"),
    "FS": Quantity("Coulomb friction", "N·m", "N"),
    "rotor_inertia": Quantity("rotor inertia", "kg·m²", "kg"),
    "offset": Quantity("offset", "mrad", "mm", 1e3),
    "delay": Quantity("delay", "ms", "ms", 1e3),
}
"""Parameters by their kind in `EstimatedValue`; further kinds are symbols of friction laws in SI units."""

POSITION_ERROR = Quantity("position error", "mrad", "mm", 1e3)


def quantity_of(kind: str) -> Quantity:
    """Name and units of a parameter; a friction law that is not in `QUANTITIES` has its symbol and no unit."""
    return QUANTITIES.get(kind, Quantity(kind, "", ""))
