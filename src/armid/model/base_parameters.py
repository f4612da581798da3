"""Base parameters of a model: the combinations of standard parameters that the torque depends on.

The parameters of rigid bodies are regrouped from the geometry of the tree (`structural_identifiability`). Dependences
on the columns of other torque terms are found numerically, at random motion and hysteresis states. The result is
checked at other random states.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from armid.checked_array import Array, array
from armid.errors import ModelError
from armid.model.dynamics_model import DynamicsModel
from armid.model.linear_combination_text import linear_combination
from armid.model.motion import Motion
from armid.model.parameter_name import ParameterName, parameter_names
from armid.model.structural_identifiability import SPAN_TOLERANCE, echelon, parameter_units, structural_base
from armid.model.terms.term import Term
from armid.model.torque_law_expression import functions, symbols
from armid.notebook_display import Displayed, Summary
from armid.robot.robot import Robot
from armid.threads import one_blas_thread

TERM_FLOOR = 1e-9
"""Absolute value below which a coefficient that expresses one column by others, all scaled to unit length, is a
rounding error. Rounding errors are 1e-16 times a condition number, which is below 1e5 for arms."""

REGROUPING_TOLERANCE = 1e-8
"""Largest allowed entry of Y - Y_base · regrouping, divided by the largest entry of Y, with lengths in units of the
arm size. It is ten times `SPAN_TOLERANCE`, the tolerance in the analysis of the geometry. A wrong regrouping gives a
far larger error."""

RANK_TOLERANCE = 1e-11
"""Smallest ratio of the smallest to the largest singular value of the base columns, scaled to unit length, that
counts as full rank. The ratio is 1e-4 or more for real geometry, 1e-9 if the analysis of the geometry has kept a
direction just above its tolerance, and 1e-15 if the base parameters are wrong."""

ZERO_COLUMN = 1e-13
"""Ratio of the length of a column to the length of the longest column below which the column counts as zero."""

RANDOM_BOUNDS = (np.pi, 2.0, 4.0)
"""Bounds of the positions [rad or m], velocities [rad/s or m/s] and accelerations [rad/s² or m/s²] of random states.
With them, gravity, centrifugal and inertial torques have a similar size."""

RANDOM_SPEEDS = (1e-4, 10.0)
"""Range of the speeds [rad/s or m/s] of further random states, distributed uniformly in the logarithm. These states
are used for laws that are nonlinear in the velocity. The range includes Stribeck velocities of 0.001 and knots of
10."""

LINEAR = frozenset({"add", "mul", "sign", "abs"})
"""Functions in expressions that have no characteristic velocity, in contrast to tanh or exp."""


@dataclass(frozen=True, eq=False, slots=True, repr=False)
class BaseParameters(Displayed):
    """Base parameters: kept columns and regrouping matrix, with base = regrouping · standard.

    The regressor is Y = Y[:, kept] · regrouping. Column k of the regrouping matrix contains the coefficients of the
    kept columns that give the column of standard parameter k. Row j contains the coefficients of the standard
    parameters that give base parameter j.

    Attributes:
        standard_names: Names of the p standard parameters.
        standard_units: Units of the standard parameters.
        kept: Indices of the standard parameters whose columns are kept, ascending, shape (b,).
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
        count = len(self.standard_names)
        ascending = kept.ndim == 1 and bool((np.diff(kept, prepend=-1, append=count) > 0).all())
        if len(self.standard_units) != count or not ascending:
            raise ModelError(
                f"{count} standard parameters have {len(self.standard_units)} units and the kept columns {kept}.",
                remedy="give a unit for each standard parameter, and ascending indices of kept columns.",
            )
        shape = (len(kept), len(self.standard_names))
        object.__setattr__(self, "regrouping", array(self.regrouping, shape, "regrouping"))
        object.__setattr__(self, "gravity", array(self.gravity, (3,), "gravity"))

    def summary(self) -> Summary:
        """Table of the base parameters with their formulas."""
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
        """Usual names; the letter R, as in `ZZR_1`, marks a parameter to which others have been added."""
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
        """Indices of the standard parameters that have no effect on the torque."""
        return np.flatnonzero(~self.regrouping.any(axis=0))

    @property
    def removed(self) -> NDArray[np.intp]:
        """Indices of the standard parameters that are not kept, including those of zero columns."""
        return np.delete(np.arange(len(self.standard_names)), self.kept)

    def values_of(self, standard: ArrayLike) -> Array:
        """Values of the base parameters, shape (b,), for values of the standard parameters, shape (p,)."""
        return self.regrouping @ array(standard, (len(self.standard_names),), "standard parameters")


_recent: deque[tuple[Robot, tuple[Term, ...], BaseParameters]] = deque(maxlen=8)
"""Cache: arm, terms and base parameters of the models whose base parameters were found last."""


def find_base_parameters(model: DynamicsModel) -> BaseParameters:
    """Finds the base parameters of a model with the gravity of its robot.

    If columns depend on each other, the columns of the links nearest to the base of the arm are kept. Results are
    cached for the last few pairs of arm and terms.

    Raises:
        ModelError: The geometry and the torques at random states give different results.
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
    """Finds the base parameters of a model without use of the cache."""
    p, inertial = len(model.parameters), model.inertial_columns
    terms = np.delete(np.arange(p), inertial)
    kept, regrouping = np.arange(p), np.eye(p)
    if len(inertial):
        rigid_kept, rigid = structural_base(model.tree)
        regrouping[np.ix_(inertial[rigid_kept], inertial)] = rigid
        kept = np.sort(np.concatenate([inertial[rigid_kept], terms]))
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
    """Regressor (rows, p) at random states, with enough rows to determine the rank of `count` columns.

    If a law depends on the load and the model has no load parameters yet, random load parameters are used, because
    their values do not affect the dependence of the columns.
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
    """Indices `kept` (r,) of the first independent columns, and E (r, c) with columns = columns[:, kept] · E."""
    unit = columns / _norms(columns)
    kept, E = echelon(unit, SPAN_TOLERANCE)
    for j in np.delete(np.arange(len(E.T)), kept):
        # Solving for the nonzero coefficients alone gives them to rounding accuracy.
        part = np.flatnonzero(np.abs(E[:, j]) > TERM_FLOOR)
        E[:, j] = 0.0
        E[part, j] = np.linalg.lstsq(columns[:, kept[part]], columns[:, j])[0]
    return kept, E


def _verify(model: DynamicsModel, base: BaseParameters) -> None:
    """Checks the regrouping with torques at random states that were not used to compute it.

    Raises:
        ModelError: The regrouping or the rank is wrong at these states.
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
            f"{model.robot.name}: the geometry gives {base.count} base parameters, but the torques at random states "
            f"give {_rank(columns)}; the relative error of the regrouped regressor is {error:.1e}.",
            remedy="look in the description for placements or axes that differ by less than a thousandth from a "
            "parallel or perpendicular position, and round them; if there are none, this is a bug of armid.",
        )


def _rank(columns: Array) -> int:
    """Number of independent columns, after scaling of each column to unit length."""
    if not columns.size:
        return 0
    sizes = np.linalg.svd(columns / _norms(columns), compute_uv=False)
    return int(np.count_nonzero(sizes > RANK_TOLERANCE * sizes[0]))


def _norms(columns: Array) -> Array:
    """Length of each column, or 1 if the column is zero except for rounding."""
    norms = np.linalg.norm(columns, axis=0)
    return np.where(norms > ZERO_COLUMN * norms.max(initial=0.0), norms, 1.0)
