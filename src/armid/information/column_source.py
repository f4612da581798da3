"""Layout of a model for the stream: where each base parameter's column stands, and the terms' columns."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armid.kernel import ColumnLayout, Tree, make_layout
from armid.model.base_parameters import BaseParameters
from armid.model.dynamics import DynamicsModel
from armid.model.motion import Motion
from armid.values import Array

__all__ = ["ColumnSource", "column_source"]


@dataclass(frozen=True, eq=False, slots=True)
class ColumnSource:
    """Makes the kept columns of a model along a motion.

    Attributes:
        model: Arm and torque terms.
        tree: The arm's geometry.
        layout: Where each base parameter's column stands.
        names: Names of the base parameters.
    """

    model: DynamicsModel
    tree: Tree
    layout: ColumnLayout
    names: tuple[str, ...]

    def term_rows(self, motion: Motion) -> Array:
        """Kept rows of the terms' columns, shape (e, N)."""
        return self.model.term_columns(motion, self.layout.kept).values


def column_source(model: DynamicsModel, base: BaseParameters) -> ColumnSource:
    """The columns of a model's base parameters, joint by joint."""
    number = np.full(len(model.parameters), -1, dtype=np.int32)
    number[base.kept] = np.arange(base.count)
    joint = np.array([entry[0] for entry in model.entries], dtype=np.int32)
    parameter = np.array([entry[1] for entry in model.entries], dtype=np.int32)
    layout = make_layout(model.tree, number[model.inertial_columns], joint, number[parameter])
    return ColumnSource(model, model.tree, layout, base.names)
