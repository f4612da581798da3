"""Hysteresis at reversals by the Maxwell-slip model: τ = Σ FH_k · (q - z_k) / r_k.

Each element is a spring between the joint and a point z_k. If the deflection of the spring reaches r_k, the point z_k
slips. So z_k is the state of a play operator in q. After a reversal, the torque of the element changes from one limit
to the other over a motion of 2 r_k, independent of the velocity [AlBender2005].
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

from armid.model.hysteresis_memory import Play
from armid.model.terms.checks import require_rising
from armid.model.terms.selection_candidates import AutomaticChoice, Candidate, CandidateFamily, Option, one_by_one
from armid.model.terms.term import Law, listed, single_joint_laws
from armid.robot.robot import Robot

WIDTHS = (0.001, 0.003, 0.01, 0.03, 0.1)
"""Deflections [rad or m] at which the elements slip in the laws that the automatic selection tries, half a decade
apart. They extend from the resolution of encoders to a few degrees, where the law begins to resemble a spring. A sum
of such elements approximates any hysteresis curve."""

BETWEEN = (0.002, 0.005, 0.02, 0.05)
"""Further deflections at which an element slips, between those of `WIDTHS` [rad or m]. The automatic selection adds
them only for recordings with enough information to distinguish them."""

FINEST = (0.0014, 0.007, 0.014, 0.035, 0.07)
"""Further deflections at which an element slips, between those of `WIDTHS` and `BETWEEN` [rad or m]. The automatic
selection tries them one at a time."""

FAMILY = CandidateFamily("hysteresis", order=10, shared=True, margin=2.5)
FINER_FAMILY = CandidateFamily("finer hysteresis", order=60, min_gain=0.02)
FINEST_FAMILY = CandidateFamily("finest hysteresis", order=70, rounds=2, min_gain=0.02)


def _elements(family: CandidateFamily, widths: Sequence[float]) -> tuple[CandidateFamily, Option]:
    """Family, and its option in which a joint gets the hysteresis elements of all given widths together."""
    return family, tuple(Candidate("hysteresis", width) for width in widths)


@dataclass(frozen=True, slots=True)
class Hysteresis:
    """Friction with hysteresis in the position: a sum of elements, each a spring that slips at a deflection.

    Attributes:
        widths: Deflections r_k at which the elements slip, ascending [rad or m].
        joints: Names of the joints with this term; `None` for all joints.
    """

    widths: tuple[float, ...] = (0.003, 0.01, 0.03, 0.1)
    joints: tuple[str, ...] | None = None
    name: ClassVar[str] = "hysteresis"
    automatic: ClassVar[AutomaticChoice] = AutomaticChoice(
        make=lambda shapes, width, joints: Hysteresis(shapes, joints),
        options=(
            *(_elements(FAMILY, widths) for widths in (WIDTHS, WIDTHS[:-1], WIDTHS[1:])),
            _elements(FINER_FAMILY, BETWEEN),
            *one_by_one(FINER_FAMILY, "hysteresis", (*BETWEEN, *WIDTHS)),
            *one_by_one(FINEST_FAMILY, "hysteresis", FINEST),
        ),
        resolution="transition",
        is_sum=True,
    )

    def __post_init__(self) -> None:
        object.__setattr__(self, "widths", require_rising("The widths of hysteresis", self.widths))

    def laws(self, robot: Robot) -> tuple[Law, ...]:
        """Laws FH_k · (q - z_k) / r_k of each joint, one for each width r_k, with the hysteresis state z_k."""
        laws: list[Law] = []
        for k, width in enumerate(self.widths, 1):
            play = Play(width)
            laws += single_joint_laws(
                robot, self.joints, f"FH{k}", play.deflection, units=("N·m", "N"), nonnegative=True, memory=play
            )
        return tuple(laws)

    def describe(self, length: str) -> str:
        """Description of the term in words, with its shapes; `length` is the unit of the positions, `rad` or `m`."""
        return f"hysteresis over {listed(self.widths)} {length}"
