"""Source of the regressor columns of a model: layout for its base parameters, and columns of its torque terms."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armid.checked_array import Array
from armid.kernel import ColumnLayout, Tree, make_layout
from armid.model.base_parameters import BaseParameters
from armid.model.dynamics_model import DynamicsModel
from armid.model.motion import Motion
from armid.model.parameter_name import ParameterName


@dataclass(frozen=True, eq=False, slots=True)
class ColumnSource:
    """Source of the regressor columns of the base parameters of a model along a motion.

    Attributes:
        model: Arm and torque terms.
        tree: Geometry of the arm.
        layout: Layout of the columns of the base parameters.
        names: Names of the base parameters.
    """

    model: DynamicsModel
    tree: Tree
    layout: ColumnLayout
    names: tuple[ParameterName, ...]

    def term_rows(self, motion: Motion) -> Array:
        """Regressor columns of the torque terms that the layout contains, along a motion, shape (e, N).

        Each of the e rows is one column at the N samples of the motion.
        """
        return self.model.term_columns(motion, self.layout.kept).values


def column_source(model: DynamicsModel, base: BaseParameters) -> ColumnSource:
    """Creates the source that computes the regressor columns of a model's base parameters along any motion."""
    number = np.full(len(model.parameters), -1, dtype=np.int32)
    number[base.kept] = np.arange(base.count)
    joint = np.array([entry[0] for entry in model.entries], dtype=np.int32)
    parameter = np.array([entry[1] for entry in model.entries], dtype=np.int32)
    layout = make_layout(model.tree, number[model.inertial_columns], joint, number[parameter])
    return ColumnSource(model, model.tree, layout, base.names)


def torque_source(model: DynamicsModel) -> ColumnSource:
    """Creates the source of the measured torque of each joint, without regressor columns."""
    none = np.empty(0, dtype=np.int32)
    return ColumnSource(model, model.tree, make_layout(model.tree, none, none, none), ())
