"""Finite Fourier series: the band-limited periodic motion for excitation, with exact derivatives.

    q_i(t) = offset_i + Σ_l a_il / (ω l) sin(ω l t) - b_il / (ω l) cos(ω l t)

This is equation (3.55b) of the thesis for joint i, with base frequency ω and harmonics l = 1 … L. The coefficients a
and b are those of the velocity [Swevers1997].
"""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from armid.atomic_file import replace_file
from armid.checked_array import Array, array
from armid.errors import ArmidError
from armid.input_boundary import boundary, naming, read_json, within
from armid.model.motion import Motion
from armid.notebook_display import Displayed, Summary

SUMMARY_RATE = 40
"""Number of samples, per period of the highest harmonic, from which a summary is computed."""

PLAN_FILE = "plan.json"
"""Name of the plan file in a folder that `armid excite` has written."""

PLAN_KEYS = ("robot", "base_frequency", "offset", "a", "b")


@dataclass(frozen=True, eq=False, slots=True, repr=False)
class Excitation(Displayed):
    """Periodic motion of n joints with L harmonics.

    Attributes:
        base_frequency: Angular frequency ω of the first harmonic [rad/s].
        a: Sine coefficients, shape (n, L) [rad/s or m/s].
        b: Cosine coefficients, shape (n, L) [rad/s or m/s].
        offset: Position about which the joints move, shape (n,) [rad or m].
        robot: Name of the arm for which the motion was designed.
    """

    base_frequency: float
    a: Array
    b: Array
    offset: Array
    robot: str = ""

    def __post_init__(self) -> None:
        object.__setattr__(self, "base_frequency", float(self.base_frequency))
        if not 0.0 < self.base_frequency < math.inf:
            raise ArmidError(
                f"The base frequency must be positive and finite; found {self.base_frequency} rad/s.",
                remedy="give a positive base_frequency.",
            )
        a = array(self.a, (None, None), "a")
        object.__setattr__(self, "a", a)
        object.__setattr__(self, "b", array(self.b, a.shape, "b"))
        object.__setattr__(self, "offset", array(self.offset, (len(a),), "offset"))

    def summary(self) -> Summary:
        """Table of the ranges of position, velocity and acceleration of each joint over one period."""
        summary = self.sample(SUMMARY_RATE * self.harmonics / self.period).summary()
        title = f"{self.robot or 'motion'}: {self.harmonics} harmonics over {self.period:.4g} s"
        return replace(summary, title=title)

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.a)

    @property
    def harmonics(self) -> int:
        """Number of harmonics L."""
        return self.a.shape[1]

    @property
    def period(self) -> float:
        """Duration of one period [s]."""
        return 2.0 * math.pi / self.base_frequency

    def at(self, time: ArrayLike) -> Motion:
        """Motion at times (N,) [s], with exact derivatives."""
        t = array(time, (None,), "time")
        frequency = self.base_frequency * np.arange(1, self.harmonics + 1)
        s, c = np.sin(np.outer(t, frequency)), np.cos(np.outer(t, frequency))
        q = self.offset + (s / frequency) @ self.a.T - (c / frequency) @ self.b.T
        dq = c @ self.a.T + s @ self.b.T
        ddq = (-s * frequency) @ self.a.T + (c * frequency) @ self.b.T
        return Motion(t, q, dq, ddq)

    def sample(self, rate: float, periods: int = 1) -> Motion:
        """Samples of a whole number of periods at a rate [Hz], from t = 0 to one sample before the end."""
        count = periods * self.period * rate
        within("motion", count, f"The motion of {periods} times {self.period:.4g} s at {rate:.4g} Hz")
        if not count >= 1.0:
            raise ArmidError(
                f"A motion of {periods} times {self.period:.4g} s has no sample at {rate:.4g} Hz.",
                remedy="correct the base frequency of the plan, or raise the rate.",
            )
        return self.at(np.arange(round(count)) / rate)

    def stretched(self, period: float) -> Excitation:
        """Motion along the same path, with time scaled so that the period is `period` [s]."""
        ratio = self.period / period
        return replace(self, base_frequency=self.base_frequency * ratio, a=self.a * ratio, b=self.b * ratio)


def load_plan(path: Path | str) -> Excitation:
    """Reads one period of the excitation of a plan, without the moves before and after it.

    Args:
        path: The file `plan.json`, or a folder that `armid excite` has written.

    Raises:
        ArmidError: The file is missing, is not JSON, or lacks a key; plans of poses or sweeps, for instance, lack
            keys.
    """
    path = Path(path)
    path = path / PLAN_FILE if path.is_dir() else path
    remedy = "give a plan.json that armid excite has written."
    plan = read_json(path, "a plan", remedy=remedy)
    missing = [key for key in PLAN_KEYS if key not in plan]
    if missing:
        point_to_point = "stretches" in plan
        raise ArmidError(
            f"{path} is not a plan of a periodic excitation: it lacks the keys {', '.join(missing)}.",
            possible=", ".join(PLAN_KEYS),
            remedy="this is a plan of poses or sweeps: read it with armid.study.plans.plan_reading.read_whole_plan."
            if point_to_point
            else remedy,
        )
    with boundary("a plan", path, remedy=remedy), naming(path):
        return Excitation(plan["base_frequency"], plan["a"], plan["b"], plan["offset"], str(plan["robot"]))


def required_series(plan: object) -> Excitation:
    """Returns the argument if it is an `Excitation`; otherwise raises an error.

    Raises:
        ArmidError: The argument is something else, for instance the name of a file.
    """
    if isinstance(plan, Excitation):
        return plan
    found = repr(plan)[:60] if isinstance(plan, str | Path) else f"a {type(plan).__name__}"
    remedy = 'load it with load_plan("plan.json") of armid.excitation.fourier, or give the excitation of a Plan.'
    raise ArmidError(f"The motion must be an Excitation; found {found}.", remedy=remedy)


def save_plan(excitation: Excitation, path: Path | str) -> Path:
    """Writes an excitation to a file `plan.json`, with numbers in full precision.

    Raises:
        ArmidError: The first argument is not an `Excitation`.
    """
    excitation = required_series(excitation)
    plan = {
        "robot": excitation.robot,
        "base_frequency": excitation.base_frequency,
        "offset": excitation.offset.tolist(),
        "a": excitation.a.tolist(),
        "b": excitation.b.tolist(),
    }
    return replace_file(path, json.dumps(plan, indent=1) + "\n")
