"""Base parameters: what of a model the torques can show, and how the standard parameters group into it.

The rigid bodies are grouped by the geometry of the tree (`structure`); the columns of other terms, whose laws only
the terms know, are compared with them on random states, those of their memory included. All of it is then checked on
other random states.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from armid.errors import ModelError
from armid.model.dynamics import DynamicsModel
from armid.model.expression import functions, symbols
from armid.model.identifiable_structure import SPAN_TOLERANCE, echelon, parameter_units, structural_base
from armid.model.motion import Motion
from armid.notebook import Displayed, Summary
from armid.threads import one_blas_thread
from armid.values import Array, array

__all__ = ["BaseParameters", "find_base_parameters"]

TERM_FLOOR = 1e-9
"""Coefficients between unit columns found on random states: their rounding is 1e-16 times a condition number that
stays below 1e5 on arms, so that smaller ones are rounding."""

REGROUPING_TOLERANCE = 1e-8
"""Largest entry of Y - Y_base · regrouping over the largest of Y, inertial parameters in the arm's own unit of
length: ten times what the structure may neglect (`SPAN_TOLERANCE`). A wrong grouping is off by far more."""

RANK_TOLERANCE = 1e-11
"""Smallest over largest singular value of base columns of unit length that are independent: 1e-4 and more on real
geometry, 1e-9 where the structure has kept a direction just above its tolerance, 1e-15 where it is wrong."""

ZERO_COLUMN = 1e-13
"""Length of a column that is zero to rounding, beside the longest."""

RANDOM_BOUNDS = (np.pi, 2.0, 4.0)
"""Random states reach to these positions [rad or m], velocities and accelerations, so that gravity, centrifugal and
inertial torques are of one size."""

RANDOM_SPEEDS = (1e-4, 10.0)
"""For laws that turn, saturate or fall off along the velocity, as many states again have velocities spread
evenly over these decades [rad/s or m/s]: knots of ten and Stribeck velocities of a thousandth are then both seen."""

LINEAR = frozenset({"add", "mul", "sign", "abs"})
"""Functions without a scale of their own."""


@dataclass(frozen=True, eq=False, slots=True, repr=False)
class BaseParameters(Displayed):
    """Standard columns that stand for the base, and the regrouping: base = regrouping · standard.

    Y = Y[:, kept] · regrouping: column k of the regrouping says how the column of standard parameter k depends on
    the kept ones; row j says which standard parameters make up base parameter j.

    Attributes:
        standard_names: Names of the standard parameters, p of them.
        standard_units: Their units.
        kept: Positions of the kept parameters, ascending, shape (b,).
        regrouping: Shape (b, p).
        gravity: The acceleration of gravity that this holds for, in the base frame, shape (3,) [m/s²].
    """

    standard_names: tuple[str, ...]
    standard_units: tuple[str, ...]
    kept: NDArray[np.intp]
    regrouping: Array
    gravity: Array

    def __post_init__(self) -> None:
        kept = np.array(self.kept, dtype=np.intp)
        kept.setflags(write=False)
        object.__setattr__(self, "kept", kept)
        shape = (len(kept), len(self.standard_names))
        object.__setattr__(self, "regrouping", array(self.regrouping, shape, "regrouping"))
        object.__setattr__(self, "gravity", array(self.gravity, (3,), "gravity"))

    def summary(self) -> Summary:
        """Base parameters with what they stand for."""
        from armid.model.base_formulas import base_formulas  # which is about base parameters, too

        formulas = (each.partition(" = ")[2] for each in base_formulas(self))
        rows = tuple(zip(self.names, self.units, formulas, strict=True))
        title = f"{self.count} base parameters of {len(self.standard_names)}"
        return Summary(title, ("parameter", "unit", "stands for"), rows)

    @property
    def count(self) -> int:
        """Number of base parameters b."""
        return len(self.kept)

    @property
    def names(self) -> tuple[str, ...]:
        """Names as the field writes them: an R marks what stands for more than itself, as in `ZZR_1`."""
        return tuple(
            grouped_name(self.standard_names[k]) if np.count_nonzero(row) > 1 else self.standard_names[k]
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


def grouped_name(name: str) -> str:
    """`ZZR_1` for `ZZ_1`."""
    symbol, number = name.rsplit("_", 1)
    return f"{symbol}R_{number}"


@one_blas_thread
def find_base_parameters(model: DynamicsModel) -> BaseParameters:
    """Base parameters of a model under its robot's gravity, kept from base to tip, the earliest first.

    Raises:
        ModelError: The geometry and the torques on random states disagree.
    """
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
    """Columns (rows, p) on enough random states to tell `count` of them apart.

    The load, where a law asks for one and the model has none yet, is that of random bodies: whether columns depend on
    each other does not hang on its values.
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
    """Earliest independent columns (r,), and E (r, c) that makes all columns of them."""
    unit = columns / _norms(columns)
    kept, E = echelon(unit, SPAN_TOLERANCE)
    for j in np.setdiff1d(np.arange(len(E.T)), kept):
        # Among the few columns that take part the coefficients come out to rounding.
        part = np.flatnonzero(np.abs(E[:, j]) > TERM_FLOOR)
        E[:, j] = 0.0
        E[part, j] = np.linalg.lstsq(columns[:, kept[part]], columns[:, j])[0]
    return kept, E


def _verify(model: DynamicsModel, base: BaseParameters) -> None:
    """Compare with the torques on states that the base has not been made from.

    Raises:
        ModelError: Grouping or rank disagree.
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
            f"{_rank(columns)}; regrouping them leaves {error:.1e} of the regressor.",
            remedy="look for placements or axes that are off a special position by less than a thousandth, and "
            "round them; if there are none, this is a fault of armid.",
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
