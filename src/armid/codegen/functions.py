"""Functions of a model for which code is generated: regressors, torques, matrices, accelerations, hysteresis state.

The functions take base parameters, and no standard parameters. Each base parameter is used in the place of the
standard parameter whose regressor column is kept; all other standard parameters are zero. The torque is the same as
with the standard parameters, and parameters without effect need no operations.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from armid.codegen.graph import Graph, Scalar
from armid.codegen.linear_system import is_regular, solve_symmetric
from armid.codegen.program import STATE_FUNCTIONS, Argument, Program
from armid.codegen.rigid_bodies import Geometry, inverse_dynamics, mass_matrix, numbers, regressor, without_gravity
from armid.codegen.term_laws import combined, is_inertia, law_value, rotor_matrix, updated, uses
from armid.errors import ModelError, did_you_mean
from armid.model.base_parameters import BaseParameters
from armid.model.dynamics_model import DynamicsModel
from armid.model.torque_law_expression import symbols

PROGRAMS = (
    "regressor",
    "base_regressor",
    "slotine_li_regressor",
    "inverse_dynamics",
    "forward_dynamics",
    "gravity_torque",
    "coriolis_torque",
    "bias_torque",
    "coriolis_matrix",
    "mass_matrix",
    "friction",
    "state_start",
    "state_update",
)
"""Names of the functions, in the order in which they are written. The last two exist only for models with hysteresis,
and `forward_dynamics` only for models in which every joint moves a mass."""

FURTHER_PROGRAMS = ("velocity_friction", "checked_forward_dynamics")
"""Names of further functions; code for them is generated only if an interface, such as that of ROS 2, needs them."""


def make_programs(
    model: DynamicsModel, base: BaseParameters, wanted: Sequence[str] = PROGRAMS
) -> tuple[Program, ...]:
    """Makes a program for each of the wanted functions of a model; each program can be used without the others.

    Args:
        model: Arm and torque terms. If a term depends on the load torque, the model needs `load_parameters`.
        base: Base parameters of the model.
        wanted: Names of the functions. Functions that do not exist for the model are omitted.

    Raises:
        ModelError: A function does not exist, or a term depends on the load and no load parameters are given.
    """
    maker = Maker(model, base)
    unknown = sorted(set(wanted) - {*PROGRAMS, *FURTHER_PROGRAMS})
    if unknown:
        raise ModelError(
            f"There is no function {unknown[0]!r} for which code can be generated.",
            possible=", ".join(PROGRAMS),
            remedy=did_you_mean(unknown[0], PROGRAMS),
        )
    return tuple(maker.make(name) for name in wanted if maker.exists(name))


@dataclass(eq=False, slots=True)
class Maker:
    """Generator of the programs of one model; all programs share the operations of one graph.

    Attributes:
        model: Arm and torque terms.
        base: Base parameters of the model.
        graph: Graph that contains the operations.
        geometry: Geometry of the arm, whose lengths and directions may be symbols; if `None`, the numeric geometry of
            `model` is used.
    """

    model: DynamicsModel
    base: BaseParameters
    graph: Graph = field(default_factory=Graph)
    geometry: Geometry | None = None

    def exists(self, name: str) -> bool:
        """True if a function exists for the model.

        The hysteresis functions need hysteresis states; the forward dynamics needs a mass that each joint moves.
        """
        if name in STATE_FUNCTIONS:
            return bool(self.model.nodes)
        if name in ("forward_dynamics", "checked_forward_dynamics"):
            arguments = map(self._argument, ("parameters", "q"))
            return is_regular(self._mass_matrix({a.name: self.graph.symbols(a.name, a.length) for a in arguments}))
        return True

    def make(self, name: str) -> Program:
        """Makes the program of one of the functions in `PROGRAMS` or `FURTHER_PROGRAMS`."""
        arguments = tuple(self._argument(a) for a in self._arguments(name))
        inputs = {a.name: self.graph.symbols(a.name, a.length) for a in arguments}
        n = self.model.n
        if name == "regressor":
            columns = range(len(self.model.parameters))
            return self._regressor(name, ("Y", "standard"), arguments, inputs, columns)
        if name in ("base_regressor", "slotine_li_regressor"):
            columns = self.base.kept.tolist()
            symbol = "Y_b" if name == "base_regressor" else "Y_r"
            return self._regressor(name, (symbol, "base"), arguments, inputs, columns)
        if name in STATE_FUNCTIONS:
            entries = self._started(inputs) if name == "state_start" else self._updated(inputs)
            return Program(name, SUMMARIES[name], arguments, (len(self.model.nodes),), entries, "next")
        if name in ("mass_matrix", "coriolis_matrix"):
            matrix = self._mass_matrix(inputs) if name == "mass_matrix" else self._coriolis_matrix(inputs)
            entries = {n * i + j: matrix[i][j] for i in range(n) for j in range(n)}
            return Program(name, SUMMARIES[name], arguments, (n, n), entries, name[0].upper())
        vectors = {
            "inverse_dynamics": self._torque,
            "forward_dynamics": self._acceleration,
            "gravity_torque": self._gravity,
            "coriolis_torque": self._coriolis,
            "bias_torque": self._bias,
            "friction": self._friction,
            "velocity_friction": self._velocity_friction,
        }
        if name == "checked_forward_dynamics":
            entries = dict(enumerate(self._acceleration(inputs) + self._pivots(inputs)))
            return Program(name, SUMMARIES[name], arguments, (2 * n,), entries, "acceleration")
        output = "acceleration" if name == "forward_dynamics" else "tau"
        return Program(name, SUMMARIES[name], arguments, (n,), dict(enumerate(vectors[name](inputs))), output)

    def _arguments(self, name: str) -> list[str]:
        """Names of the inputs of a function."""
        state = ["state"] if self.model.nodes else []
        load = ["ddq"] if uses(self.model, "load") else []
        return {
            "regressor": ["q", "dq", "ddq", *state],
            "base_regressor": ["q", "dq", "ddq", *state],
            "slotine_li_regressor": ["q", "dq", "dq_r", "ddq_r", *state],
            "inverse_dynamics": ["parameters", "q", "dq", "ddq", *state],
            "forward_dynamics": ["parameters", "q", "dq", "tau", *load, *state],
            "checked_forward_dynamics": ["parameters", "q", "dq", "tau", *load, *state],
            "gravity_torque": ["parameters", "q"],
            "coriolis_torque": ["parameters", "q", "dq"],
            "bias_torque": ["parameters", "q", "dq"],
            "coriolis_matrix": ["parameters", "q", "dq"],
            "mass_matrix": ["parameters", "q"],
            "friction": ["parameters", "q", "dq", *load, *state],
            "velocity_friction": ["parameters", "dq"],
            "state_start": ["q"],
            "state_update": ["q", "state"],
        }[name]

    def _argument(self, name: str) -> Argument:
        length = {"parameters": self.base.count, "state": len(self.model.nodes)}.get(name, self.model.n)
        return Argument(name, length, MEANINGS[name])

    @property
    def _tree(self) -> Geometry:
        if self.geometry is None:
            self.geometry = numbers(self.model.tree)
        return self.geometry

    def _theta(self, inputs: Mapping[str, Sequence[Scalar]]) -> dict[int, Scalar]:
        """Base parameters; the keys are the columns of the standard parameters in whose place they are used."""
        return dict(zip(self.base.kept.tolist(), inputs["parameters"], strict=True))

    def _bodies(self, theta: Mapping[int, Scalar]) -> list[list[Scalar]]:
        """Inertial parameters of the n links, ten scalars each, from parameters given by column."""
        columns = self.model.inertial_columns.tolist()
        flat: list[Scalar] = [theta.get(c, 0.0) for c in columns] or [0.0] * (10 * self.model.n)
        return [flat[10 * i : 10 * i + 10] for i in range(self.model.n)]

    def _torque(self, inputs: Mapping[str, Sequence[Scalar]]) -> list[Scalar]:
        theta = self._theta(inputs)
        rigid = inverse_dynamics(self._tree, self._bodies(theta), inputs["q"], inputs["dq"], inputs["ddq"])
        return self._laws(inputs, theta, rigid, inertia=True)

    def _gravity(self, inputs: Mapping[str, Sequence[Scalar]]) -> list[Scalar]:
        still: list[Scalar] = [0.0] * self.model.n
        return inverse_dynamics(self._tree, self._bodies(self._theta(inputs)), inputs["q"], still, still)

    def _coriolis(self, inputs: Mapping[str, Sequence[Scalar]]) -> list[Scalar]:
        return self._product_of_velocities(inputs, inputs["dq"])

    def _bias(self, inputs: Mapping[str, Sequence[Scalar]]) -> list[Scalar]:
        still: list[Scalar] = [0.0] * self.model.n
        bodies = self._bodies(self._theta(inputs))
        return inverse_dynamics(self._tree, bodies, inputs["q"], inputs["dq"], still)

    def _coriolis_matrix(self, inputs: Mapping[str, Sequence[Scalar]]) -> list[list[Scalar]]:
        """Coriolis matrix C(q, q̇), n rows of n scalars; column j is its product with a unit velocity of joint j."""
        units = [[float(i == j) for i in range(self.model.n)] for j in range(self.model.n)]
        columns = [self._product_of_velocities(inputs, list[Scalar](unit)) for unit in units]
        return [list(row) for row in zip(*columns, strict=True)]

    def _product_of_velocities(self, inputs: Mapping[str, Sequence[Scalar]], other: Sequence[Scalar]) -> list[Scalar]:
        """Product C(q, q̇) q̇_other of the Coriolis matrix with a second velocity `other`, n scalars."""
        still: list[Scalar] = [0.0] * self.model.n
        tree, bodies = without_gravity(self._tree), self._bodies(self._theta(inputs))
        return inverse_dynamics(
            tree, bodies, inputs["q"], inputs["dq"], still, None if other is inputs["dq"] else other
        )

    def _acceleration(self, inputs: Mapping[str, Sequence[Scalar]]) -> list[Scalar]:
        bias = self._laws(inputs, self._theta(inputs), self._bias(inputs), inertia=False)
        free = [tau - other for tau, other in zip(inputs["tau"], bias, strict=True)]
        return solve_symmetric(self._mass_matrix(inputs), free)[0]

    def _pivots(self, inputs: Mapping[str, Sequence[Scalar]]) -> list[Scalar]:
        """Pivots of the mass matrix, which are positive if and only if it is positive definite."""
        return solve_symmetric(self._mass_matrix(inputs), [0.0] * self.model.n)[1]

    def _friction(self, inputs: Mapping[str, Sequence[Scalar]]) -> list[Scalar]:
        return self._laws(inputs, self._theta(inputs), [0.0] * self.model.n, inertia=False)

    def _velocity_friction(self, inputs: Mapping[str, Sequence[Scalar]]) -> list[Scalar]:
        theta, torque = self._theta(inputs), list[Scalar]([0.0] * self.model.n)
        for j, column, law, weight in self.model.entries:
            if column in theta and symbols(law.expression) <= {"dq"}:
                torque[j] = torque[j] + theta[column] * (weight * law_value(self.model, law, inputs))
        return torque

    def _laws(
        self,
        inputs: Mapping[str, Sequence[Scalar]],
        theta: Mapping[int, Scalar],
        torque: list[Scalar],
        *,
        inertia: bool,
    ) -> list[Scalar]:
        """Adds the torque of the laws of the terms to `torque`.

        Laws that are proportional to the acceleration are added only if `inertia` is true.
        """
        inputs, torque = self._with_load(inputs), list(torque)
        for j, column, law, weight in self.model.entries:
            if column in theta and (inertia or not is_inertia(law)):
                torque[j] = torque[j] + theta[column] * (weight * law_value(self.model, law, inputs))
        return torque

    def _with_load(self, inputs: Mapping[str, Sequence[Scalar]]) -> dict[str, Sequence[Scalar]]:
        """Inputs for the laws of the terms: the given inputs, and the load torque if a law depends on it."""
        if not uses(self.model, "load"):
            return dict(inputs)
        if self.model.load_parameters is None:
            raise ModelError(
                "A torque term depends on the load torque of the joints, but the model has no `load_parameters` to "
                "compute it.",
                remedy="give inertial parameters of an earlier estimate as `load_parameters` of the model.",
            )
        bodies: list[list[Scalar]] = [list(body) for body in self.model.load_parameters.tolist()]
        load = inverse_dynamics(self._tree, bodies, inputs["q"], inputs["dq"], inputs["ddq"])
        return {**inputs, "load": load}

    def _mass_matrix(self, inputs: Mapping[str, Sequence[Scalar]]) -> list[list[Scalar]]:
        theta = self._theta(inputs)
        M = mass_matrix(self._tree, self._bodies(theta), inputs["q"])
        for (i, j), value in rotor_matrix(self.model, theta, inputs["q"]).items():
            M[i][j] = M[i][j] + value
        return M

    def _regressor(
        self,
        name: str,
        result: tuple[str, str],
        arguments: tuple[Argument, ...],
        inputs: Mapping[str, Sequence[Scalar]],
        columns: Sequence[int],
    ) -> Program:
        place = {column: k for k, column in enumerate(columns)}
        other = inputs.get("dq_r")
        if other is not None:
            inputs = {**inputs, "ddq": inputs["ddq_r"]}
        width, entries = len(columns), dict[int, Scalar]()
        inertial = self.model.inertial_columns.reshape(-1, 10).tolist()
        kept = [[k for k, column in enumerate(link) if column in place] for link in inertial]
        if kept:
            nonzero = regressor(self._tree, kept, inputs["q"], inputs["dq"], inputs["ddq"], other)
            entries = {j * width + place[inertial[i][k]]: value for (j, i, k), value in nonzero.items()}
        inputs = self._with_load(inputs)
        for j, column, law, weight in self.model.entries:
            if column in place:
                index = j * width + place[column]
                entries[index] = entries.get(index, 0.0) + weight * law_value(self.model, law, inputs)
        symbol, kind = result
        summary = f"{symbol}: torque = {symbol} times {kind} parameters"
        if other is not None:
            summary = f"Y_r: M ddq_r + C dq_r + gravity torque + friction = Y_r times {kind} parameters"
        return Program(name, summary, arguments, (self.model.n, width), entries, symbol)

    def _started(self, inputs: Mapping[str, Sequence[Scalar]]) -> dict[int, Scalar]:
        return {k: combined(node.coordinate, inputs["q"]) for k, node in enumerate(self.model.nodes)}

    def _updated(self, inputs: Mapping[str, Sequence[Scalar]]) -> dict[int, Scalar]:
        nodes = zip(self.model.nodes, inputs["state"], strict=True)
        return {k: updated(node, inputs["q"], state) for k, (node, state) in enumerate(nodes)}


SUMMARIES = {
    "inverse_dynamics": "Torque of the whole model",
    "forward_dynamics": "Acceleration that a joint torque causes, with friction",
    "checked_forward_dynamics": "Acceleration that a joint torque causes, then the pivots of the mass matrix",
    "coriolis_torque": "Coriolis and centrifugal torque C dq of the rigid links",
    "bias_torque": "Torque of the rigid links without acceleration: Coriolis, centrifugal and gravity torque",
    "coriolis_matrix": "Coriolis matrix C with Christoffel symbols: dM/dt - 2 C is skew-symmetric",
    "gravity_torque": "Torque that holds the rigid links at rest, without friction",
    "mass_matrix": "Mass matrix of links and rotors",
    "friction": "Torque of all terms except the rigid links and rotor inertia",
    "velocity_friction": "Torque of all terms that depend on the velocities alone, and of constant terms",
    "state_start": "Hysteresis state at the beginning of a motion",
    "state_update": "Hysteresis state at the next sample; call this function before the torque is computed",
}

MEANINGS = {
    "parameters": "base parameters",
    "q": "joint positions [rad or m]",
    "dq": "joint velocities [rad/s or m/s]",
    "ddq": "joint accelerations [rad/s^2 or m/s^2]",
    "state": "hysteresis state",
    "tau": "joint torques [N m or N]",
    "dq_r": "reference velocities [rad/s or m/s]",
    "ddq_r": "reference accelerations [rad/s^2 or m/s^2]",
}
