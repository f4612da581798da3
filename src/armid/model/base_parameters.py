"""Base parameters of a model: the combinations of standard parameters that the torque depends on.

The parameters of rigid bodies are regrouped by the geometry of the tree (`identifiable_structure`). Dependences with
the columns of other terms are found numerically, on random states, hysteresis states included. The result is checked
on other random states.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from armid.errors import ModelError
from armid.model.dynamics import DynamicsModel
from armid.model.expression import functions, symbols
from armid.model.identifiable_structure import SPAN_TOLERANCE, echelon, parameter_units, structural_base
from armid.model.linear_combination import linear_combination
from armid.model.motion import Motion
from armid.model.parameter_name import ParameterName, parameter_names
from armid.model.terms.term import Term
from armid.notebook import Displayed, Summary
from armid.robot.robot import Robot
from armid.threads import one_blas_thread
from armid.values import Array, array

TERM_FLOOR = 1e-9
"""Coefficients between unit columns on random states that are smaller than this are rounding: 1e-16 times a condition
number, which stays below 1e5 on arms."""

REGROUPING_TOLERANCE = 1e-8
"""Largest entry of Y - Y_base · regrouping over the largest of Y, in the arm's own unit of length: ten times the
tolerance of the structure (`SPAN_TOLERANCE`). A wrong regrouping gives a far larger error."""

RANK_TOLERANCE = 1e-11
"""Smallest ratio of singular values of base columns of unit length that counts as full rank. The ratio is 1e-4 and
more on real geometry, 1e-9 where the structure kept a direction just above its tolerance, 1e-15 where it is wrong."""

ZERO_COLUMN = 1e-13
"""Length of a column, over that of the longest, below which it counts as zero."""

RANDOM_BOUNDS = (np.pi, 2.0, 4.0)
"""Bounds of positions [rad or m], velocities and accelerations of random states, with which gravity, centrifugal and
inertial torques have the same size."""

RANDOM_SPEEDS = (1e-4, 10.0)
"""Range of velocities [rad/s or m/s] of further random states, uniform in the logarithm, for laws that are nonlinear
in the velocity: it covers Stribeck velocities of a thousandth and knots of ten."""

LINEAR = frozenset({"add", "mul", "sign", "abs"})
"""Functions without a velocity scale."""


@dataclass(frozen=True, eq=False, slots=True, repr=False)
class BaseParameters(Displayed):
    """Kept standard columns and the regrouping matrix: base = regrouping · standard.

    Y = Y[:, kept] · regrouping: column k of the regrouping gives the column of standard parameter k by the kept ones;
    row j gives base parameter j by the standard parameters.

    Attributes:
        standard_names: Names of the p standard parameters.
        standard_units: Units of the standard parameters.
        kept: Positions of the kept parameters, ascending, shape (b,).
        regrouping: Regrouping matrix, shape (b, p).
        gravity: Acceleration of gravity in the base frame for which the regrouping holds, shape (3,) [m/s²].
    """

    standard_names: tuple[ParameterName, ...]
    standard_units: tuple[str, ...]
    kept: NDArray[np.intp]
    regrouping: Array
    gravity: Array

    def __post_init__(self) -> None:
        object.__setattr__(self, "standard_names", parameter_names(self.standard_names))
        kept = np.array(self.kept, dtype=np.intp)
        kept.setflags(write=False)
        object.__setattr__(self, "kept", kept)
        shape = (len(kept), len(self.standard_names))
        object.__setattr__(self, "regrouping", array(self.regrouping, shape, "regrouping"))
        object.__setattr__(self, "gravity", array(self.gravity, (3,), "gravity"))

    def summary(self) -> Summary:
        """Base parameters with their formulas."""
        sums = [
            linear_combination(row, self.standard_names, own)
            for own, row in zip(self.kept, self.regrouping, strict=True)
        ]
        rows = tuple(zip(self.names, self.units, sums, strict=True))
        title = f"{self.count} base parameters of {len(self.standard_names)}"
        return Summary(title, ("parameter", "unit", "stands for"), rows)

    @property
    def count(self) -> int:
        """Number of base parameters b."""
        return len(self.kept)

    @property
    def names(self) -> tuple[ParameterName, ...]:
        """Usual names: an R marks a parameter with others regrouped into it, as in `ZZR_1`."""
        return tuple(
            self.standard_names[k].regrouped() if np.count_nonzero(row) > 1 else self.standard_names[k]
            for k, row in zip(self.kept, self.regrouping, strict=True)
        )

    @property
    def units(self) -> tuple[str, ...]:
        """Units of the base parameters."""
        return tuple(self.standard_units[k] for k in self.kept)

    @property
    def zero_columns(self) -> NDArray[np.intp]:
        """Standard parameters without any effect on the torques."""
        return np.flatnonzero(~self.regrouping.any(axis=0))

    @property
    def removed(self) -> NDArray[np.intp]:
        """Standard parameters that are not kept, zero columns included."""
        return np.setdiff1d(np.arange(len(self.standard_names)), self.kept)

    def values_of(self, standard: ArrayLike) -> Array:
        """Base parameters (b,) of standard parameters (p,)."""
        return self.regrouping @ array(standard, (len(self.standard_names),), "standard parameters")


_recent: deque[tuple[Robot, tuple[Term, ...], BaseParameters]] = deque(maxlen=8)
"""Arm, terms and base parameters of the last models."""


def find_base_parameters(model: DynamicsModel) -> BaseParameters:
    """Base parameters of a model under its robot's gravity; of dependent columns the one nearest to the base is kept.

    Those of the last few models are remembered, by their arm and terms.

    Raises:
        ModelError: The geometry and the torques on random states disagree.
    """
    if model.load_parameters is not None:
        return _find(model)
    for robot, terms, base in tuple(_recent):
        if robot is model.robot and terms == model.terms:
            return base
    base = _find(model)
    _recent.append((model.robot, model.terms, base))
    return base


@one_blas_thread
def _find(model: DynamicsModel) -> BaseParameters:
    """Base parameters of a model that is not remembered."""
    p, inertial = len(model.parameters), model.inertial_columns
    terms = np.setdiff1d(np.arange(p), inertial)
    kept, regrouping = np.arange(p), np.eye(p)
    if len(inertial):
        rigid_kept, rigid = structural_base(model.tree)
        regrouping[np.ix_(inertial[rigid_kept], inertial)] = rigid
        kept = np.union1d(inertial[rigid_kept], terms)
        regrouping = regrouping[kept]
    if len(terms):
        columns = _columns(model, len(kept), seed=1)[:, kept]
        still_kept, dependence = _dependence(columns)
        kept, regrouping = kept[still_kept], dependence @ regrouping
    base = BaseParameters(
        tuple(parameter.name for parameter in model.parameters),
        tuple(parameter.unit for parameter in model.parameters),
        kept,
        regrouping,
        model.robot.gravity,
    )
    _verify(model, base)
    return base


def _columns(model: DynamicsModel, count: int, seed: int) -> Array:
    """Columns (rows, p) on enough random states to find the rank of `count` columns.

    Where a law needs the load and the model has none yet, random bodies give it: the dependence of columns does not
    depend on its values.
    """
    rng = np.random.default_rng(seed)
    shape = (10 + 3 * count // model.n, model.n)
    q, dq, ddq = (bound * rng.uniform(-1.0, 1.0, shape) for bound in RANDOM_BOUNDS)
    if any("dq" in symbols(law.expression) and functions(law.expression) - LINEAR for _, law in model.laws):
        low, high = np.log(RANDOM_SPEEDS)
        spread = np.exp(rng.uniform(low, high, shape)) * rng.choice([-1.0, 1.0], shape)
        more = [bound * rng.uniform(-1.0, 1.0, shape) for bound in RANDOM_BOUNDS]
        q, dq, ddq = np.vstack([q, more[0]]), np.vstack([dq, spread]), np.vstack([ddq, more[2]])
    motion = Motion.of_states(q, dq, ddq)
    if model.nodes:
        drives = np.column_stack([sum(w * q[:, j] for j, w in node.coordinate) for node in model.nodes])
        widths = np.array([node.memory.width for node in model.nodes])
        motion = motion.with_memory(drives - widths * rng.uniform(-1.0, 1.0, drives.shape))
    if model.load_parameters is None and any("load" in symbols(law.expression) for _, law in model.laws):
        model = replace(model, load_parameters=rng.uniform(0.5, 1.5, (model.n, 10)))
    return model.regressor(motion).reshape(-1, len(model.parameters))


def _dependence(columns: Array) -> tuple[NDArray[np.intp], Array]:
    """Earliest independent columns (r,), and E (r, c), which gives all columns by them."""
    unit = columns / _norms(columns)
    kept, E = echelon(unit, SPAN_TOLERANCE)
    for j in np.setdiff1d(np.arange(len(E.T)), kept):
        # Solving for the nonzero coefficients alone gives them to rounding accuracy.
        part = np.flatnonzero(np.abs(E[:, j]) > TERM_FLOOR)
        E[:, j] = 0.0
        E[part, j] = np.linalg.lstsq(columns[:, kept[part]], columns[:, j])[0]
    return kept, E


def _verify(model: DynamicsModel, base: BaseParameters) -> None:
    """Check the regrouping by torques on states that it was not computed from.

    Raises:
        ModelError: The regrouping or the rank disagrees.
    """
    columns = _columns(model, base.count, seed=2)
    scale = np.ones(columns.shape[1])
    if len(model.inertial_columns):
        scale[model.inertial_columns] = parameter_units(model.tree)
    own = columns[:, base.kept]
    error = np.abs((columns - own @ base.regrouping) * scale).max(initial=0.0)
    error /= max(np.abs(columns * scale).max(initial=0.0), np.finfo(float).tiny)
    if error > REGROUPING_TOLERANCE or _rank(own) < base.count:
        raise ModelError(
            f"{model.robot.name}: the geometry gives {base.count} base parameters, the torques on random states "
            f"{_rank(columns)}; the relative error of the regrouped regressor is {error:.1e}.",
            remedy="look for placements or axes that differ from a special position by less than a thousandth, and "
            "round them; if there are none, this is a bug of armid.",
        )


def _rank(columns: Array) -> int:
    """Number of independent columns, each scaled to unit length."""
    if not columns.size:
        return 0
    sizes = np.linalg.svd(columns / _norms(columns), compute_uv=False)
    return int(np.count_nonzero(sizes > RANK_TOLERANCE * sizes[0]))


def _norms(columns: Array) -> Array:
    """Length of each column; 1 where it is zero to rounding."""
    norms = np.linalg.norm(columns, axis=0)
    return np.where(norms > ZERO_COLUMN * norms.max(initial=0.0), norms, 1.0)
