"""Finite Fourier series, the band-limited periodic motion for excitation, with exact derivatives.

    q_i(t) = offset_i + Σ_l a_il / (ω l) sin(ω l t) - b_il / (ω l) cos(ω l t)        (3.55b)

The coefficients a and b are those of the velocity [Swevers1997].
"""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from armid.errors import ArmidError
from armid.model.motion import Motion
from armid.notebook import Displayed, Summary
from armid.values import Array, array, replace_file

SUMMARY_RATE = 40
"""Samples per period of the highest harmonic from which a summary is computed."""

PLAN_FILE = "plan.json"
"""Name of the plan in a folder of `armid excite`."""

PLAN_KEYS = ("robot", "base_frequency", "offset", "a", "b")


@dataclass(frozen=True, eq=False, slots=True, repr=False)
class Excitation(Displayed):
    """Periodic motion of n joints with L harmonics.

    Attributes:
        base_frequency: ω [rad/s].
        a: Sine coefficients, shape (n, L) [rad/s or m/s].
        b: Cosine coefficients, shape (n, L) [rad/s or m/s].
        offset: Position about which the joints move, shape (n,) [rad or m].
        robot: Name of the arm for which it was designed.
    """

    base_frequency: float
    a: Array
    b: Array
    offset: Array
    robot: str = ""

    def __post_init__(self) -> None:
        object.__setattr__(self, "base_frequency", float(self.base_frequency))
        if not 0.0 < self.base_frequency < math.inf:
            raise ArmidError(f"The base frequency must be positive; found {self.base_frequency} rad/s.")
        a = array(self.a, (None, None), "a")
        object.__setattr__(self, "a", a)
        object.__setattr__(self, "b", array(self.b, a.shape, "b"))
        object.__setattr__(self, "offset", array(self.offset, (len(a),), "offset"))

    def summary(self) -> Summary:
        """Range and speed of each joint over a period."""
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
        """Whole periods at `rate` samples per second [Hz], from t = 0 to one sample before the end."""
        return self.at(np.arange(round(periods * self.period * rate)) / rate)

    def stretched(self, period: float) -> Excitation:
        """Same path with another period [s]: velocities scale with the ratio of the periods."""
        ratio = self.period / period
        return replace(self, base_frequency=self.base_frequency * ratio, a=self.a * ratio, b=self.b * ratio)


def load_plan(path: Path | str) -> Excitation:
    """Reads one period of the excitation of a `plan.json`, without the moves before and after it.

    Args:
        path: The file, or a folder written by `armid excite`.

    Raises:
        ArmidError: The file is missing, is no JSON, or lacks a key, as plans of poses or sweeps do.
    """
    path = Path(path)
    path = path / PLAN_FILE if path.is_dir() else path
    try:
        plan: Any = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise ArmidError(f"{path} is no plan: {error}.", remedy="give a plan.json.") from error
    missing = [key for key in PLAN_KEYS if not isinstance(plan, dict) or key not in plan]
    if missing:
        point_to_point = isinstance(plan, dict) and "stretches" in plan
        raise ArmidError(
            f"{path} lacks {', '.join(missing)}.",
            possible=", ".join(PLAN_KEYS),
            remedy="it is a plan of poses or sweeps: armid.study.plans.plan_files.read_whole_plan reads it."
            if point_to_point
            else "",
        )
    try:
        return Excitation(plan["base_frequency"], plan["a"], plan["b"], plan["offset"], str(plan["robot"]))
    except (TypeError, ValueError) as error:
        raise ArmidError(f"{path} is no plan: base_frequency must be a number ({error}).") from error


def required_series(plan: object) -> Excitation:
    """Returns the argument if it is an `Excitation`.

    Raises:
        ArmidError: It is something else, for instance the name of a file.
    """
    if isinstance(plan, Excitation):
        return plan
    found = repr(plan)[:60] if isinstance(plan, str | Path) else f"a {type(plan).__name__}"
    remedy = 'give load_plan("plan.json") of armid.excitation.fourier, or the excitation of a whole plan.'
    raise ArmidError(f"A motion must be given as an Excitation; found {found}.", remedy=remedy)


def save_plan(excitation: Excitation, path: Path | str) -> Path:
    """Writes an excitation as a `plan.json` with numbers in full precision.

    Raises:
        ArmidError: The first argument is no excitation.
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
