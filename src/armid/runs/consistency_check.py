"""Certification of the parameters of an arm: base, standard or physical parameters, or those of a run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from armid.checked_array import Array
from armid.errors import Finding, ModelError, did_you_mean
from armid.estimation.estimate_record import collapse
from armid.estimation.standard_parameter_resolution import StandardFit
from armid.maths.inertia import com_inertia_to_vector, pseudo_inertia, vector_to_com_inertia
from armid.model.base_parameters import find_base_parameters
from armid.model.dynamics_model import DynamicsModel
from armid.model.motion import Motion
from armid.model.parameter_name import parameter_names
from armid.model.terms import Coulomb, Offset, RigidBody, RotorInertia, Term, Viscous
from armid.notebook_display import Displayed, Summary
from armid.robot import Robot
from armid.robot.missing_inertia import placeholder_masses
from armid.runs.run import Run
from armid.study.plausibility.one_sided_filter import CODE as ONE_SIDED
from armid.validation.distance_to_consistency import Certificate, certify_values
from armid.validation.gravity_sign import gravity_sign_finding
from armid.validation.smallest_mass_matrix import Pose, worst_along, worst_pose
from armid.validation.thesis_constraints import ROUNDING, Constraint, thesis_constraints

HEAVIEST = 10.0
"""Default upper bound of the mass of a link in the nearest consistent parameters [kg], if the description gives no
masses. If only some links of a description have a mass, the default is at least this value."""

HEAVIER = 2.5
"""Default upper bound of the mass of a link in the nearest consistent parameters, divided by the mass of the heaviest
link of the description."""

TERM_OF_SYMBOL: Mapping[str, type[Term]] = {"FV": Viscous, "FS": Coulomb, "FO": Offset, "IA": RotorInertia}
PHYSICAL = ("m", "rx", "ry", "rz", "Ixx", "Ixy", "Ixz", "Iyy", "Iyz", "Izz")
PLAN_RATE = 100.0


@dataclass(frozen=True, eq=False, slots=True, repr=False)
class Verdict(Displayed):
    """Verdict on the physical consistency of a set of parameters.

    Attributes:
        kind: Kind of the parameters: `base`, `standard` or `physical`.
        certificate: Certificate, with the distance to the nearest real body.
        limited: Certificate under the condition that no link is heavier than `heaviest`.
        heaviest: Largest mass of a link in `limited` [kg].
        pose: Pose within the joint limits in which the mass matrix has its smallest eigenvalue.
        along: Pose of the given motion in which the mass matrix has its smallest eigenvalue; `None` without a motion.
        constraints: Check of the constraints (3.52) and (3.53) of the thesis, if the parameters determine them.
        findings: Findings on consistency and gravity.
    """

    kind: str
    certificate: Certificate
    limited: Certificate
    heaviest: float
    pose: Pose
    along: Pose | None
    constraints: tuple[Constraint, ...]
    findings: tuple[Finding, ...]

    def summary(self) -> Summary:
        """Table with the physical consistency, and the distance to the nearest consistent parameters."""
        nearest = self.certificate
        rows = (
            (
                "distance to the nearest consistent parameters",
                f"{nearest.distance:.4g} ({nearest.relative_distance:.3%})",
            ),
            ("masses of links with these parameters", ", ".join(f"{mass:.4g}" for mass in nearest.masses) + " kg"),
            ("mass matrix, smallest eigenvalue", f"{self.pose.min_eigenvalue:.5g} {self.pose.unit}"),
        )
        result = "physically consistent" if nearest.feasible else "not physically consistent"
        note = " ".join(part for each in self.findings for part in (each.evidence, each.remedy) if part)
        return Summary(f"{self.kind} parameters: {result}", ("", ""), rows, note)


def described_values(robot: Robot) -> dict[str, float]:
    """Standard parameters of a description's links, by name.

    Raises:
        ModelError: The description has no inertias.
    """
    model = DynamicsModel(robot, (RigidBody(),))
    theta = model.nominal_parameters()
    if theta is None:
        raise ModelError(
            f"The description of {robot.name} has no masses and inertias, so there are no parameters to check.",
            remedy="give a file of parameters as the second argument (armid certify ROBOT VALUES.json), or the "
            "folder of a run.",
        )
    return {parameter.name: float(value) for parameter, value in zip(model.parameters, theta, strict=True)}


def usual_heaviest(robot: Robot) -> float:
    """Default upper bound of a link's mass [kg]: 2.5 times the heaviest mass, at least 10 kg if a mass is unknown."""
    masses = np.array([0.0 if link.inertial is None else link.inertial.mass for link in robot.links])
    limit = HEAVIER * float(masses.max(initial=0.0))
    return limit if limit > 0.0 and not placeholder_masses(masses).any() else max(limit, HEAVIEST)


def read_plan(name: str) -> Motion:
    """Motion of a built-in plan or of a plan of `armid excite`, sampled at 100 Hz."""
    from armid.study.plans.plan_reading import series_of  # brings the design of plans

    return series_of(name).sample(PLAN_RATE)


def certify_named(
    robot: Robot, values: Mapping[str, float], *, motion: Motion | None = None, heaviest: float | None = None
) -> Verdict:
    """Certifies parameters that are given by name; the torque terms follow from the names.

    Args:
        robot: The arm.
        values: Values by name: base parameters (`ZZR_1`), standard parameters (`ZZ_1`) or physical parameters (`m_1`,
            `rx_1`, `Ixx_1`, …).
        motion: Motion along which the mass matrix is also checked.
        heaviest: Largest mass of a link in the second of the two certificates [kg]; `usual_heaviest` if not given.

    Raises:
        ModelError: The names belong to none of these sets, or the set is incomplete.
    """
    if any(name.symbol in PHYSICAL for name in parameter_names(values)):
        return _physical(robot, values, motion, heaviest)
    model = _model_of(robot, values)
    base = find_base_parameters(model)
    standard_names = [parameter.name for parameter in model.parameters]
    if set(values) == set(base.names):
        given = np.array([values[name] for name in base.names])
        theta = np.zeros(len(standard_names))
        theta[base.kept] = given
        return _verdict("base", model, base.names, given, base.regrouping, theta, motion, heaviest)
    if set(values) != set(standard_names):
        raise _incomplete(robot, values, base.names, standard_names)
    theta = np.array([values[name] for name in standard_names])
    return _verdict("standard", model, standard_names, theta, np.eye(len(theta)), theta, motion, heaviest)


def _incomplete(
    robot: Robot, values: Mapping[str, float], base: Sequence[str], standard: Sequence[str]
) -> ModelError:
    """Error for an incomplete set of parameters; it gives the set to which the names belong and the missing names."""
    known = {*base, *standard}
    if unknown := [name for name in values if name not in known]:
        fault = f"Unknown names: {', '.join(unknown[:8])}."
        named = f"The names are neither the {len(base)} base parameters of {robot.name} nor its standard parameters"
    else:
        alone = set(values) - set(base)  # names that only the standard set has
        wanted, kind = (standard, "standard") if alone else (base, "base")
        named = f"The names are not all of the {len(wanted)} {kind} parameters of {robot.name}"
        lacking = [name for name in wanted if name not in values]
        others = [name for name in values if name not in wanted]
        fault = f"{', '.join((lacking or others)[:8])} {'missing' if lacking else 'not among them'}."
    return ModelError(
        f"{named}: {fault}",
        possible=f"base: {', '.join(base)}; or standard: {', '.join(standard[:10])}, … for every link; or physical: "
        f"{', '.join(f'{symbol}_1' for symbol in PHYSICAL)}, … for every link; with friction FV_1, FS_1, …",
        remedy="run armid base with the same gravity, locks and terms to print the names.",
    )


def certify_run(run: Run, *, motion: Motion | None = None, heaviest: float | None = None) -> Verdict:
    """Certifies the base parameters of a run; if they are inconsistent, a finding explains why."""
    base = run.estimate.base
    values = collapse(base.names, run.estimate.fit)
    theta = np.zeros(len(base.standard_names))
    theta[base.kept] = values
    found = _verdict("base", run.model, base.names, values, base.regrouping, theta, motion, heaviest)
    findings = [] if found.certificate.feasible else [_meaning(run, found)]
    if run.estimate.fit.standard is not None and run.model.has_rigid_bodies:
        findings.append(_own_bodies(run, run.estimate.fit.standard))
    return replace(found, findings=(*found.findings, *findings))


def _own_bodies(run: Run, standard: StandardFit) -> Finding:
    """Finding that the links of the certificate and the links that the run has estimated give the same torque."""
    places = [standard.names.index(f"M_{link + 1}") for link in range(run.model.n)]
    masses = ", ".join(f"{standard.values[k]:.4g}" for k in places)
    evidence = (
        f"The links that the run has estimated have masses of {masses} kg; the smallest eigenvalue of their "
        f"pseudo-inertias is {standard.proof.smallest_eigenvalue:.3g}. The masses of the certificate are "
        "another set with the same base parameters, and therefore with the same torque."
    )
    return Finding("own-bodies", "info", "", evidence)


def _meaning(run: Run, verdict: Verdict) -> Finding:
    """Finding with the reason why the parameters of a run are inconsistent, and with a remedy."""
    fit = run.estimate.fit
    half: dict[str, float] = dict(zip(fit.names, 0.5 * np.ptp(fit.intervals, axis=1), strict=True))
    beyond = [each.name for each in verdict.certificate.blame if abs(each.change) > half.get(each.name, np.inf)]
    why = "the nearest consistent parameters lie within the 95 % intervals, so noise can be the cause"
    remedy = "use the model only for torques along motions similar to the recorded ones"
    if beyond:
        outside = f"{', '.join(beyond[:4])} outside the 95 % intervals"
        why = f"the nearest consistent parameters have {outside}, so noise is not the only cause"
        remedy = "check the recordings with armid doctor, and the residuals in the report; " + remedy
    for biased in (each for each in run.estimate.findings if each.code == ONE_SIDED):
        why = "only the torque was filtered, not the columns of the regressor; this bias, not noise, is the cause"
        remedy = biased.remedy.rstrip(".")
    if fit.standard is None:
        remedy += "; identify with --method physical, which keeps links physically consistent"
    evidence = f"the method {run.estimate.method} fits the torque without physical constraints on the links"
    if fit.standard is not None:
        evidence = "The estimate is consistent up to rounding"
    return Finding("what-it-means", "info", "", f"{evidence}; {why}.", f"{remedy}.")


def verdict_record(verdict: Verdict) -> dict[str, Any]:
    """JSON object that `armid certify --json` prints."""
    certificate = verdict.certificate

    def pose(of: Pose) -> dict[str, Any]:
        return {"min_eigenvalue": of.min_eigenvalue, "unit": of.unit, "q": of.q}

    matrix = pose(verdict.pose)
    if verdict.along is not None:
        matrix["along"] = pose(verdict.along)
    return {
        "kind": verdict.kind,
        "feasible": certificate.feasible,
        "distance": certificate.distance,
        "relative_distance": certificate.relative_distance,
        "blame": [{"name": each.name, "change": each.change} for each in certificate.blame],
        "nearest": {"masses": certificate.masses, "total_mass": float(certificate.masses.sum())},
        "with_mass_limit": {
            "heaviest": verdict.heaviest,
            "distance": verdict.limited.distance,
            "masses": verdict.limited.masses,
        },
        "gap": certificate.gap,
        "mass_matrix": matrix,
        "thesis_constraints": [
            {
                "constraint": c.constraint,
                "link": c.link,
                "value": c.value,
                "bound": c.bound,
                "ok": c.ok,
                "within_rounding": c.rounding,
            }
            for c in verdict.constraints
        ],
        "findings": [
            {"code": f.code, "severity": f.severity, "evidence": f.evidence, "remedy": f.remedy}
            for f in verdict.findings
        ],
    }


def _model_of(robot: Robot, values: Mapping[str, float]) -> DynamicsModel:
    """Model of the arm with the torque terms to which the names of the given parameters belong."""
    symbols = {name.symbol for name in parameter_names(values)}
    terms: list[Term] = [RigidBody(), *(term() for symbol, term in TERM_OF_SYMBOL.items() if symbol in symbols)]
    return DynamicsModel(robot, tuple(terms))


def _physical(robot: Robot, values: Mapping[str, float], motion: Motion | None, heaviest: float | None) -> Verdict:
    """Certifies physical parameters, after their conversion to standard parameters about the link frames."""
    friction = {name.upper(): values[name] for name in parameter_names(values) if name.symbol not in PHYSICAL}
    wanted = [f"{symbol}_{k + 1}" for k in range(robot.n) for symbol in PHYSICAL]
    missing = [name for name in wanted if name not in values]
    unknown = sorted(set(values) - set(wanted) - {name for name in values if name.upper() in friction})
    if missing or unknown:
        raise ModelError(
            f"The given names are not those of the physical parameters of {robot.name}: "
            f"{', '.join((missing or unknown)[:8])} {'missing' if missing else 'not known'}.",
            possible=", ".join(wanted[:10]) + ", … for every link; Fv_1, Fs_1, …",
            remedy="add the missing parameters." if missing else did_you_mean(unknown[0], wanted),
        )
    model = _model_of(robot, friction)
    theta = np.zeros(len(model.parameters))
    masses, tensors = np.zeros(robot.n), np.zeros((robot.n, 3, 3))
    for k, own in enumerate(model.inertial_columns.reshape(-1, 10)):
        m, rx, ry, rz, xx, xy, xz, yy, yz, zz = (values[f"{symbol}_{k + 1}"] for symbol in PHYSICAL)
        masses[k], tensors[k] = m, np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        theta[own] = com_inertia_to_vector(m, np.array([rx, ry, rz]), tensors[k])
    names = [parameter.name for parameter in model.parameters]
    for k, name in enumerate(names):
        if name in friction:
            theta[k] = friction[name]
    return _verdict("physical", model, names, theta, np.eye(len(theta)), theta, motion, heaviest, (masses, tensors))


def _rounding(masses: Array, tensors: Array) -> float:
    """Largest rounding error of given masses and inertias: that of three decimals if no value has more, else zero."""
    thousandths = np.concatenate([masses.ravel(), tensors.ravel()]) / (2.0 * ROUNDING)
    return ROUNDING if np.allclose(thousandths, np.round(thousandths), rtol=0.0, atol=1e-6) else 0.0


def _verdict(
    kind: str,
    model: DynamicsModel,
    names: Any,
    values: Array,
    linear: Array,
    theta: Array,
    motion: Motion | None,
    heaviest: float | None,
    about_com: tuple[Array, Array] | None = None,
) -> Verdict:
    heaviest = usual_heaviest(model.robot) if heaviest is None else heaviest
    certificate = certify_values(model, names, values, linear)
    limited = certify_values(model, names, values, linear, heaviest=heaviest)
    pose = worst_pose(model, theta)
    along = None if motion is None else worst_along(model, theta, motion)
    if kind == "standard" and (theta[model.inertial_columns[::10]] > 0.0).all():
        split = [vector_to_com_inertia(theta[own]) for own in model.inertial_columns.reshape(-1, 10)]
        about_com = np.array([part[0] for part in split]), np.array([part[2] for part in split])
    constraints = () if about_com is None else thesis_constraints(*about_com, _rounding(*about_com))
    return Verdict(
        kind,
        certificate,
        limited,
        heaviest,
        pose,
        along,
        constraints,
        _findings(kind, model, certificate, limited, heaviest, pose, theta),
    )


def _findings(
    kind: str,
    model: DynamicsModel,
    certificate: Certificate,
    limited: Certificate,
    heaviest: float,
    pose: Pose,
    theta: Array,
) -> tuple[Finding, ...]:
    """Findings of a certificate, without the mass of the nearest body, which the torques do not determine."""
    findings: list[Finding] = []
    if not certificate.feasible:
        worst = ", ".join(f"{each.name} by {each.change:+.3g}" for each in certificate.blame[:4])
        findings.append(
            Finding(
                "not-physical",
                "error",
                "",
                "No links with positive density have these parameters. The distance to the nearest "
                f"consistent parameters is {certificate.distance:.4g} "
                f"({100 * certificate.relative_distance:.3g} %), mostly in {worst}; it is "
                f"{limited.distance:.4g} if no link may be heavier than {heaviest:g} kg.",
                "do not use these parameters in a simulation or in an exported description.",
            )
        )
    if kind != "base":
        for k, own in enumerate(model.inertial_columns.reshape(-1, 10)):
            smallest = float(np.linalg.eigvalsh(pseudo_inertia(theta[own]))[0])
            if smallest < 0.0:
                evidence = (
                    "The pseudo-inertia of the link is not positive definite: its smallest eigenvalue is "
                    f"{smallest:.3g}."
                )
                findings.append(Finding("link-not-physical", "error", model.robot.links[k].name, evidence))
    if pose.min_eigenvalue <= 0.0:
        smallest = pose.min_eigenvalue
        evidence = f"The mass matrix is not positive definite everywhere: its smallest eigenvalue is {smallest:.3g}."
        findings.append(Finding("mass-matrix-indefinite", "error", "", evidence))
    elif not certificate.feasible:
        evidence = (
            "The mass matrix is positive definite within the joint limits (smallest eigenvalue "
            f"{pose.min_eigenvalue:.4g}), although no links with positive density have these parameters: a "
            "positive definite mass matrix is necessary, but not sufficient."
        )
        findings.append(Finding("mass-matrix-positive", "info", "", evidence))
    base = find_base_parameters(model)
    suspicion = gravity_sign_finding(base, base.values_of(theta))
    return tuple(findings if suspicion is None else [*findings, suspicion])
