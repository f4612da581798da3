"""Interface of torque terms and of their laws, which are mathematical expressions.

A law is τ = parameter · expression. The expression may contain the position `q`, velocity `dq` and acceleration `ddq`
of one coordinate c = Σ w_j q_j, the torque `load` of the rigid bodies on this coordinate, and the hysteresis `state`
of the law. For most laws the coordinate is a single joint (w = 1). A law may also use a combination of joints, for
instance for the friction of a motor that drives two joints. It then acts on each joint with its weight: τ_j = w_j ·
parameter · expression (virtual work). Regressor columns, derivatives and formulas are all computed from the law.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import ClassVar, Protocol, runtime_checkable

from armid.model.hysteresis_memory import Coordinate, Play
from armid.model.torque_law_expression import Expression
from armid.robot.robot import Joint, Robot


@dataclass(frozen=True, slots=True)
class Law:
    """Law of the torque that one parameter causes.

    Attributes:
        symbol: Usual symbol of the parameter, for instance `FV`.
        joint: Index of the joint that gives the parameter its number, as in `FV_2`.
        unit: Unit of the parameter.
        coordinate: Coordinate of the law, as pairs of joint index j and weight w_j.
        expression: Expression in `q`, `dq`, `ddq` and `load` of the coordinate and, with hysteresis, `state`.
        nonnegative: True if negative values of the parameter are physically impossible.
        memory: Operator that computes the hysteresis state `state` of the coordinate; `None` without hysteresis.
    """

    symbol: str
    joint: int
    unit: str
    coordinate: Coordinate
    expression: Expression
    nonnegative: bool = False
    memory: Play | None = None


@runtime_checkable
class Term(Protocol):
    """Torque term: a frozen dataclass whose fields are its shapes, for instance widths or knots.

    A term may have three further members: `automatic`, its properties for the automatic selection of friction
    (`armid.model.terms.selection_candidates`); `describe`, a text with its shapes; and `smooths_sign = True` if its
    shape `width` only smooths a sign, which a simulation replaces by the exact sign.

    Attributes:
        name: Name of the torque term in a study.
    """

    name: ClassVar[str]

    def laws(self, robot: Robot) -> tuple[Law, ...]:
        """Laws of this term for all joints of an arm on which the term acts, joint by joint."""
        ...


@runtime_checkable
class DescribedTerm(Protocol):
    """Torque term with a description, because it has shapes or its name is not clear enough."""

    def describe(self, length: str) -> str:
        """Description of the term in words, with the values of its shapes, such as a Stribeck velocity.

        Args:
            length: Unit of the joint positions, `rad` or `m`.
        """
        ...


def listed(shapes: Iterable[float]) -> str:
    """Text that lists the shapes of a term, with three digits each."""
    return ", ".join(f"{shape:.3g}" for shape in shapes)


def smooths_sign(term: Term) -> bool:
    """Checks whether the shape `width` of a term only smooths a sign function."""
    return getattr(term, "smooths_sign", False)


def select_joints(robot: Robot, joints: Sequence[str] | None) -> tuple[int, ...]:
    """Indices of the joints with the given names, or of all joints if no names are given.

    Raises:
        RobotError: A joint is unknown.
    """
    if joints is None:
        return tuple(range(robot.n))
    return tuple(robot.joint_index(name) for name in joints)


def single_joint_laws(
    robot: Robot,
    joints: Sequence[str] | None,
    symbol: str,
    expression: Expression,
    *,
    units: tuple[str, str],
    nonnegative: bool,
    memory: Play | None = None,
) -> tuple[Law, ...]:
    """Creates laws with the same expression for several joints, one law for each joint.

    Args:
        robot: The arm.
        joints: Names of the joints; `None` for all.
        symbol: Symbol of the parameter.
        expression: Expression of the law.
        units: Units of the parameter for a revolute and for a prismatic joint.
        nonnegative: True if negative values of the parameter are physically impossible.
        memory: Operator that computes the hysteresis state of the position of the joint; `None` without hysteresis.
    """

    def unit(joint: Joint) -> str:
        return units[1] if joint.is_prismatic else units[0]

    return tuple(
        Law(symbol, j, unit(robot.joints[j]), ((j, 1.0),), expression, nonnegative, memory)
        for j in select_joints(robot, joints)
    )
