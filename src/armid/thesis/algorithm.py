"""Algorithm 3 of the thesis, and the errors of its estimates for a virtual arm whose true parameters are known."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from armid.estimation.fit_result import Fit
from armid.estimation.problem import EstimationProblem, build_problem
from armid.hashes import digest
from armid.lab.inverse_dynamics_recording import Sensors, record
from armid.measurement.log_format import LogFormat
from armid.measurement.observations import Observations
from armid.measurement.processing.options import ProcessingOptions
from armid.measurement.recording import Recording
from armid.model.terms.rigid_body import RIGID_BODY_SYMBOLS
from armid.study.config import EstimationChoice, RecordingChoice, build_estimator
from armid.study.recordings.processed import joined_observations, process_each
from armid.thesis.setting import PERIOD, ReferenceModel, Setting

REPETITIONS = 5
"""Number of repetitions of the motion in a recording; section 3.2.2 of the thesis calls it K and gives no value."""

TEST_RATE = 100.0
"""Sample rate of the motion on which estimates are validated [Hz]."""

NOISE = Sensors()
"""Noise of recordings at 8 kHz; at other sample rates the noise is scaled so that its spectral density is the
same."""


@dataclass(frozen=True, eq=False, slots=True)
class Fitted:
    """Estimate, together with the model, the observations and the estimation problem from which it was computed.

    Attributes:
        model: Dynamics model of the fit.
        observations: The processed recording.
        problem: Estimation problem for these observations.
        fit: The estimate.
    """

    model: ReferenceModel
    observations: Observations
    problem: EstimationProblem
    fit: Fit

    @property
    def residual(self) -> float:
        """Root mean square of the filtered residuals, over all joints [N·m]."""
        return float(np.sqrt(np.mean(self.fit.residual_rms**2)))


@dataclass(frozen=True, slots=True)
class Errors:
    """Errors of an estimate for the virtual arm, whose true parameters are known.

    Attributes:
        relative: Norm of the error of all base parameters divided by the norm of the true base parameters.
        inertial: Ratio of norms as in `relative`, only for base parameters without friction.
        friction: Ratio of norms as in `relative`, only for friction parameters.
        unseen: Root mean square, over all joints, of predicted minus true torque along Table A.2 of the thesis [N·m].
        residual: Root mean square of the filtered residuals, over all joints [N·m].
    """

    relative: float
    inertial: float
    friction: float
    unseen: float
    residual: float


def recorded(setting: Setting, seed: int, *, noise: bool = True) -> Recording:
    """Simulates a recording of five repetitions of Table A.1 of the thesis, 27 s each, without a pause.

    Args:
        setting: Arm, true parameters and motions.
        seed: Seed of the noise.
        noise: False for a recording without noise.
    """
    rng, rate = np.random.default_rng(seed), setting.extent.rate
    size = np.sqrt(rate / NOISE.rate) if noise else 0.0
    sensors = Sensors(size * NOISE.position, size * NOISE.torque, rate)
    model = setting.hanging.dynamics
    return record(model, setting.theta, setting.train, sensors, rng, repetitions=REPETITIONS)[0]


def mean_of(recording: Recording, period: float = PERIOD) -> Recording:
    """Mean over the repetitions in a recording, as a recording of one repetition; `period` is its duration [s]."""
    assert recording.time is not None and recording.effort is not None  # a virtual arm logs both
    samples = round(period / (recording.time[1] - recording.time[0]))
    q, effort = (x[: len(x) // samples * samples] for x in (recording.q, recording.effort))
    q, effort = (x.reshape(-1, samples, x.shape[1]).mean(axis=0) for x in (q, effort))
    return Recording(
        time=recording.time[:samples] - recording.time[0],
        q=q,
        effort=effort,
        joint_names=recording.joint_names,
        consecutive=True,
        source=f"mean of {recording.source}",
        sha256=digest(q, effort),
    )


def observed(
    setting: Setting, recording: Recording, processing: ProcessingOptions, period: float | None = PERIOD
) -> Observations:
    """Steps 1 and 2 of Algorithm 3 of the thesis: processes a recording.

    Args:
        setting: Arm, true parameters and motions.
        recording: The recording.
        processing: Processing options.
        period: Period of the motion [s]; `None` if the motion does not repeat.
    """
    reading = LogFormat() if period is None else LogFormat(period=period, start=0.0)
    choice = RecordingChoice("virtual", reading=reading)
    return joined_observations(process_each([(choice, recording)], processing, setting.hanging.dynamics.robot))


def estimate(
    model: ReferenceModel, observations: Observations, method: str = "ols", options: Mapping[str, Any] | None = None
) -> Fitted:
    """Steps 3 and 4 of Algorithm 3 of the thesis: estimates the base parameters with a given method."""
    problem = build_problem(model.dynamics, observations, base=model.base)
    return Fitted(model, observations, problem, _solved(problem, method, options))


def by_method(fitted: Fitted, method: str, options: Mapping[str, Any] | None = None) -> Fitted:
    """Estimates the base parameters with another method from the estimation problem of an earlier estimate."""
    return replace(fitted, fit=_solved(fitted.problem, method, options))


def _solved(problem: EstimationProblem, method: str, options: Mapping[str, Any] | None) -> Fit:
    """Solves an estimation problem with the estimator of a given name and its options."""
    return build_estimator(EstimationChoice(method, options={method: options or {}})).solve(problem)


def errors_of(setting: Setting, fitted: Fitted) -> Errors:
    """Errors of the estimated parameters, and of the torque that they predict along Table A.2 of the thesis."""
    truth, values = setting.truth, fitted.fit.values
    friction = np.array([name.symbol not in RIGID_BODY_SYMBOLS for name in setting.hanging.base.names])
    motion = setting.unseen.sample(TEST_RATE)
    torque = setting.hanging.dynamics.torque(motion, setting.theta)
    found = fitted.model.dynamics.torque(motion, fitted.model.theta(values))

    def off(which: NDArray[np.bool_]) -> float:
        return float(np.linalg.norm((values - truth)[which]) / np.linalg.norm(truth[which]))

    return Errors(
        off(friction | ~friction),
        off(~friction),
        off(friction),
        float(np.sqrt(np.mean((found - torque) ** 2))),
        fitted.residual,
    )
