"""Torque terms: laws, each stated once as an expression.

A law says τ = parameter · expression, where the expression may use position `q`, velocity `dq` and acceleration
`ddq` of one coordinate c = Σ w_j q_j, the torque `load` of the rigid bodies on it, and the `state` of the law's
memory. For most laws the coordinate is a single joint (w = 1). A law on a
combination of joints, such as the friction of a motor that drives two of them, acts on each with its weight:
τ_j = w_j · parameter · expression (virtual work). Columns, derivatives and formulas all follow from the law.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, Protocol, runtime_checkable

from armid.model.expression import Expression
from armid.model.hysteresis_memory import Coordinate, Play
from armid.robot.robot import Joint, Robot

__all__ = ["Law", "Term", "select_joints", "single_joint_laws"]


@dataclass(frozen=True, slots=True)
class Law:
    """One parameter and the torque it makes.

    Attributes:
        symbol: Symbol of the parameter as the field writes it, for instance `FV`.
        joint: Index of the joint whose number the parameter bears.
        unit: Unit of the parameter.
        coordinate: Pairs of joint index and weight w_j.
        expression: In `q`, `dq`, `ddq` and `load` of the coordinate, and `state` where there is a memory.
        nonnegative: Whether physics forbids negative values of the parameter.
        memory: What has to be remembered of the coordinate; its state is the symbol `state`.
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
    """A torque term: a frozen dataclass whose fields are its shapes.

    Attributes:
        name: Name in a study.
    """

    name: ClassVar[str]

    def laws(self, robot: Robot) -> tuple[Law, ...]:
        """The laws of this term on an arm, joint by joint."""
        ...


def select_joints(robot: Robot, joints: Sequence[str] | None) -> tuple[int, ...]:
    """Indices of the named joints; all where none are named.

    Raises:
        RobotError: An unknown joint.
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
    """The same law on each joint by itself.

    Args:
        robot: The arm.
        joints: Names of the joints; `None` for all.
        symbol: Symbol of the parameter.
        expression: The law.
        units: Unit of the parameter on a revolute and on a prismatic joint.
        nonnegative: Whether the parameter must not be negative.
        memory: What has to be remembered of the joint's position.
    """

    def unit(joint: Joint) -> str:
        return units[1] if joint.is_prismatic else units[0]

    return tuple(
        Law(symbol, j, unit(robot.joints[j]), ((j, 1.0),), expression, nonnegative, memory)
        for j in select_joints(robot, joints)
    )
