"""Square-root information: triangular factors of the rows of recordings, from which all estimates are computed.

A row of the regressor depends only on the links that its joint carries. Therefore each joint j has its own small
factor R_j. If X_j contains the columns and the torque of the joint in a block of rows, R_jᵀ R_j = X_jᵀ X_j. These
factors are sufficient for every least-squares estimate with one noise level for each joint; the recording is not read
again. Blocks stay separate, so that the same factors can be used for covariances under correlated noise,
cross-validation and bootstrap.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from armid.checked_array import Array, array
from armid.errors import ArmidError
from armid.kernel import factor_columns
from armid.model.parameter_name import ParameterName, parameter_names
from armid.notebook_display import Displayed, Summary, plural
from armid.text_stored_value import TextValue


@dataclass(frozen=True, slots=True)
class FactorOrigin(TextValue):
    """Kernel and method by which factors were computed, for instance `native qr`.

    Attributes:
        kernel: `native` or `numpy`.
        method: Method of the factorisation.
    """

    kernel: str = ""
    method: str = ""

    def __str__(self) -> str:
        return f"{self.kernel} {self.method}".strip()

    @classmethod
    def read(cls, text: str) -> FactorOrigin:
        """Restores the origin of factors from its text, for instance `native qr`."""
        kernel, _, method = text.partition(" ")
        return cls(kernel, method)


@dataclass(frozen=True, eq=False, slots=True)
class JointFactors:
    """Triangular factors of the rows of one joint, one factor for each block.

    Attributes:
        parameters: Indices of the base parameters that the torque of the joint depends on, shape (k,).
        R: Upper triangular factors, shape (blocks, k + 1, k + 1); the last column belongs to the torque.
    """

    parameters: NDArray[np.int32]
    R: Array

    def __post_init__(self) -> None:
        parameters = np.array(self.parameters, dtype=np.int32)
        parameters.setflags(write=False)
        width = len(parameters) + 1
        object.__setattr__(self, "parameters", parameters)
        object.__setattr__(self, "R", array(self.R, (None, width, width), "R"))


@dataclass(frozen=True, eq=False, slots=True, repr=False)
class Information(Displayed):
    """Information: triangular factors of all joints and blocks of recordings.

    Attributes:
        names: Names of the base parameters, b of them.
        joints: Factors of each joint, n of them.
        rows: Number of rows in use of each block and joint, shape (blocks, n).
        run: Index of the contiguous run to which each block belongs, counted through all recordings, shape (blocks,).
        recording: Index of the recording to which each block belongs, shape (blocks,).
        scale_deviation: Relative standard deviation of the scale of the torque of each joint, for instance of the
            drive gain, shape (n,).
        made_by: Kernel and method by which the factors were computed.
    """

    names: tuple[ParameterName, ...]
    joints: tuple[JointFactors, ...]
    rows: NDArray[np.int64]
    run: NDArray[np.int64]
    recording: NDArray[np.int64]
    scale_deviation: Array = field(default_factory=lambda: np.zeros(0))
    made_by: FactorOrigin = field(default_factory=FactorOrigin)

    def __post_init__(self) -> None:
        object.__setattr__(self, "names", parameter_names(self.names))
        object.__setattr__(self, "joints", tuple(self.joints))
        scale = self.scale_deviation if np.size(self.scale_deviation) else np.zeros(len(self.joints))
        object.__setattr__(self, "scale_deviation", array(scale, (len(self.joints),), "scale_deviation"))
        blocks = len(self.run)
        for name, shape in (("rows", (blocks, len(self.joints))), ("run", (blocks,)), ("recording", (blocks,))):
            value = np.array(getattr(self, name), dtype=np.int64)
            if value.shape != shape:
                raise ArmidError(f"The field {name!r} of Information must have shape {shape}; found {value.shape}.")
            value.setflags(write=False)
            object.__setattr__(self, name, value)
        if any(len(joint.R) != blocks for joint in self.joints):
            raise ArmidError("In Information, every joint must have one factor for each block.")

    def summary(self) -> Summary:
        """Table of the numbers of rows and parameters of each joint."""
        rows = tuple(
            (str(j + 1), str(int(self.rows[:, j].sum())), str(len(joint.parameters)))
            for j, joint in enumerate(self.joints)
        )
        title = f"{self.count} base parameters, {plural(self.blocks, 'block')} of rows"
        return Summary(title, ("joint", "rows", "parameters"), rows, str(self.made_by))

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.joints)

    @property
    def blocks(self) -> int:
        """Number of blocks."""
        return len(self.run)

    @property
    def count(self) -> int:
        """Number of base parameters b."""
        return len(self.names)


def merge(parts: Sequence[Information]) -> Information:
    """Combines information about the same base parameters; the blocks are in the order of the parts.

    Raises:
        ArmidError: There are no parts, or the parts have different base parameters.
    """
    if not parts:
        raise ArmidError("There is no information to merge.", remedy="give at least one Information.")
    first = parts[0]
    if len(parts) == 1:
        return first
    for part in parts[1:]:
        alike = part.names == first.names and all(
            np.array_equal(a.parameters, b.parameters) for a, b in zip(part.joints, first.joints, strict=True)
        )
        if not alike:
            raise ArmidError(
                "Only information about the same base parameters can be merged.",
                remedy="compute all parts with the same robot and the same torque terms.",
            )
    origins = list(dict.fromkeys(part.made_by for part in parts))
    joints = tuple(
        JointFactors(joint.parameters, np.concatenate([part.joints[j].R for part in parts]))
        for j, joint in enumerate(first.joints)
    )
    return replace(
        first,
        joints=joints,
        rows=np.concatenate([part.rows for part in parts]),
        run=np.concatenate([part.run for part in parts]),
        recording=np.concatenate([part.recording for part in parts]),
        scale_deviation=np.max([part.scale_deviation for part in parts], axis=0),
        made_by=FactorOrigin(origins[0].kernel, ", ".join([origins[0].method, *map(str, origins[1:])])),
    )


def select(information: Information, blocks: NDArray[np.integer] | NDArray[np.bool_]) -> Information:
    """Information of selected blocks, given by indices or a mask; an index may occur twice, as in a bootstrap."""
    joints = tuple(JointFactors(joint.parameters, joint.R[blocks]) for joint in information.joints)
    return replace(
        information,
        joints=joints,
        rows=information.rows[blocks],
        run=information.run[blocks],
        recording=information.recording[blocks],
    )


def restrict(information: Information, kept: NDArray[np.intp]) -> Information:
    """Information of a model that has only the base parameters `kept`; the columns of the others are removed.

    Args:
        information: Information of any number of blocks.
        kept: Indices of the base parameters that are kept, ascending.
    """
    number = np.full(information.count, -1, dtype=np.int32)
    number[kept] = np.arange(len(kept))
    joints: list[JointFactors] = []
    for joint in information.joints:
        at = np.flatnonzero(number[joint.parameters] >= 0)
        R = joint.R[:, :, np.append(at, joint.R.shape[2] - 1)]
        factors = [factor_columns(np.ascontiguousarray(each.T))[0] for each in R]
        joints.append(JointFactors(number[joint.parameters[at]], np.stack(factors)))
    return replace(information, names=tuple(information.names[k] for k in kept), joints=tuple(joints))


def total(information: Information) -> Information:
    """Merges all blocks into one: for each joint, the triangular factor of its stacked factors."""
    if information.blocks == 1:
        return information
    joints = tuple(
        JointFactors(joint.parameters, factor_columns(joint.R.reshape(-1, joint.R.shape[2]).T))
        for joint in information.joints
    )
    return replace(
        information,
        joints=joints,
        rows=information.rows.sum(axis=0, keepdims=True),
        run=np.zeros(1),
        recording=np.zeros(1),
    )


def stack(information: Information, weights: Array | None = None) -> tuple[Array, Array]:
    """Matrix and right-hand side of the equivalent least-squares problem.

    Args:
        information: Information of any number of blocks.
        weights: Factor by which the rows of each joint are multiplied, shape (n,); one if not given.

    Returns:
        A, shape (rows, b), and y, shape (rows,). The estimate is the vector π of base parameters that minimises the
        norm of A π - y.
    """
    parts: list[Array] = []
    sides: list[Array] = []
    for j, joint in enumerate(information.joints):
        weight = 1.0 if weights is None else float(weights[j])
        R = joint.R.reshape(-1, joint.R.shape[2])
        rows = np.zeros((len(R), information.count))
        rows[:, joint.parameters] = weight * R[:, :-1]
        parts.append(rows)
        sides.append(weight * R[:, -1])
    return np.concatenate(parts), np.concatenate(sides)
