"""Compiled kernel, its NumPy twin, and the choice between them.

The twin (module `reference`) is a short NumPy implementation that defines the result of every function. The compiled
kernel has one build for each instruction set; by default the fastest build that the machine supports is used. The
environment variable `ARMID_KERNEL` chooses another build: `avx512`, `avx2`, `baseline` or `numpy` (the twin).
`in_use()` returns the name of the build in use.
"""

from armid.kernel.dispatch import (
    columns,
    coriolis_matrix,
    decimate,
    factor,
    factor_columns,
    gravity_torque,
    in_use,
    instruction_sets,
    inverse_dynamics,
    mass_matrix,
    play,
    potential_energy,
    regressor,
    unpack_factors,
)
from armid.kernel.information_gradient import columns_adjoint, information, information_adjoint
from armid.kernel.joint_column_layout import ColumnLayout, make_layout
from armid.kernel.reweighted_solver import reweighted_least_squares
from armid.kernel.rollout import roll_out, roll_out_sensitivities
from armid.kernel.servo_joints import LawPrograms, RollOutParameters, ServoJoints
from armid.kernel.tree import Tree

__all__ = [
    "ColumnLayout",
    "LawPrograms",
    "RollOutParameters",
    "ServoJoints",
    "Tree",
    "columns",
    "columns_adjoint",
    "coriolis_matrix",
    "decimate",
    "factor",
    "factor_columns",
    "gravity_torque",
    "in_use",
    "information",
    "information_adjoint",
    "instruction_sets",
    "inverse_dynamics",
    "make_layout",
    "mass_matrix",
    "play",
    "potential_energy",
    "regressor",
    "reweighted_least_squares",
    "roll_out",
    "roll_out_sensitivities",
    "unpack_factors",
]
