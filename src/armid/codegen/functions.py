"""Functions of a model for which code is generated: regressors, torques, mass matrix, friction, hysteresis state.

The functions take base parameters, and no standard parameters. Each base parameter is used in the place of the
standard parameter whose regressor column is kept; all other standard parameters are zero. The torque is the same as
with the standard parameters, and parameters without effect need no operations.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from armid.codegen.graph import Graph, Scalar
from armid.codegen.program import STATE_FUNCTIONS, Argument, Program
from armid.codegen.rigid_bodies import Geometry, inverse_dynamics, mass_matrix, numbers, regressor
from armid.codegen.term_laws import combined, is_inertia, law_value, rotor_matrix, updated, uses
from armid.errors import ModelError, did_you_mean
from armid.model.base_parameters import BaseParameters
from armid.model.dynamics_model import DynamicsModel

PROGRAMS = (
    "regressor",
    "base_regressor",
    "inverse_dynamics",
    "gravity_torque",
    "mass_matrix",
    "friction",
    "state_start",
    "state_update",
)
"""Names of the functions, in the order in which they are written; the last two exist only for models with
hysteresis."""


def make_programs(
    model: DynamicsModel, base: BaseParameters, wanted: Sequence[str] = PROGRAMS
) -> tuple[Program, ...]:
    """Makes a program for each of the wanted functions of a model; each program can be used without the others.

    Args:
        model: Arm and torque terms. If a term depends on the load torque, the model needs `load_parameters`.
        base: Base parameters of the model.
        wanted: Names of the functions. For models without hysteresis, the functions of the hysteresis state are
            omitted.

    Raises:
        ModelError: A function does not exist, or a term depends on the load and no load parameters are given.
    """
    maker = Maker(model, base)
    unknown = sorted(set(wanted) - set(PROGRAMS))
    if unknown:
        raise ModelError(
            f"There is no function {unknown[0]!r} for which code can be generated.",
            possible=", ".join(PROGRAMS),
            remedy=did_you_mean(unknown[0], PROGRAMS),
        )
    names = [name for name in wanted if model.nodes or name not in STATE_FUNCTIONS]
    return tuple(maker.make(name) for name in names)


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

    def make(self, name: str) -> Program:
        """Makes the program of one of the functions in `PROGRAMS`."""
        arguments = tuple(self._argument(a) for a in self._arguments(name))
        inputs = {a.name: self.graph.symbols(a.name, a.length) for a in arguments}
        n = self.model.n
        if name == "regressor":
            columns = range(len(self.model.parameters))
            return self._regressor(name, ("Y", "standard"), arguments, inputs, columns)
        if name == "base_regressor":
            columns = self.base.kept.tolist()
            return self._regressor(name, ("Y_b", "base"), arguments, inputs, columns)
        if name in STATE_FUNCTIONS:
            entries = self._started(inputs) if name == "state_start" else self._updated(inputs)
            return Program(name, SUMMARIES[name], arguments, (len(self.model.nodes),), entries, "next")
        if name == "mass_matrix":
            M = self._mass_matrix(inputs)
            entries = {n * i + j: M[i][j] for i in range(n) for j in range(n)}
            return Program(name, SUMMARIES[name], arguments, (n, n), entries, "M")
        torque = {"inverse_dynamics": self._torque, "gravity_torque": self._gravity, "friction": self._friction}
        return Program(name, SUMMARIES[name], arguments, (n,), dict(enumerate(torque[name](inputs))), "tau")

    def _arguments(self, name: str) -> list[str]:
        """Names of the inputs of a function."""
        state = ["state"] if self.model.nodes else []
        if name == "friction":
            return ["parameters", "q", "dq", *(["ddq"] if uses(self.model, "load") else []), *state]
        return {
            "regressor": ["q", "dq", "ddq", *state],
            "base_regressor": ["q", "dq", "ddq", *state],
            "inverse_dynamics": ["parameters", "q", "dq", "ddq", *state],
            "gravity_torque": ["parameters", "q"],
            "mass_matrix": ["parameters", "q"],
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

    def _friction(self, inputs: Mapping[str, Sequence[Scalar]]) -> list[Scalar]:
        return self._laws(inputs, self._theta(inputs), [0.0] * self.model.n, inertia=False)

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
        width, entries = len(columns), dict[int, Scalar]()
        inertial = self.model.inertial_columns.reshape(-1, 10).tolist()
        kept = [[k for k, column in enumerate(link) if column in place] for link in inertial]
        if kept:
            nonzero = regressor(self._tree, kept, inputs["q"], inputs["dq"], inputs["ddq"])
            entries = {j * width + place[inertial[i][k]]: value for (j, i, k), value in nonzero.items()}
        inputs = self._with_load(inputs)
        for j, column, law, weight in self.model.entries:
            if column in place:
                index = j * width + place[column]
                entries[index] = entries.get(index, 0.0) + weight * law_value(self.model, law, inputs)
        symbol, kind = result
        summary = f"{symbol}: torque = {symbol} times {kind} parameters"
        return Program(name, summary, arguments, (self.model.n, width), entries, symbol)

    def _started(self, inputs: Mapping[str, Sequence[Scalar]]) -> dict[int, Scalar]:
        return {k: combined(node.coordinate, inputs["q"]) for k, node in enumerate(self.model.nodes)}

    def _updated(self, inputs: Mapping[str, Sequence[Scalar]]) -> dict[int, Scalar]:
        nodes = zip(self.model.nodes, inputs["state"], strict=True)
        return {k: updated(node, inputs["q"], state) for k, (node, state) in enumerate(nodes)}


SUMMARIES = {
    "inverse_dynamics": "Torque of the whole model",
    "gravity_torque": "Torque that holds the rigid links at rest, without friction",
    "mass_matrix": "Mass matrix of links and rotors",
    "friction": "Torque of all terms except the rigid links and rotor inertia",
    "state_start": "Hysteresis state at the beginning of a motion",
    "state_update": "Hysteresis state at the next sample; call this function before the torque is computed",
}

MEANINGS = {
    "parameters": "base parameters",
    "q": "joint positions [rad or m]",
    "dq": "joint velocities [rad/s or m/s]",
    "ddq": "joint accelerations [rad/s^2 or m/s^2]",
    "state": "hysteresis state",
}
