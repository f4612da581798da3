"""Column layout of a model for the stream: the column of each base parameter, and the columns of the terms."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armid.kernel import ColumnLayout, Tree, make_layout
from armid.model.base_parameters import BaseParameters
from armid.model.dynamics import DynamicsModel
from armid.model.motion import Motion
from armid.model.parameter_name import ParameterName
from armid.values import Array


@dataclass(frozen=True, eq=False, slots=True)
class ColumnSource:
    """Source of a model's kept columns along a motion.

    Attributes:
        model: Arm and torque terms.
        tree: The arm's geometry.
        layout: Column of each base parameter.
        names: Names of the base parameters.
    """

    model: DynamicsModel
    tree: Tree
    layout: ColumnLayout
    names: tuple[ParameterName, ...]

    def term_rows(self, motion: Motion) -> Array:
        """Kept rows of the terms' columns, shape (e, N)."""
        return self.model.term_columns(motion, self.layout.kept).values


def column_source(model: DynamicsModel, base: BaseParameters) -> ColumnSource:
    """Source of the columns of a model's base parameters, joint by joint."""
    number = np.full(len(model.parameters), -1, dtype=np.int32)
    number[base.kept] = np.arange(base.count)
    joint = np.array([entry[0] for entry in model.entries], dtype=np.int32)
    parameter = np.array([entry[1] for entry in model.entries], dtype=np.int32)
    layout = make_layout(model.tree, number[model.inertial_columns], joint, number[parameter])
    return ColumnSource(model, model.tree, layout, base.names)
