"""Detection of the opposite sign of gravity or torque from identified parameters alone.

A regrouped first moment such as MYR_2 = MY_2 + 0.2045 M_3 + 0.42 (M_4 + …) contains the masses of all links that a
joint carries, times lengths of the arm. Masses are positive and centres of mass lie within their links, so its sign
is that of the lengths. Under gravity of the opposite sign these moments have the opposite sign, while friction and
inertias keep theirs.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from armid.errors import Finding
from armid.measurement.log_format_remedies import lines
from armid.model.base_parameters import BaseParameters
from armid.remedy import Assignment, Remedy
from armid.robot import Robot
from armid.values import array

STRONGEST_GRAVITY = 15.0
"""Acceleration above which a stated gravity is a mistake [m/s²]."""

WEIGHTY = 0.1
"""Share of the largest of these moments below which one is ignored: in a wrist a link's own moment can exceed that of
the carried masses."""

MOMENTS = ("MX", "MY", "MZ")
FRICTION = ("FV", "FS")


def gravity_finding(robot: Robot) -> Finding | None:
    """Finding on an implausible strength of gravity, or `None`."""
    strength = float(np.linalg.norm(robot.gravity))
    if strength <= STRONGEST_GRAVITY:
        return None
    return Finding(
        "gravity-direction",
        "warning",
        "",
        f"Gravity is {strength:.4g} m/s².",
        "correct gravity: it is in m/s², for instance [0, 0, -9.81]",
    )


def gravity_sign_finding(base: BaseParameters, values: ArrayLike) -> Finding | None:
    """Finding that gravity or the torque seems to have the opposite sign, or `None`.

    Args:
        base: Base parameters, with their gravity.
        values: Base parameters, shape (b,).
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
        f"{listed}: {sign}, although the lengths of the arm and positive masses force the other sign for any centre "
        f"of mass within its link ({len(against)} of {len(telling)} such moments)."
    )
    if turned:
        return Finding("torque-sign", "warning", "", f"{evidence} Friction is negative too.", lines(torque_sign=-1))
    text = f"gravity = [{', '.join(f'{-x + 0.0:.4g}' for x in base.gravity)}]"
    opposite = Assignment(text, {"gravity": [float(f"{-x + 0.0:.4g}") for x in base.gravity]})
    friction_text = " Friction has the right sign, so that gravity alone is turned." if len(friction) else ""
    remedy = Remedy(opposite, table="robot")
    return Finding("gravity-direction", "warning", "", f"{evidence}{friction_text}", remedy)


def _forced(base: BaseParameters, symbols: NDArray[np.str_]) -> NDArray[np.float64]:
    """Sign that masses force on each base parameter, +1 or -1, and 0 where they force none, shape (b,)."""
    masses = base.regrouping[:, symbols == "M"]
    moment = np.isin(symbols[base.kept], MOMENTS)
    up, down = (masses > 0.0).any(axis=1), (masses < 0.0).any(axis=1)
    return np.where(moment & up & ~down, 1.0, np.where(moment & down & ~up, -1.0, 0.0))
