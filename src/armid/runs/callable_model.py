"""Callable model of a run: computes torques, matrices, accelerations and regressors of one sample in microseconds.

    model = CallableModel.of(load_run("runs/iiwa"))
    tau = model.torque(q, dq, ddq)

The functions are the same as in the generated code and are run by the kernel. A call never changes a model, so
several threads may use the same model. The hysteresis states of a motion are stored in a separate `CallableMemory`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from armid.checked_array import Array, array
from armid.codegen.functions import make_programs
from armid.codegen.operation_tape import make_tape
from armid.codegen.program import Program
from armid.errors import ArmidError
from armid.estimation.estimate_record import torque_parameters
from armid.kernel import in_use
from armid.kernel.dispatch import TWIN
from armid.model.base_parameters import BaseParameters
from armid.model.dynamics_model import DynamicsModel
from armid.model.equations_of_motion import CONVERGED, DIVERGED, MOST_ITERATIONS
from armid.runs.run import Run


class CallableModel:
    """Model with parameter values, which computes one sample per call.

    Vectors have shape (n,). Arrays of float64 in C order are used directly; other values are converted.

    Args:
        model: Arm and torque terms.
        base: Base parameters of the model.
        values: Values of the base parameters, shape (b,).
    """

    __slots__ = ("_calls", "joints", "memories")

    _calls: _Calls

    joints: tuple[str, ...]
    """Names of the joints."""

    memories: int
    """Number of hysteresis states of the model; a model with 0 states needs no `CallableMemory`."""

    def __init__(self, model: DynamicsModel, base: BaseParameters, values: ArrayLike) -> None:
        given = {"parameters": array(values, (base.count,), "base parameters")}
        self._calls = _Calls(model, base, given)
        self.joints = model.robot.joint_names
        self.memories = len(model.nodes)

    @classmethod
    def of(cls, run: Run) -> CallableModel:
        """Callable model of a run, with the parameters of its estimate."""
        base = run.estimate.base
        return cls(run.model, base, base.values_of(torque_parameters(base, run.estimate.fit)))

    def torque(self, q: ArrayLike, dq: ArrayLike, ddq: ArrayLike, memory: CallableMemory | None = None) -> Array:
        """Torque of the whole model, shape (n,) [N·m or N].

        Args:
            q: Joint positions [rad or m].
            dq: Joint velocities [rad/s or m/s].
            ddq: Joint accelerations [rad/s² or m/s²].
            memory: Hysteresis states, already updated with these positions q; needed if the model has hysteresis.

        Raises:
            ArmidError: A shape is wrong, values are not finite, or the memory is missing.
        """
        call = self._calls["inverse_dynamics"].run
        return call(q, dq, ddq) if not self.memories else call(q, dq, ddq, self._state(memory))

    def gravity(self, q: ArrayLike) -> Array:
        """Gravity torque g(q) of the links at joint positions q (n,) [rad or m], shape (n,) [N·m or N]."""
        return self._calls["gravity_torque"].run(q)

    def coriolis(self, q: ArrayLike, dq: ArrayLike) -> Array:
        """Coriolis and centrifugal torque C(q, q̇) q̇, shape (n,) [N·m or N]."""
        return self._calls["coriolis_torque"].run(q, dq)

    def bias(self, q: ArrayLike, dq: ArrayLike) -> Array:
        """Bias torque C(q, q̇) q̇ + g(q) of the links, shape (n,) [N·m or N]."""
        return self._calls["bias_torque"].run(q, dq)

    def coriolis_matrix(self, q: ArrayLike, dq: ArrayLike) -> Array:
        """Coriolis matrix C(q, q̇) with Christoffel symbols, shape (n, n); dM/dt - 2 C is skew-symmetric."""
        return self._calls["coriolis_matrix"].run(q, dq)

    def acceleration(
        self, q: ArrayLike, dq: ArrayLike, torque: ArrayLike, memory: CallableMemory | None = None
    ) -> Array:
        """Joint acceleration that a torque causes, with friction (forward dynamics), shape (n,) [rad/s² or m/s²].

        Args:
            q: Joint positions.
            dq: Joint velocities.
            torque: Joint torques [N·m or N].
            memory: Hysteresis states, as for `torque`.

        Raises:
            ArmidError: The mass matrix is not positive definite, or the friction is larger than the load on which it
                depends.
        """
        call, n = self._calls["checked_forward_dynamics"], len(self.joints)
        state = [self._state(memory)] if self.memories else []
        if "ddq" not in call.inputs:
            return self._checked(call.run(q, dq, torque, *state))
        ddq = np.zeros(n)
        first = 0.0
        for iteration in range(MOST_ITERATIONS):
            before, ddq = ddq, self._checked(call.run(q, dq, torque, ddq, *state))
            change = float(np.abs(ddq - before).max())
            if change <= CONVERGED * np.abs(ddq).max():
                return ddq
            first = first if iteration else change
            if change > DIVERGED * first:
                break
        raise ArmidError(
            "The acceleration was not found, because the load-dependent friction is larger than the load.",
            remedy="identify without load-dependent friction.",
        )

    def _checked(self, result: Array) -> Array:
        """Acceleration (n,), taken from a result that also contains the pivots of the factorised mass matrix.

        Raises:
            ArmidError: A pivot is not positive.
        """
        n = len(self.joints)
        if not (result[n:] > 0.0).all():
            raise ArmidError(
                f"The mass matrix is not positive definite: its smallest pivot is {result[n:].min():.2g}, so a "
                "torque has no physical acceleration.",
                remedy='identify with method = "physical", which makes every link physically consistent.',
            )
        return result[:n]

    def slotine_li_regressor(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        dq_r: ArrayLike,
        ddq_r: ArrayLike,
        memory: CallableMemory | None = None,
    ) -> Array:
        """Regressor Y_r with Y_r π_b = M q̈_r + C q̇_r + g + friction, shape (n, b) [Slotine1987].

        Args:
            q: Joint positions.
            dq: Joint velocities.
            dq_r: Reference velocities.
            ddq_r: Reference accelerations.
            memory: Hysteresis states, as for `torque`.
        """
        state = [self._state(memory)] if self.memories else []
        return self._calls["slotine_li_regressor"].run(q, dq, dq_r, ddq_r, *state)

    def mass_matrix(self, q: ArrayLike) -> Array:
        """Mass matrix of links and rotors, shape (n, n) [kg·m² or kg]."""
        return self._calls["mass_matrix"].run(q)

    def friction(
        self, q: ArrayLike, dq: ArrayLike, ddq: ArrayLike | None = None, memory: CallableMemory | None = None
    ) -> Array:
        """Torque of all terms except links and rotors, shape (n,) [N·m or N].

        Args:
            q: Joint positions.
            dq: Joint velocities.
            ddq: Joint accelerations; zero if not given. Only load-dependent friction depends on them.
            memory: Hysteresis states, as for `torque`.
        """
        call, inputs = self._calls["friction"], [q, dq]
        if "ddq" in call.inputs:
            inputs.append(np.zeros(len(self.joints)) if ddq is None else ddq)
        return call.run(*inputs, *([self._state(memory)] if self.memories else []))

    def memory(self, q: ArrayLike) -> CallableMemory:
        """Creates the hysteresis states of a motion that begins at the joint positions q, shape (n,)."""
        if not self.memories:
            return CallableMemory(np.zeros(0), None)
        return CallableMemory(self._calls["state_start"].run(q), self._calls["state_update"])

    def _state(self, memory: CallableMemory | None) -> Array:
        if memory is None:
            raise ArmidError(
                "The model has hysteresis, but no memory was given.",
                remedy="create a memory with model.memory(q) at the start of the motion, and update it at every "
                "sample.",
            )
        return memory.state


class CallableMemory:
    """Hysteresis states of one motion; only one thread may use them at a time.

    Attributes:
        state: The m hysteresis states of the model, shape (m,).
    """

    __slots__ = ("_update", "state")

    def __init__(self, state: Array, update: _Call | None) -> None:
        self.state = state
        self._update = update

    def update(self, q: ArrayLike) -> None:
        """Updates the states with the positions q (n,) of the next sample; invalid positions change nothing."""
        if self._update is not None:
            self.state = self._update.run(q, self.state)


class _Calls:
    """Generated functions of a model, each of which is prepared when it is first used."""

    def __init__(self, model: DynamicsModel, base: BaseParameters, given: dict[str, Array]) -> None:
        self._source, self._given = (model, base), given
        self._prepared: dict[str, _Call] = {}

    def __getitem__(self, name: str) -> _Call:
        call = self._prepared.get(name)
        if call is None:
            programs = make_programs(*self._source, [name])
            if not programs:
                raise ArmidError(
                    "The model has no forward dynamics, because no torque term gives every joint an inertia.",
                    remedy="identify with the torque term rigid-body.",
                )
            call = self._prepared[name] = _Call(programs[0], self._given)
        return call


@dataclass(frozen=True, eq=False, slots=True, init=False)
class _Call:
    """Generated function that is run by the kernel.

    Attributes:
        inputs: Names of the inputs.
        lengths: Lengths of the inputs.
        run: Function that computes the result from one vector for each input.
    """

    inputs: tuple[str, ...]
    lengths: tuple[int, ...]
    run: Callable[..., Array]

    def __init__(self, program: Program, given: dict[str, Array]) -> None:
        inputs = [argument for argument in program.arguments if argument.name not in given]
        object.__setattr__(self, "inputs", tuple(argument.name for argument in inputs))
        object.__setattr__(self, "lengths", tuple(argument.length for argument in inputs))
        if in_use() == TWIN:
            object.__setattr__(self, "run", self._in_numpy(program, given))
            return
        native, shape, empty = make_tape(program, given).run, program.shape, np.empty

        def run(*vectors: ArrayLike) -> Array:
            out = empty(shape)
            try:
                wrong = native(out, *vectors)  # pyright: ignore[reportArgumentType]
            except TypeError:
                wrong = native(out, *self._converted(vectors))
            if wrong:
                raise self._error(wrong, vectors)
            return out

        object.__setattr__(self, "run", run)

    def _in_numpy(self, program: Program, given: dict[str, Array]) -> Callable[..., Array]:
        """Function that computes the result in NumPy, without the compiled kernel."""

        def run(*vectors: ArrayLike) -> Array:
            inputs = dict(zip(self.inputs, self._converted(vectors), strict=True))
            return program.evaluate({**given, **inputs})

        return run

    def _converted(self, vectors: tuple[ArrayLike, ...]) -> list[Array]:
        """Input vectors, converted to arrays for the kernel.

        Raises:
            ArmidError: A shape is wrong, or values are not numbers.
        """
        wanted = zip(vectors, self.lengths, self.inputs, strict=True)
        return [array(x, (length,), name) for x, length, name in wanted]

    def _error(self, wrong: int, vectors: tuple[ArrayLike, ...]) -> ArmidError:
        """Error for a code of the kernel: k if input vector k (from 1) has a wrong length, -k if it is not finite."""
        k = abs(wrong) - 1
        name, length = self.inputs[k], self.lengths[k]
        if wrong < 0:
            return ArmidError(
                f"{name} must be finite; found {np.asarray(vectors[k]).tolist()}.", remedy="replace NaN and infinity."
            )
        return ArmidError(
            f"{name} must have shape ({length},); found {np.shape(vectors[k])}.",
            remedy="give a vector of this length.",
        )
