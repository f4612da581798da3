"""Detection of a wrong sign of gravity or torque from the identified parameters.

A regrouped first moment such as MYR_2 = MY_2 + 0.2045 M_3 + 0.42 (M_4 + …) contains the masses of all links that a
joint carries, multiplied by lengths of the arm. Masses are positive, and centres of mass lie within the links, so
these lengths determine the sign of the moment. If gravity has the wrong sign, these moments are identified with the
wrong sign, but friction and inertias keep the correct sign.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from armid.checked_array import array
from armid.errors import Finding
from armid.measurement.remedy_builders import lines
from armid.model.base_parameters import BaseParameters
from armid.remedy import Assignment, Remedy
from armid.robot import Robot

STRONGEST_GRAVITY = 15.0
"""Largest plausible acceleration of gravity [m/s²]. A larger value in a study or description is a mistake."""

WEIGHTY = 0.1
"""Ratio of a regrouped first moment to the largest one below which the moment is ignored. In a wrist, the first
moment of a link itself can be larger than the contribution of the masses that the link carries."""

MOMENTS = ("MX", "MY", "MZ")
FRICTION = ("FV", "FS")


def gravity_finding(robot: Robot) -> Finding | None:
    """Finding about an acceleration of gravity above `STRONGEST_GRAVITY`; `None` if the magnitude is plausible."""
    strength = float(np.linalg.norm(robot.gravity))
    if strength <= STRONGEST_GRAVITY:
        return None
    return Finding(
        "gravity-direction",
        "warning",
        "",
        f"The acceleration of gravity is {strength:.4g} m/s²; at most {STRONGEST_GRAVITY:g} m/s² is plausible.",
        "correct the key `gravity`; its unit is m/s², for instance [0, 0, -9.81]",
    )


def gravity_sign_finding(base: BaseParameters, values: ArrayLike) -> Finding | None:
    """Finding about a probably wrong sign of gravity or torque; `None` if the parameters do not contradict the signs.

    Args:
        base: Base parameters and the gravity for which they hold.
        values: Identified values of the base parameters, shape (b,).
    """
    values = array(values, (base.count,), "base parameters")
    symbols = np.array([name.symbol for name in base.standard_names])
    forced = _forced(base, symbols)
    size = np.abs(values * forced)
    telling = np.flatnonzero(size > WEIGHTY * size.max(initial=0.0))
    against = [k for k in telling if values[k] * forced[k] < 0.0]
    if not against or size[against].sum() < 0.5 * size[telling].sum():
        return None
    listed = ", ".join(f"{base.names[k]} = {values[k]:.4g}" for k in against)
    friction = values[np.isin(symbols[base.kept], FRICTION)]
    turned = bool(len(friction)) and float(friction.sum()) < 0.0
    sign = "negative" if forced[against[0]] > 0.0 else "positive"
    evidence = (
        f"{listed}: {sign}, but with positive masses the lengths of the arm give the other sign for any centre of "
        f"mass within its link ({len(against)} of {len(telling)} such moments)."
    )
    if turned:
        return Finding("torque-sign", "warning", "", f"{evidence} Friction is negative, too.", lines(torque_sign=-1))
    text = f"gravity = [{', '.join(f'{-x + 0.0:.4g}' for x in base.gravity)}]"
    opposite = Assignment(text, {"gravity": [float(f"{-x + 0.0:.4g}") for x in base.gravity]})
    friction_text = " Friction has the correct sign, so only gravity has the wrong sign." if len(friction) else ""
    remedy = Remedy(opposite, table="robot")
    return Finding("gravity-direction", "warning", "", f"{evidence}{friction_text}", remedy)


def _forced(base: BaseParameters, symbols: NDArray[np.str_]) -> NDArray[np.float64]:
    """Sign that positive masses give to each base parameter, shape (b,): +1, -1, or 0 if the sign is undetermined.

    Only first moments have a determined sign.

    Args:
        base: Base parameters.
        symbols: Symbol of each standard parameter, such as `M`, shape (p,).
    """
    masses = base.regrouping[:, symbols == "M"]
    moment = np.isin(symbols[base.kept], MOMENTS)
    up, down = (masses > 0.0).any(axis=1), (masses < 0.0).any(axis=1)
    return np.where(moment & up & ~down, 1.0, np.where(moment & down & ~up, -1.0, 0.0))
