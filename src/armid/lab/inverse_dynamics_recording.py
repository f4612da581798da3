"""Recordings of a simulated arm, computed by inverse dynamics along a plan, with sensor noise.

The motion is exactly the planned motion, and the torque is exactly the torque of the model. There is no controller
and no elasticity. Therefore every error of the estimates is an error of the identification.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armid.checked_array import Array
from armid.excitation.fourier import Excitation, required_series
from armid.hashes import digest
from armid.measurement.recording import Recording
from armid.model.dynamics_model import DynamicsModel
from armid.model.motion import Motion

THESIS_FRICTION = {
    "FV": (28.404, 29.136, 11.133, 17.658, 5.953, 2.750, 2.814),
    "FS": (10.506, 13.207, 6.656, 7.437, 6.951, 3.111, 3.030),
}
"""Viscous [N·m·s/rad] and Coulomb [N·m] friction of the seven joints of the iiwa, from Table 4.1 of the thesis."""


WHOLE = 1e-6
"""Largest difference of the period from a whole number of samples, as a fraction of a sample, with which one period
is computed and repeated. The error of the position is then far below the noise of any encoder."""


@dataclass(frozen=True, slots=True)
class Sensors:
    """Noise and rate of the sensors.

    Attributes:
        position: Standard deviation of the noise of the encoders [rad].
        torque: Standard deviation of the noise of the torque sensors [N·m].
        rate: Sampling rate [Hz].
    """

    position: float = 1e-5
    torque: float = 0.3
    rate: float = 8000.0


def thesis_truth(model: DynamicsModel) -> Array:
    """Standard parameters (p,) of the virtual iiwa: inertia of the description, friction of `THESIS_FRICTION`."""
    nominal = model.nominal_parameters()
    theta = np.zeros(len(model.parameters)) if nominal is None else nominal
    for k, parameter in enumerate(model.parameters):
        if parameter.symbol in THESIS_FRICTION:
            theta[k] = THESIS_FRICTION[parameter.symbol][parameter.number - 1]
    return theta


def record(
    model: DynamicsModel,
    parameters: Array,
    excitation: Excitation,
    sensors: Sensors,
    rng: np.random.Generator,
    *,
    repetitions: int = 1,
) -> tuple[Recording, Motion, Array]:
    """Simulates a recording of an arm that repeats a plan.

    Args:
        model: Arm and torque terms.
        parameters: True standard parameters of the arm, shape (p,).
        excitation: The planned motion.
        sensors: Noise and rate of the sensors.
        rng: Random generator of the noise.
        repetitions: Number of repetitions of the motion, without a pause.

    Returns:
        The recording, the true motion of one period, and its true torque (N, n) [N·m or N].

    Raises:
        ArmidError: The argument `excitation` is not an `Excitation`.
    """
    motion = required_series(excitation).sample(sensors.rate)
    torque = model.torque(motion, parameters)
    samples = excitation.period * sensors.rate
    repeats, along, load = repetitions, motion, torque
    if abs(samples - round(samples)) > WHOLE:  # otherwise repetitions have their samples at different phases
        repeats, along = 1, excitation.sample(sensors.rate, repetitions)
        load = model.torque(along, parameters)

    def noisy(x: Array, deviation: float) -> Array:
        noise = rng.standard_normal((repeats, *x.shape))
        noise *= deviation
        noise += x
        return noise.reshape(-1, model.n)

    q, effort = noisy(along.q, sensors.position), noisy(load, sensors.torque)
    recording = Recording(
        time=np.arange(len(q)) / sensors.rate,
        q=q,
        effort=effort,
        joint_names=model.robot.joint_names,
        consecutive=True,
        source=f"virtual {model.robot.name}",
        sha256=digest(q, effort),
    )
    return recording, motion, torque
