"""Dynamics model: an arm with torque terms, whose torque is linear in the standard parameters.

    τ = Y(q, q̇, q̈) θ = M(q) q̈ + C(q, q̇) q̇ + g(q) + friction

Parameters are ordered link by link: the ten inertial parameters in the order of Pinocchio, then the parameters of the
other torque terms. Laws with hysteresis depend on the earlier motion. The method `remember` computes their states
along a contiguous run at the full sampling rate.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from armid import kernel
from armid.checked_array import Array, array
from armid.errors import ModelError
from armid.kernel.tree import Tree
from armid.model.hysteresis_memory import Coordinate, MemoryNode
from armid.model.motion import Motion
from armid.model.parameter_name import ParameterName
from armid.model.terms import DEFAULT_TERMS, Law, RigidBody, Term
from armid.model.terms.equal_columns import EqualColumns, equal_columns
from armid.model.terms.filtered_steps import filtered_steps
from armid.model.terms.rigid_body import RIGID_BODY_SYMBOLS, rigid_body_units
from armid.model.torque_law_expression import Expression, derivative, evaluate, number, symbols, text
from armid.notebook_display import Displayed, Summary, plural
from armid.robot.missing_inertia import links_without_inertia
from armid.robot.robot import Robot


@dataclass(frozen=True, slots=True)
class Parameter:
    """Standard parameter.

    Attributes:
        symbol: Usual symbol, for instance `MX` or `FV`.
        number: Number of the link or joint, counted from 1.
        unit: Unit of the parameter (SI).
        kind: Name of the torque term.
        joint: Name of the joint.
        nonnegative: True if negative values are physically impossible.
    """

    symbol: str
    number: int
    unit: str
    kind: str
    joint: str
    nonnegative: bool = False

    @property
    def name(self) -> ParameterName:
        """Name of the parameter, made of symbol and number, for instance `MX_2`."""
        return ParameterName(self.symbol, self.number)


@dataclass(frozen=True, eq=False, slots=True)
class TermColumns:
    """Regressor columns of all torque terms except rigid bodies; each belongs to the row of one joint.

    Attributes:
        joint: Index of the joint (row of the regressor) of each column, shape (e,).
        parameter: Index of the standard parameter of each column, shape (e,). A parameter of a coupling occurs once
            for each of its joints.
        values: Entries of the columns, shape (e, N).
    """

    joint: NDArray[np.int32]
    parameter: NDArray[np.int32]
    values: Array


@dataclass(frozen=True, eq=False, repr=False)
class DynamicsModel(Displayed):
    """Arm with its torque terms.

    Attributes:
        robot: The arm.
        terms: Torque terms; if not given, rigid bodies, viscous and Coulomb friction, and offset. A term may occur
            several times if its parameters differ, for instance with different shapes on different joints.
        load_parameters: Inertial parameters of the links, shape (n, 10), from an earlier estimate, or other inertial
            parameters that give the same torque. In a law, the symbol `load` is the torque that is computed with
            them; it is never a measured torque. `None` if no such parameters are known.
    """

    robot: Robot
    terms: tuple[Term, ...] = DEFAULT_TERMS
    load_parameters: Array | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "terms", tuple(self.terms))
        if self.load_parameters is not None:
            given = array(self.load_parameters, (self.n, 10), "load_parameters")
            object.__setattr__(self, "load_parameters", given)
        if not self.terms:
            raise ModelError(
                "A model needs at least one torque term.", remedy="give at least one term, for instance RigidBody()."
            )
        names = [p.name for p in self.parameters]
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise ModelError(
                f"The same parameters belong to two torque terms: {', '.join(twice)}.",
                remedy="give each term only once, or restrict the terms to different joints.",
            )

    def summary(self) -> Summary:
        """Table of the torque terms with their numbers of parameters and their laws."""
        counts = Counter(parameter.kind for parameter in self.parameters)
        laws = {name: f"{law.symbol} · {text(law.expression)}" for name, law in reversed(self.laws)}
        rows = tuple((name, str(count), laws.get(name, "links as rigid bodies")) for name, count in counts.items())
        title = f"{self.robot.name}: {plural(len(self.parameters), 'parameter')} of {plural(self.n, 'joint')}"
        return Summary(title, ("term", "parameters", "law of the first joint"), rows)

    @property
    def n(self) -> int:
        """Number of joints."""
        return self.robot.n

    @cached_property
    def tree(self) -> Tree:
        """Geometry of the arm as the `Tree` that the functions of `armid.kernel` take."""
        return self.robot.tree

    @cached_property
    def has_rigid_bodies(self) -> bool:
        """True if the inertial parameters of the links are among the parameters."""
        return any(isinstance(term, RigidBody) for term in self.terms)

    @cached_property
    def laws(self) -> tuple[tuple[str, Law], ...]:
        """Pairs of the name of a torque term and one of its laws, ordered by joint, then by term."""
        laws = [(term.name, law) for term in self.terms for law in term.laws(self.robot)]
        return tuple(sorted(laws, key=lambda named: named[1].joint))

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """Standard parameters, p of them, ordered link by link."""
        result: list[Parameter] = []
        for i, joint in enumerate(self.robot.joints):
            if self.has_rigid_bodies:
                bodies = zip(RIGID_BODY_SYMBOLS, rigid_body_units(), strict=True)
                result += [Parameter(s, i + 1, unit, RigidBody.name, joint.name) for s, unit in bodies]
            result += [
                Parameter(law.symbol, i + 1, law.unit, kind, joint.name, law.nonnegative)
                for kind, law in self.laws
                if law.joint == i
            ]
        return tuple(result)

    @cached_property
    def inertial_columns(self) -> NDArray[np.intp]:
        """Indices in `parameters` of the inertial parameters, shape (10 n,); (0,) without rigid bodies."""
        return np.flatnonzero([p.kind == RigidBody.name for p in self.parameters])

    @cached_property
    def law_columns(self) -> NDArray[np.intp]:
        """Index in `parameters` of the parameter of each law, in the order of `laws`."""
        return np.flatnonzero([p.kind != RigidBody.name for p in self.parameters])

    @cached_property
    def entries(self) -> tuple[tuple[int, int, Law, float], ...]:
        """Joint index, parameter index, law and weight of every column of the torque terms except rigid bodies."""
        return tuple(
            (j, int(column), law, weight)
            for column, (_, law) in zip(self.law_columns, self.laws, strict=True)
            for j, weight in law.coordinate
        )

    @cached_property
    def nodes(self) -> tuple[MemoryNode, ...]:
        """Nodes of the hysteresis states of the laws, m of them, in the order of the laws."""
        found: dict[tuple[Coordinate, object], MemoryNode] = {}
        for name, law in self.laws:
            if law.memory is not None:
                found.setdefault((law.coordinate, law.memory), MemoryNode(law.coordinate, law.memory, name))
        return tuple(found.values())

    def remember(self, motion: Motion) -> Motion:
        """Adds the hysteresis states of the model to a motion, one contiguous run at the full sampling rate."""
        return self.remembered(motion)[0] if self.nodes else motion

    def remembered(self, motion: Motion) -> tuple[Motion, NDArray[np.int64]]:
        """Motion with its hysteresis states, and the first sample from which each state is known, shape (m,).

        A state is known from the first sample at which it no longer depends on its unknown initial value. If it
        depends on this value at all samples, the index is N. At earlier samples, the state is the middle of its
        possible range.
        """
        self._check(motion)
        states, known = kernel.play(*self._driven(motion.q), np.array([node.memory.width for node in self.nodes]))
        return motion.with_memory(states), known

    def _driven(self, q: Array) -> tuple[Array, NDArray[np.int32]]:
        """Coordinates that drive the nodes, shape (N, k), and the index of the coordinate of each node, shape (m,).

        The first n coordinates are the joint positions, the others are combinations of joint positions.
        """
        columns = {((j, 1.0),): j for j in range(self.n)}
        combined = [node.coordinate for node in self.nodes if node.coordinate not in columns]
        columns |= {coordinate: self.n + k for k, coordinate in enumerate(dict.fromkeys(combined))}
        more = [sum(w * q[:, j] for j, w in coordinate) for coordinate in dict.fromkeys(combined)]
        follows = np.array([columns[node.coordinate] for node in self.nodes], dtype=np.int32)
        return np.column_stack([q, *more]) if more else q, follows

    def term_columns(self, motion: Motion, kept: NDArray[np.integer] | None = None) -> TermColumns:
        """Columns of all torque terms except rigid bodies along a motion, or of those with the indices `kept`.

        Raises:
            ModelError: A law has hysteresis, but the motion has no hysteresis states; or a law depends on the load,
                but the model has no load parameters.
        """
        entries = [self.entries[e] for e in (range(len(self.entries)) if kept is None else kept)]
        row_of = np.full(len(self.entries), -1, dtype=np.intp)
        row_of[slice(None) if kept is None else kept] = np.arange(len(entries))
        values = np.empty((len(entries), motion.samples))
        groups = [(group, rows) for group in self._groups if ((rows := row_of[group.entries]) >= 0).any()]
        of_joints = self._of_joints(motion, {name for group, _ in groups for name in group.symbols})
        signs = None if motion.sign_deviation is None else motion.sign_deviation.T
        for group, rows in groups:
            if group.law is not None:  # its steps do not pass the filter of a reduced rate
                values[rows[rows >= 0]] = evaluate(group.expression, self._environment(group.law, of_joints))
                continue
            joints = group.joints[rows >= 0]
            environment = {name: of_joints[name][joints] for name in group.symbols if name in of_joints}
            values[rows[rows >= 0]] = evaluate(group.expression, environment)
            if signs is not None and "dq" in environment:
                values[rows[rows >= 0]] += filtered_steps(group.expression, environment, signs[joints])
        for row, (_, _, _, weight) in zip(values, entries, strict=True):
            if weight != 1.0:
                row *= weight
        joint = np.array([e[0] for e in entries], dtype=np.int32)
        parameter = np.array([e[1] for e in entries], dtype=np.int32)
        return TermColumns(joint, parameter, values)

    @cached_property
    def _groups(self) -> tuple[EqualColumns, ...]:
        """Columns whose values are computed together."""
        return equal_columns([(j, law) for j, _, law, _ in self.entries])

    def _of_joints(self, motion: Motion, names: set[str]) -> dict[str, Array]:
        """Values of the symbols `names`: `state` for each node, shape (m, N), all others for each joint, (n, N)."""
        found = {"q": motion.q, "dq": motion.dq, "ddq": motion.ddq}
        if "load" in names:
            found["load"] = self._load(motion)
        if "state" in names:
            found["state"] = self._states(motion)
        return {name: np.ascontiguousarray(x.T) for name, x in found.items() if name in names}

    def _load(self, motion: Motion) -> Array:
        """Torque (N, n) of the rigid bodies with the parameters `load_parameters`."""
        if self.load_parameters is None:
            term = next(name for name, law in self.laws if "load" in symbols(law.expression))
            raise ModelError(
                f"The term {term!r} depends on the load of the joints, but the model has no inertial parameters for "
                "it.",
                remedy=f"first identify without {term!r}, then pass the inertial parameters of that estimate as "
                "load_parameters.",
            )
        return kernel.inverse_dynamics(self.tree, self.load_parameters, motion.q, motion.dq, motion.ddq)

    def _states(self, motion: Motion) -> Array:
        """Hysteresis states (N, m) of a motion, after a check that they exist."""
        if motion.memory is None or motion.memory.shape[1] != len(self.nodes):
            found = "none" if motion.memory is None else f"{motion.memory.shape[1]}"
            raise ModelError(
                f"The term {self.nodes[0].term!r} needs a motion with {len(self.nodes)} hysteresis states; the given "
                f"motion has {found}.",
                remedy="first add the states with `DynamicsModel.remember` to the whole contiguous run.",
            )
        return motion.memory

    def _environment(self, law: Law, of_joints: dict[str, Array]) -> dict[str, Array]:
        """Values of the symbols in a law, (N,) each: position, velocity, … of its coordinate, hysteresis state."""

        def combined(x: Array) -> Array:
            parts = [x[j] if w == 1.0 else w * x[j] for j, w in law.coordinate]
            return parts[0] if len(parts) == 1 else np.sum(parts, axis=0)

        names = symbols(law.expression)
        values = {name: combined(of_joints[name]) for name in names if name in of_joints and name != "state"}
        if "state" in names and "state" in of_joints:
            values["state"] = of_joints["state"][self._node_of[law.coordinate, law.memory]]
        return values

    @cached_property
    def _node_of(self) -> dict[tuple[Coordinate, object], int]:
        return {(node.coordinate, node.memory): k for k, node in enumerate(self.nodes)}

    def regressor(self, motion: Motion) -> Array:
        """Regressor Y with τ = Y θ, shape (N, n, p).

        A motion without hysteresis states is taken as one contiguous run.
        """
        motion = self._prepared(motion)
        Y = np.zeros((motion.samples, self.n, len(self.parameters)))
        if self.has_rigid_bodies:
            Y[:, :, self.inertial_columns] = kernel.regressor(self.tree, motion.q, motion.dq, motion.ddq)
        columns = self.term_columns(motion)
        for joint, parameter, values in zip(columns.joint, columns.parameter, columns.values, strict=True):
            Y[:, joint, parameter] += values
        return Y

    def torque(self, motion: Motion, parameters: ArrayLike) -> Array:
        """Joint torque, shape (N, n) [N·m or N], for standard parameters, shape (p,).

        A motion without hysteresis states is taken as one contiguous run.
        """
        motion = self._prepared(motion)
        theta = self._standard(parameters)
        tau = np.zeros((motion.samples, self.n))
        if self.has_rigid_bodies:
            inertial = self._inertial(theta)
            tau += kernel.inverse_dynamics(self.tree, inertial, motion.q, motion.dq, motion.ddq)
        columns = self.term_columns(motion)
        for joint, parameter, values in zip(columns.joint, columns.parameter, columns.values, strict=True):
            tau[:, joint] += values * theta[parameter]
        return tau

    def mass_matrix(self, q: ArrayLike, parameters: ArrayLike) -> Array:
        """Mass matrix M(q) of links and rotors, shape (N, n, n), at positions (N, n)."""
        theta, q = self._standard(parameters), self._positions(q)
        M = np.zeros((len(q), self.n, self.n))
        if self.has_rigid_bodies:
            M += kernel.mass_matrix(self.tree, self._inertial(theta), q)
        still = {"q": q.T, "dq": np.zeros_like(q.T), "ddq": np.zeros_like(q.T)}
        for column, law, per_acceleration in self._inertias:
            inertia = theta[column] * evaluate(per_acceleration, self._environment(law, still))
            for i, w_i in law.coordinate:
                for j, w_j in law.coordinate:
                    M[:, i, j] += w_i * w_j * inertia
        return M

    @cached_property
    def _inertias(self) -> tuple[tuple[int, Law, Expression], ...]:
        """Index of the parameter, law, and torque per acceleration of each law that depends on the acceleration."""
        each = zip(self.law_columns, (law for _, law in self.laws), strict=True)
        inertias = ((int(column), law, derivative(law.expression, "ddq")) for column, law in each)
        return tuple(each for each in inertias if each[2] != number(0.0))

    def coriolis_matrix(self, q: ArrayLike, dq: ArrayLike, parameters: ArrayLike) -> Array:
        """Coriolis matrix C(q, q̇) with Christoffel symbols, shape (N, n, n); dM/dt - 2 C is skew-symmetric."""
        q, dq = self._positions(q), self._positions(dq)
        return kernel.coriolis_matrix(self.tree, self._inertial(self._standard(parameters)), q, dq)

    def gravity_torque(self, q: ArrayLike, parameters: ArrayLike) -> Array:
        """Gravity torque g(q), shape (N, n) [N·m or N]."""
        q = self._positions(q)
        return kernel.gravity_torque(self.tree, self._inertial(self._standard(parameters)), q)

    def kinetic_energy(self, q: ArrayLike, dq: ArrayLike, parameters: ArrayLike) -> Array:
        """Kinetic energy ½ q̇ᵀ M q̇, shape (N,) [J]."""
        dq = self._positions(dq)
        return 0.5 * np.einsum("ni,nij,nj->n", dq, self.mass_matrix(q, parameters), dq)

    def potential_energy(self, q: ArrayLike, parameters: ArrayLike) -> Array:
        """Potential energy of gravity, shape (N,) [J]; a mass at the origin of the base frame has energy zero."""
        q = self._positions(q)
        return kernel.potential_energy(self.tree, self._inertial(self._standard(parameters)), q)

    def nominal_parameters(self) -> Array | None:
        """Standard parameters (p,): inertial parameters from the description, zero for all others.

        The result is `None` if the description has no inertial parameters, or none for a link with geometry, because
        the torque of the other links alone would be wrong.
        """
        inertial = self.robot.inertial_vector
        if inertial is None or not self.has_rigid_bodies or links_without_inertia(self.robot):
            return None
        theta = np.zeros(len(self.parameters))
        theta[self.inertial_columns] = inertial.ravel()
        return theta

    def _inertial(self, theta: Array) -> Array:
        if not self.has_rigid_bodies:
            return np.zeros((self.n, 10))
        return theta[self.inertial_columns].reshape(self.n, 10)

    def _standard(self, parameters: ArrayLike) -> Array:
        return array(parameters, (len(self.parameters),), "standard parameters")

    def _positions(self, q: ArrayLike) -> Array:
        return array(q, (None, self.n), "joint positions or velocities")

    def _prepared(self, motion: Motion) -> Motion:
        """Checks a motion and adds hysteresis states if the laws need them."""
        self._check(motion)
        return motion if motion.memory is not None else self.remember(motion)

    def _check(self, motion: Motion) -> None:
        if motion.n != self.n:
            raise ModelError(
                f"The motion has {motion.n} joints; {self.robot.name} has {self.n}.",
                remedy="give a motion of this arm.",
            )
