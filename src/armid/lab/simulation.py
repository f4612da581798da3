"""Simulation of a recording: an arm with known parameters is moved along a plan and measured by sensors."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from armid.checked_array import Array
from armid.errors import Finding, LabError
from armid.excitation.fourier import Excitation, required_series
from armid.lab.controller import ControllerGains
from armid.lab.detect_placeholder_limits import placeholder_finding
from armid.lab.faults import spoil
from armid.lab.known_arms import KnownArm
from armid.lab.options import LabOptions
from armid.lab.plant import stable_rate
from armid.lab.sensors import sense
from armid.lab.simulated_motion import Tell, TrueMotion, closed_loop, inverse_dynamics
from armid.measurement.recording import Recording
from armid.model.base_parameters import find_base_parameters
from armid.model.dynamics_model import DynamicsModel
from armid.model.terms import Coulomb, Offset, RigidBody, RotorInertia, Term, Viscous
from armid.robot.robot import Joint

POSES = 60
"""Number of poses of a plan in which the eigenfrequency of the springs is computed."""


KEPT = 1.0 + 1e-9
"""A plan counts as within a limit up to this ratio of value and limit; the excess over 1 allows for rounding
errors."""

ASKED = 1000.0
"""Rate at which positions and velocities of a plan are compared with the limits [Hz]."""

FULL = 0.999
"""Share of the effort limit from which the limit counts as reached, because a current loop never reaches the limit
exactly."""


@dataclass(frozen=True, eq=False, slots=True)
class Simulated:
    """Result of a simulation.

    Attributes:
        recording: The log of the simulated arm, with faults.
        trace: The true motion of the arm.
        truth: The simulated arm.
        plan: The planned motion.
        options: Options of the simulation.
        gains: Gains of the controller; `None` if there is no controller.
        seed: Seed of the noise and the faults.
    """

    recording: Recording
    trace: TrueMotion
    truth: KnownArm
    plan: Excitation
    options: LabOptions
    gains: ControllerGains | None
    seed: int


def simulate(
    truth: KnownArm, plan: Excitation, options: LabOptions | None = None, *, seed: int = 1, tell: Tell | None = None
) -> Simulated:
    """Simulates an arm that moves along a plan, and the sensors that record the motion.

    Args:
        truth: The arm, without the properties of `options.arm`.
        plan: The planned motion.
        options: All other options; default values if `None`.
        seed: Seed of the noise and the faults; the same seed gives exactly the same log.
        tell: Callback with the share of the simulation that is done.

    Raises:
        LabError: The plan does not fit the arm, or the simulation became unstable.
        ArmidError: The argument `plan` is not an `Excitation`.
        MissingExtraError: The mode is `closed-loop`, but MuJoCo is not installed.
    """
    options = options or LabOptions()
    truth = options.arm.of(truth)
    if required_series(plan).n != truth.robot.n:
        raise LabError(
            f"The plan moves {plan.n} joints; {truth.robot.name} has {truth.robot.n}.",
            remedy="give a plan for this arm, or lock the joints that the plan does not move with --lock.",
        )
    rate = options.sensing.rate
    gain = None
    if options.mode == "inverse-dynamics":
        trace = inverse_dynamics(truth, plan, rate, options.repetitions, options.pushes)
    else:
        trace, gain = closed_loop(
            truth,
            plan,
            options.controller,
            options.drive,
            rate=_physics_rate(truth, plan, options),
            repetitions=options.repetitions,
            lead_in=options.lead_in,
            pushes=options.pushes,
            tell=tell,
        )
    names, source = truth.robot.joint_names, f"virtual {truth.robot.name}"
    recording = sense(trace, options.sensing, names, source, np.random.default_rng(seed))
    if options.faults:
        recording = spoil(recording, options.faults, seed)
    return Simulated(recording, trace, truth, plan, options, gain, seed)


def simulation_findings(simulated: Simulated) -> tuple[Finding, ...]:
    """Findings about a simulated arm or motion that is not realistic, such as joints beyond their limits.

    The joints of the simulated arm have no hard stops. If a limit is exceeded, the finding states whether the plan
    exceeds the limit, or only the controlled motion.
    """
    trace, joints = simulated.trace.from_time(0.0), simulated.truth.robot.joints
    asked = simulated.plan.sample(ASKED)
    efforts = simulated.options.drive.limits(simulated.truth) if simulated.gains is not None else None
    found: list[Finding] = []
    odd = placeholder_finding(simulated.truth, trace.transmitted)
    found += [] if odd is None else [odd]
    for j, joint in enumerate(joints):
        found += _range_doubts(joint, asked.q[:, j], trace.q[:, j])
        found += _speed_doubts(joint, float(np.abs(asked.dq[:, j]).max()), float(np.abs(trace.dq[:, j]).max()))
        share = 0.0 if efforts is None else float(np.mean(np.abs(trace.effort[:, j]) >= FULL * efforts[j]))
        if share > 0.0:
            evidence = f"reaches its effort limit in {100.0 * share:.2g} % of the time."
            found.append(_doubt("drive-saturated", joint.name, evidence, "give the plan a longer period."))
    return tuple(found)


def _range_doubts(joint: Joint, asked: Array, reached: Array) -> list[Finding]:
    """Findings about positions (N,) of a joint outside its limits, in the plan or only in the simulated motion."""
    lower, upper = joint.position_limits
    limits = f"its limits are {lower:.3f}, {upper:.3f} {joint.unit}"
    slack = (KEPT - 1.0) * (upper - lower)
    if asked.min() < lower - slack or asked.max() > upper + slack:
        evidence = f"the plan moves it from {asked.min():.3f} to {asked.max():.3f} {joint.unit}; {limits}."
        return [_doubt("plan-outside-limits", joint.name, evidence, "design a plan that keeps the limits.")]
    if reached.min() < lower - slack or reached.max() > upper + slack:
        evidence = (
            f"moves from {reached.min():.3f} to {reached.max():.3f} {joint.unit}; {limits}. The plan keeps them, but "
            "the controller overshoots."
        )
        remedy = f"design the plan with a margin: --limit {joint.name}.position=LOW:HIGH."
        return [_doubt("limit-overshot", joint.name, evidence, remedy)]
    return []


def _speed_doubts(joint: Joint, asked: float, reached: float) -> list[Finding]:
    """Findings about a joint whose speed [rad/s or m/s] exceeds its limit in the plan, or only in the simulation."""
    limit, unit = joint.velocity_limit, f"{joint.unit}/s"
    if asked > KEPT * limit:
        evidence = f"has a velocity of {asked:.3f} {unit} in the plan; its limit is {limit:.3f} {unit}."
        return [_doubt("plan-too-fast", joint.name, evidence, "give the plan a longer period.")]
    if reached > KEPT * limit:
        evidence = (
            f"reaches {reached:.3f} {unit}; its limit is {limit:.3f} {unit}. The velocity in the plan is at most "
            f"{asked:.3f} {unit}; the controller overshoots it."
        )
        remedy = f"design the plan with a margin: --limit {joint.name}.velocity={0.99 * limit**2 / reached:.3g}."
        return [_doubt("limit-overshot", joint.name, evidence, remedy)]
    return []


def _doubt(code: str, joint: str, evidence: str, remedy: str) -> Finding:
    return Finding(code, "warning", joint, evidence, remedy)


def _physics_rate(truth: KnownArm, plan: Excitation, options: LabOptions) -> float:
    """Number of simulation steps per second [Hz]: a multiple of the log's rate with which the springs are stable."""
    poses = plan.at(np.linspace(0.0, plan.period, POSES)).q
    least = max(options.physics_rate, stable_rate(truth, poses))
    rate = options.sensing.rate
    return rate * max(1, math.ceil(least / rate))


def true_model(truth: KnownArm) -> tuple[DynamicsModel, Array]:
    """Model whose parameters have known true values in a simulation, and these true standard parameters (p,)."""
    extra: list[Term] = [Offset()] if truth.friction.offset.any() else []
    extra += [RotorInertia()] if truth.rotor.any() else []
    model = DynamicsModel(truth.robot, (RigidBody(), Viscous(), Coulomb(), *extra))
    friction = truth.friction
    coulomb = friction.coulomb if friction.slip is None else friction.coulomb + friction.slip.torque.sum(axis=0)
    values = {"FV": friction.viscous, "FS": coulomb, "FO": friction.offset, "IA": truth.rotor}
    theta = np.zeros(len(model.parameters))
    theta[model.inertial_columns] = truth.inertial.ravel()
    for k, parameter in enumerate(model.parameters):
        if parameter.symbol in values:
            theta[k] = values[parameter.symbol][parameter.number - 1]
    return model, theta


def truth_record(simulated: Simulated, recording_sha256: str) -> dict[str, Any]:
    """Content of `truth.json`: the simulated arm, and the values that an identification should find."""
    truth, plan = simulated.truth, simulated.plan
    model, theta = true_model(truth)
    base = find_base_parameters(model)
    gain = simulated.gains
    return {
        "robot": truth.robot.name,
        "joints": truth.robot.joint_names,
        "gravity": truth.robot.gravity,
        "recording_sha256": recording_sha256,
        "seed": simulated.seed,
        "plan": {
            "base_frequency": plan.base_frequency,
            "period": plan.period,
            "offset": plan.offset,
            "a": plan.a,
            "b": plan.b,
        },
        "parameters": {p.name: value for p, value in zip(model.parameters, theta, strict=True)},
        "base_parameters": dict(zip(base.names, base.values_of(theta), strict=True)),
        "friction": plain_record(truth.friction),
        "rotor": truth.rotor,
        "stiffness": truth.stiffness,
        "spring_damping": truth.spring_damping,
        "backlash": truth.backlash,
        "controller": None if gain is None else {"kind": simulated.options.controller.kind} | plain_record(gain),
        "effort_limits": simulated.options.drive.limits(truth),
        "options": plain_record(simulated.options),
    }


def plain_record(value: Any) -> Any:
    """Converts a dataclass to a dictionary, including nested dataclasses; a fault also gets the key `kind`."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        table = {f.name: plain_record(getattr(value, f.name)) for f in dataclasses.fields(value)}
        name = getattr(type(value), "name", None)
        return {"kind": name} | table if isinstance(name, str) else table
    if isinstance(value, tuple):
        return [plain_record(each) for each in value]
    return value
