"""Consistent estimates: what constraints, priors and statuses do, and what is refused."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from armid.checked_array import Array
from armid.dataclass_files import load, save
from armid.errors import EstimationError
from armid.estimation.consistency import consistent_fit
from armid.estimation.estimate_record import Estimate, standard_parameters, torque_parameters
from armid.estimation.estimators import LogCholesky, PhysicallyConsistent, ThesisNLP, WeightedLeastSquares
from armid.estimation.fit_result import Fit
from armid.estimation.friction_per_recording import separate_by_recording, standard_per_recording
from armid.estimation.prior import SLIMMEST, THINNEST, make_prior, smallest_radius
from armid.estimation.problem import EstimationProblem, standard_of
from armid.estimation.standard_parameter_resolution import IDENTIFIED, UNSEEN, StandardFit, shares, status_of
from armid.estimation.uncertainty.covariance import estimate_covariance
from armid.estimation.whitened_system import whiten
from armid.information.accumulate import accumulate_information
from armid.maths.barrier_function import Smooth
from armid.maths.inertia import com_inertia_to_vector, pseudo_inertia, vector_from_pseudo_inertia
from armid.model.base_parameters import find_base_parameters
from armid.model.dynamics_model import DynamicsModel
from armid.model.motion import Motion
from armid.model.terms import Coulomb, Viscous
from armid.robot.missing_inertia import PLACEHOLDER, placeholder_masses
from labs import small_model_with_rotors as model
from labs import small_truth_with_rotors as truth
from problems import lively_motion, one_run, raw
from trees import random_rotation

RATE, NOISE = 50.0, 0.2

CONE = 0.03
"""Most that the cone narrows a deviation of data that determine bodies: a light link's inertia is some ten to twenty
deviations from its border."""

ALIKE = 1e-3
"""Difference of two searches over a deviation: a gap of 1e-9 is ten times less where objectives are some hundreds."""

SCATTER = 0.15
"""Difference of deviations from blocks, too few to say them better than to 20 %, when the estimate moves a little."""

FARTHEST = 4.0
"""Deviations from the truth that none of some twenty parameters reaches but by a chance of a thousandth."""

FAR = 20.0
"""Factor between masses from which on one has nothing to do with the other."""


def problem_of(
    *, noise: float = NOISE, rotor: float = 0.05, moving: tuple[float, ...] = (1.0, 1.0, 1.0), recordings: int = 1
) -> EstimationProblem:
    """Recordings of the small arm, whose description says what it is but for friction and rotors."""
    base = find_base_parameters(model())
    theta = truth().copy()
    theta[[name.startswith("IA") for name in names()]] = rotor
    parts = []
    for k in range(recordings):
        motion = lively_motion(np.random.default_rng(1 + k), model().n, RATE, 12.0)
        motion = Motion(motion.time, motion.q * moving, motion.dq * moving, motion.ddq * moving)
        theta[[name.startswith("FV") for name in names()]] = 1.5 + k
        torque = model().torque(motion, theta)
        torque = torque + noise * np.random.default_rng(9 + k).normal(size=torque.shape)
        parts.append(replace(one_run(motion, torque, RATE), recording=k))
    return EstimationProblem(
        accumulate_information(model(), base, raw(*parts)), standard_of(model(), base), model(), base
    )


def names() -> list[str]:
    return [parameter.name for parameter in model().parameters]


def estimate(problem: EstimationProblem | None = None, **options: object) -> tuple[Fit, StandardFit]:
    fit = PhysicallyConsistent(**options).solve(problem or problem_of())  # pyright: ignore[reportArgumentType]
    assert fit.standard is not None
    return fit, fit.standard


def value(fit: StandardFit, name: str) -> float:
    return float(fit.values[fit.names.index(name)])


# What the data say ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("prior", ["auto", "mass"])
def test_data_that_determine_bodies_are_not_bent(prior: str):
    problem = problem_of()
    fit, standard = estimate(problem, prior=prior)
    free = WeightedLeastSquares().solve(problem)
    assert (np.abs(fit.values - free.values) < 0.05 * free.deviation).all()
    assert 0.0 <= standard.proof.cost_increase < 0.005
    np.testing.assert_allclose(fit.deviation, free.deviation, rtol=CONE)
    assert {finding.code for finding in fit.findings} <= {"prior-weight"}


@pytest.mark.parametrize("prior", ["mass", "log-det", "euclidean", "none"])
def test_rotors_that_data_push_below_zero_stay_there_and_it_is_said(prior: str):
    """A torque that lags makes rotor inertia negative, and a mass matrix with it indefinite."""
    fit, standard = estimate(problem_of(rotor=-0.3), prior=prior, weight=1.0)
    rotors = standard.values[[name.startswith("IA") for name in standard.names]]
    assert (rotors >= 0.0).all() and rotors.min() < 1e-6
    M = model().mass_matrix(np.random.default_rng(0).uniform(-3, 3, (200, 3)), standard.values)
    assert np.linalg.eigvalsh(M).min() > 0.0
    said = {finding.code: finding for finding in fit.findings}
    assert "IA_" in said["held-at-zero"].evidence
    held = standard.names.index("IA_1")
    assert standard.status[held] != "identified" or standard.values[held] > 1e-6


def test_no_run_weighs_links_but_friction_and_what_stands_alone_is_identified():
    _, standard = estimate(prior="mass")
    status = dict(zip(standard.names, standard.status, strict=True))
    assert {status[name] for name in ("FV_1", "FS_2", "MX_3")} == {"identified"}
    assert {status[name] for name in ("M_1", "M_2", "M_3", "XX_1", "MZ_1")} == {"not identifiable"}
    assert {name for name, s in status.items() if s == "identified"} <= {
        name for name, share in zip(standard.names, standard.resolution, strict=True) if share >= IDENTIFIED
    }


def test_resolution_is_the_share_of_the_data():
    """Two parameters of which the data see the sum: each is half of the prior's, which is the same for both."""
    information, precision = 1e6 * np.ones((2, 2)), np.eye(2)
    covariance, share = shares(information, precision)
    np.testing.assert_allclose(share, 0.5, rtol=1e-5)
    np.testing.assert_allclose(covariance, np.linalg.inv(information + precision), rtol=1e-6)
    np.testing.assert_allclose(shares(np.diag([99.0, 0.01]), precision)[1], [0.99, 0.01 / 1.01])


@pytest.mark.parametrize("prior", ["log-det", "euclidean"])
@pytest.mark.parametrize("weight", [1.0, 100.0])
def test_what_is_identified_does_not_follow_another_description(prior: str, weight: float):
    """Bodies of the description that are all 20 % heavier, two deviations of the prior of weight 100."""
    problem = problem_of()
    assert problem.standard is not None and problem.standard.nominal is not None
    other = replace(problem.standard, nominal=1.2 * problem.standard.nominal)
    _, first = estimate(problem, prior=prior, weight=weight)
    _, second = estimate(replace(problem, standard=other), prior=prior, weight=weight)
    moved = np.abs(second.values - first.values) / (0.5 * np.diff(first.intervals, axis=1)[:, 0])
    identified = np.array(first.status) == "identified"
    assert identified.sum() >= 10
    assert (moved[identified] < 1.0).all()


def test_status():
    share = np.array([1.0, IDENTIFIED, 0.5, 0.5 * UNSEEN, 1.0, 1.0])
    given, held = np.array([0, 0, 0, 0, 1, 0], bool), np.array([0, 0, 0, 0, 0, 1], bool)
    told = status_of(share, True, given, held)
    assert told == ("identified", "identified", "prior-dominated", "not identifiable", *["prior-dominated"] * 2)
    assert status_of(share, False, given, held)[2] == "not identifiable"  # the cone alone determines nothing


def test_intervals_contain_the_truth_and_nothing_unphysical():
    _, standard = estimate(prior="log-det", weight=1.0)
    low, high = standard.intervals.T
    assert ((low <= truth()) & (truth() <= high)).mean() > 0.9
    positive = [name.split("_")[0] in ("M", "XX", "YY", "ZZ", "FV", "FS", "IA") for name in standard.names]
    assert (low[positive] >= 0.0).all()


# Priors ---------------------------------------------------------------------------------------------------------


def test_a_mass_prior_leaves_no_tons():
    """Bodies are as small as the data allow: no heavier than the true ones, which the data allow too."""
    _, light = estimate(prior="mass")
    masses = light.values[[name.startswith("M_") for name in names()]]
    assert 0.0 < masses.sum() < 6.5  # the arm weighs six kilograms


def test_the_prior_is_that_of_the_description_where_it_has_bodies_and_mild():
    """A link of a microgram, as the smallest bodies have them, is none that anybody can use."""
    problem = problem_of()
    standard = problem.require_standard("physical")
    _, found = estimate(problem)
    assert (found.prior.kind, found.prior.weight) == ("log-det", 1.0) and not found.prior.trials
    _, given = estimate(problem, prior="log-det", weight=1.0)
    np.testing.assert_array_equal(found.values, given.values)
    masses = standard.inertial[:, 0]
    described = truth()[masses]
    assert (found.values[masses] > described / FAR).all() and (found.values[masses] < described * FAR).all()
    assert estimate(problem, prior="mass")[1].values[masses].min() < described.min() / FAR
    for nominal in (None, np.where(np.arange(len(truth())) == masses[0], 0.0, truth())):
        _, other = estimate(replace(problem, standard=replace(standard, nominal=nominal)))
        assert other.prior.kind == "mass"


@pytest.mark.parametrize("prior", ["log-det", "euclidean"])
def test_what_data_do_not_see_is_the_descriptions(prior: str):
    """Only the last joint moves, so the first links are what the description says; friction of others is
    nothing."""
    fit, standard = estimate(problem_of(moving=(0.0, 0.0, 1.0)), prior=prior, weight=1.0)
    for name in ("M_1", "XX_1", "MZ_1", "ZZ_1"):
        assert value(standard, name) == pytest.approx(truth()[names().index(name)], rel=1e-3, abs=1e-4)
    assert value(standard, "FV_1") == pytest.approx(0.0, abs=1e-3)
    (said,) = [finding for finding in fit.findings if finding.code == "prior-dominated"]
    assert "FV_1" in said.evidence and "FV_3" not in said.evidence
    assert fit.prior_precision is not None and np.linalg.eigvalsh(fit.prior_precision).min() > 0.0
    assert np.isfinite(fit.covariance).all()


def test_a_stronger_prior_comes_nearer_to_the_description():
    problem = problem_of()
    wrong = problem.standard
    assert wrong is not None and wrong.nominal is not None
    wrong = replace(wrong, nominal=1.5 * wrong.nominal)
    problem = replace(problem, standard=wrong)
    far = [divergence(replace(problem, standard=wrong), weight) for weight in (0.1, 10.0, 1e3, 1e5)]
    assert (np.diff(far) < 0.0).all() and far[-1] < 0.3 * far[0]


def divergence(problem: EstimationProblem, weight: float) -> float:
    """Log-det divergence of the estimate from the description, all links together."""
    _, standard = estimate(problem, prior="log-det", weight=weight)
    assert problem.standard is not None and problem.standard.nominal is not None
    found, nominal = (
        pseudo_inertia(v[problem.standard.inertial]) for v in (standard.values, problem.standard.nominal)
    )
    ratio = np.linalg.solve(nominal, found)
    return float((np.trace(ratio, axis1=1, axis2=2) - np.linalg.slogdet(ratio)[1] - 4.0).sum())


def test_the_weight_is_chosen_by_what_it_predicts():
    """A description that is right may weigh much, one that is wrong must not."""
    problem = problem_of(noise=3.0)
    right = problem.standard
    assert right is not None and right.nominal is not None
    wrong = replace(problem, standard=replace(right, nominal=3.0 * right.nominal))
    weights = [estimate(each, prior="log-det")[1].prior for each in (problem, wrong)]
    assert weights[0].weight > 5.0 * weights[1].weight
    assert len(weights[0].trials) > 5 and "folds" in weights[0].how
    errors = [trial.error for trial in weights[0].trials]
    assert np.isfinite(errors).all()


def test_where_a_search_starts_does_not_matter(monkeypatch: pytest.MonkeyPatch):
    """From the description, or from what a conic program finds where that is too far."""
    fit, found = estimate(prior="log-det")
    monkeypatch.setattr(consistent_fit, "SHORT", 0)
    again, other = estimate(prior="log-det")
    assert (np.abs(fit.values - again.values) <= ALIKE * fit.deviation).all()
    np.testing.assert_allclose(found.intervals, other.intervals, rtol=0, atol=ALIKE * found.deviation.max())
    assert found.status == other.status and found.proof.cost_increase == pytest.approx(
        other.proof.cost_increase, rel=ALIKE
    )


def test_log_det_does_not_depend_on_frames():
    """Turning and moving every link's frame changes the divergence from the description by nothing."""
    rng = np.random.default_rng(0)
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = random_rotation(rng), rng.normal(size=3)
    problem = problem_of()
    standard = problem.standard
    assert standard is not None and standard.nominal is not None
    values = standard.nominal.copy()
    values[standard.inertial] = standard.nominal[standard.inertial[[2, 0, 1]]]

    def seen(theta: Array) -> Array:
        result = theta.copy()
        result[standard.inertial] = vector_from_pseudo_inertia(T @ pseudo_inertia(theta[standard.inertial]) @ T.T)
        return result

    def cost(nominal: Array, theta: Array) -> float:
        belief = make_prior("log-det", replace(standard, nominal=nominal), whiten(problem.information))
        p = len(theta)
        terms = belief.log_det(standard, np.zeros(p), np.eye(p), 2.0)
        return Smooth(np.zeros((0, p)), np.zeros(0), terms, (), np.zeros(p)).objective(theta)

    assert cost(standard.nominal, values) > 1.0
    assert cost(seen(standard.nominal), seen(values)) == pytest.approx(cost(standard.nominal, values), rel=1e-6)
    assert cost(standard.nominal, standard.nominal) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(
    ("inertia", "severity", "what"),
    [
        (-0.01, "warning", "no real body"),
        (0.0, "info", "without thickness"),
        (2.0 * 0.008**2, "info", "radius of gyration of 8 mm, less than"),
    ],
)
def test_a_description_that_is_no_body_is_moved_to_the_nearest_and_named(inertia: float, severity: str, what: str):
    problem = problem_of()
    standard = problem.standard
    assert standard is not None and standard.nominal is not None
    nominal = standard.nominal.copy()
    second = np.diag([inertia, 0.02, 0.03])  # second moments about the centre of mass
    tensor = np.trace(second) * np.eye(3) - second
    nominal[standard.inertial[1]] = com_inertia_to_vector(2.0, np.array([0.1, 0.0, 0.0]), tensor)
    fit, _ = estimate(replace(problem, standard=replace(standard, nominal=nominal)), prior="log-det", weight=1.0)
    (said,) = [finding for finding in fit.findings if finding.code == "nominal-projected"]
    assert (said.channel, said.severity) == ("link_2", severity)
    assert f"{1000 * THINNEST:g} mm" in said.evidence and what in said.evidence


@pytest.mark.parametrize("size", [0.1, 0.3, 1.0, 10.0])
def test_the_links_of_a_small_arm_may_be_thinner(size: float):
    standard = problem_of().standard
    assert standard is not None and standard.nominal is not None
    nominal = standard.nominal.copy()
    nominal[standard.inertial] *= np.concatenate([[1.0], np.full(3, size), np.full(6, size**2)])
    scaled = replace(standard, nominal=nominal)
    J = pseudo_inertia(standard.nominal[standard.inertial])
    whole = np.sqrt(np.trace(J[:, :3, :3], axis1=1, axis2=2).sum() / J[:, 3, 3].sum())
    assert smallest_radius(scaled) == pytest.approx(min(THINNEST, SLIMMEST * size * whole), rel=1e-12)
    assert smallest_radius(replace(standard, nominal=None)) == THINNEST


def placeholder_problem(mass: float) -> EstimationProblem:
    """Recordings of the small arm, whose description fills the last link with a placeholder as simulators demand."""
    problem = problem_of()
    standard = problem.standard
    assert standard is not None and standard.nominal is not None
    nominal = standard.nominal.copy()
    nominal[standard.inertial[-1]] = com_inertia_to_vector(mass, np.zeros(3), 4e-4 * mass * np.eye(3))
    return replace(problem, standard=replace(standard, nominal=nominal))


@pytest.mark.parametrize("mass", [1e-9, 1e-6, 1e-3])
def test_a_placeholder_says_nothing_of_its_link_and_spoils_no_interval(mass: float):
    problem = placeholder_problem(mass)
    assert problem.base is not None
    fit, standard = estimate(problem)
    covered, free = (estimate_covariance(each, problem) for each in (fit, WeightedLeastSquares().solve(problem)))
    np.testing.assert_allclose(covered.deviation, free.deviation, rtol=SCATTER)
    theta = truth().copy()
    theta[[name.startswith("IA") for name in names()]] = 0.05
    theta[[name.startswith("FV") for name in names()]] = 1.5
    off = fit.values - problem.base.regrouping @ theta
    assert (np.abs(off) < FARTHEST * covered.deviation).all()
    (said,) = [finding for finding in fit.findings if finding.code == "nominal-projected"]
    assert said.channel == "link_3" and "placeholder" in said.evidence
    assert min(value(standard, f"M_{k}") for k in (1, 2, 3)) > PLACEHOLDER


def test_links_of_small_arms_are_no_placeholders():
    assert not placeholder_masses(np.array([0.02, 0.01, 0.003])).any()
    assert not placeholder_masses(np.array([100.0, 40.0, 0.1])).any()
    assert list(placeholder_masses(np.array([1.2, 0.7, 0.001]))) == [False, False, True]
    assert not placeholder_masses(np.full(3, 1e-9)).any()


def test_a_description_without_masses_gives_no_prior():
    problem = problem_of()
    standard = problem.standard
    assert standard is not None and standard.nominal is not None
    without = replace(standard, nominal=None)
    with pytest.raises(EstimationError, match="none"):
        estimate(replace(problem, standard=without), prior="log-det")
    estimate(replace(problem, standard=without))  # the default needs no description
    nothing = standard.nominal.copy()
    nothing[standard.inertial[2]] = 0.0
    with pytest.raises(EstimationError, match="link link_3"):
        estimate(replace(problem, standard=replace(standard, nominal=nothing)), prior="euclidean")


# Constraints ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("prior", ["mass", "log-det"])
def test_constraints_are_kept(prior: str):
    inside, outside = [-0.05, -0.05, -0.05], [0.05, 0.05, 0.12]
    corners = [[x, y, z] for x in (-0.1, 0.1) for y in (-0.1, 0.1) for z in (0.0, 0.1)]
    _, standard = estimate(
        prior=prior,
        weight=1.0,
        heaviest=4.0,
        total_mass=(7.0, 7.5),
        masses={"3": [1.2, 1.4]},
        com={"2": [inside, outside], "1": corners},
        equal=(["XX_1", "YY_1"],),
        fixed={"XY_3": 0.0},
        epsilon=1e-4,
    )
    v = {name: value(standard, name) for name in standard.names}
    masses = np.array([v[f"M_{k}"] for k in (1, 2, 3)])
    room = 1e-6  # of the solver
    assert (masses <= 4.0 + room).all() and 7.0 - room <= masses.sum() <= 7.5 + room
    assert 1.2 - room <= v["M_3"] <= 1.4 + room
    com = np.array([v["MX_2"], v["MY_2"], v["MZ_2"]]) / v["M_2"]
    assert (com >= np.array(inside) - room).all() and (com <= np.array(outside) + room).all()
    first = np.array([v["MX_1"], v["MY_1"], v["MZ_1"]]) / v["M_1"]
    assert (np.abs(first[:2]) <= 0.1 + room).all() and -room <= first[2] <= 0.1 + room
    assert v["XX_1"] == pytest.approx(v["YY_1"], abs=1e-12) and v["XY_3"] == 0.0
    assert standard.proof.smallest_eigenvalue >= 1e-4
    assert standard.status[standard.names.index("XY_3")] == "prior-dominated"
    assert standard.deviation[standard.names.index("XY_3")] == 0.0


def test_a_mass_at_a_limit_of_the_study_is_the_studys_and_not_identified():
    """The other two links known, the data weigh the third; the study takes a tenth off what they say."""
    free = estimate(known=(1, 2))[1]
    assert free.status[free.names.index("M_3")] == "identified"
    for limit in ({"masses": {"3": [0.5, 0.9]}}, {"heaviest": 3.0, "masses": {"3": [1.1, 2.0]}}):
        fit, standard = estimate(known=(1, 2), **limit)
        assert standard.status[standard.names.index("M_3")] == "prior-dominated"
        said = {finding.code: finding.evidence for finding in fit.findings}
        assert said["held-at-limit"] == "These parameters are at limits that the study sets: M_3."
    wide, _ = estimate(known=(1, 2), masses={"3": [0.5, 2.0]})
    assert "held-at-limit" not in {finding.code for finding in wide.findings}


def test_what_bodies_hold_far_from_the_data_is_not_identified():
    """A centre of mass that a box keeps from where it is; where bodies have made the torque nothing is held."""
    _, free = estimate(known=(1, 2))
    held, boxed = estimate(known=(1, 2), com={"3": [[-0.01, -0.01, -0.01], [0.01, 0.01, 0.01]]})
    moments = [boxed.names.index(name) for name in ("MX_3", "MY_3", "MZ_3")]
    off = [k for k in moments if free.status[k] == "identified"]
    off = [k for k in off if abs(boxed.values[k] - free.values[k]) > 10.0 * free.deviation[k]]
    assert off and all(boxed.status[k] == "prior-dominated" for k in off)
    said = {finding.code: finding.evidence for finding in held.findings}
    assert all(boxed.names[k] in said["held-inside"] for k in off)
    for prior in ("none", "log-det"):
        fit, _ = estimate(prior=prior)
        assert "held-inside" not in {finding.code for finding in fit.findings}


def test_known_links_are_as_described():
    _, standard = estimate(known=(3,), prior="none")
    own = model().inertial_columns.reshape(-1, 10)[2]
    np.testing.assert_array_equal(standard.values[own], truth()[own])


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"prior": "entropy"}, "entropy"),
        ({"weight": -1.0}, "weight"),
        ({"epsilon": 0.0}, "epsilon"),
        ({"heaviest": "much"}, "heaviest"),
        ({"masses": {"9": [1.0, 2.0]}}, "9"),
        ({"masses": {"1": [2.0, 1.0]}}, "masses"),
        ({"total_mass": (5.0,)}, "total_mass"),
        ({"com": {"1": [[0, 0, 0], [1, 1]]}}, "com"),
        ({"com": {"1": [[0, 0, 0], [0, 1, 1]]}}, "no volume"),
        ({"com": {"1": [[0, 0, 0], [0, 1, 0], [1, 0, 0], [1, 1, 0]]}}, "plane"),
        ({"equal": (["XX_1"],)}, "equal"),
        ({"equal": ("XX_1",)}, "equal"),
        ({"equal": (["XX_1", "M_2"],)}, "kg·m², kg"),
        ({"fixed": {"QQ_1": 1.0}}, "QQ_1"),
        ({"fixed": {"XX_1": "one"}}, "XX_1"),
        ({"fixed": [1.0]}, "fixed"),
        ({"known": (7,)}, "7"),
        ({"fixed": {"FV_1": -1.0}}, "FV_1 = -1"),
        ({"fixed": {name: -1.0 for name in ("M_1", "MX_1", "MY_1", "MZ_1")}, "prior": "mass"}, "."),
    ],
)
def test_what_cannot_be_asked_is_refused(options: dict[str, object], said: str):
    with pytest.raises(EstimationError) as caught:
        estimate(**options)
    assert said in str(caught.value)


@pytest.mark.parametrize(
    ("options", "named", "unnamed"),
    [
        (
            {"total_mass": (50.0, 60.0), "heaviest": 4.0, "masses": {"1": [1.0, 2.0]}},
            ("total_mass", "heaviest"),
            "masses",
        ),
        (
            {"masses": {"1": [3.0, 5.0], "2": [1.0, 2.0]}, "equal": (("M_1", "M_2"),), "heaviest": 50.0},
            ("masses = { 1 = [3, 5] }", "masses = { 2 = [1, 2] }", "equal"),
            "heaviest",
        ),
        (
            {"fixed": {"M_1": 0.5, "XY_2": 0.0}, "masses": {"1": [1.0, 2.0]}},
            ("fixed = { M_1 = 0.5 }", "masses"),
            "XY_2",
        ),
    ],
)
def test_requirements_that_leave_no_body_are_named_and_no_others(
    options: dict[str, object], named: tuple[str, ...], unnamed: str
):
    with pytest.raises(EstimationError) as caught:
        estimate(**options)
    assert all(each in caught.value.problem for each in named)
    assert unnamed not in caught.value.problem


def test_a_parameter_given_twice_is_refused():
    with pytest.raises(EstimationError, match="M_2 is given twice"):
        estimate(known=(2,), fixed={"M_2": 1.0})


# Records --------------------------------------------------------------------------------------------------------


def test_the_estimate_keeps_its_bodies(tmp_path: Path):
    problem = problem_of()
    fit, standard = estimate(problem, prior="log-det")
    assert problem.base is not None
    whole = Estimate("small", "physical", (), problem.base, fit)
    kept = load(Estimate, save(whole, tmp_path / "estimate.npz"))
    assert kept.fit.standard is not None and kept.fit.standard.prior == standard.prior
    assert kept.fit.standard.proof == standard.proof and kept.fit.standard.status == standard.status
    np.testing.assert_array_equal(torque_parameters(kept.base, kept.fit), standard.values)
    records = {record["name"]: record for record in standard_parameters(kept)}
    assert list(records) == names()
    assert records["M_2"]["status"] == "not identifiable" and records["M_2"]["unit"] == "kg"
    assert {each["interval95"] is None for each in records.values() if each["status"] == "not identifiable"} == {True}
    assert all(each["interval95"] for each in records.values() if each["status"] != "not identifiable")
    low, high = records["FV_1"]["interval95"]
    assert low < 1.5 < high and records["FV_1"]["status"] == "identified"


def test_friction_of_each_recording_has_a_body_in_common():
    problem = problem_of(recordings=2)
    assert problem.base is not None and problem.standard is not None
    own = np.array([name.startswith(("FV", "FS")) for name in problem.base.names])
    apart = replace(problem, information=separate_by_recording(problem.information, own))
    standard = standard_per_recording(problem.standard, problem.base, apart.information)
    assert standard.regrouping.shape == (apart.information.count, len(standard.names))
    assert [name for name in standard.names if name.startswith("FV_1")] == ["FV_1[1]", "FV_1[2]"]
    fit, found = estimate(apart)
    assert fit.names == apart.information.names
    assert value(found, "FV_2[1]") == pytest.approx(1.5, abs=0.1)
    assert value(found, "FV_2[2]") == pytest.approx(2.5, abs=0.1)
    theta = torque_parameters(problem.base, fit)
    assert theta[names().index("FV_2")] == pytest.approx(2.0, abs=0.1)
    assert theta.shape == (len(names()),)


# Other ways to physical parameters ------------------------------------------------------------------------------


def test_factors_come_to_the_same_bodies():
    problem = problem_of(rotor=-0.1)  # at the border of the cone
    convex, _ = estimate(problem, prior="mass")
    found = LogCholesky().solve(problem)
    assert found.standard is not None and found.standard.proof.smallest_eigenvalue > 0.0
    assert (np.abs(found.values - convex.values) < 0.05 * convex.deviation).all()


def test_the_thesis_constraints_are_kept_and_do_not_make_a_body():
    pytest.importorskip("casadi")
    problem = problem_of()
    fit = ThesisNLP(starts=1, long=((), ())).solve(problem)
    assert fit.standard is not None
    for own in model().inertial_columns.reshape(-1, 10):
        m, mx, my, mz, *_ = theta = fit.standard.values[own]
        com = np.array([mx, my, mz]) / m
        J = pseudo_inertia(theta)
        second = J[:3, :3] - m * np.outer(com, com)
        tensor = np.trace(second) * np.eye(3) - second
        axes, room = np.sort(np.diag(tensor)), 1e-6
        products = np.abs(tensor[np.triu_indices(3, 1)]).max()
        assert 0.05 - room <= m <= 15.0 + room and (np.abs(com) <= 0.5 + room).all()
        assert axes[0] + axes[1] >= axes[2] - room and 100.0 * axes[0] >= axes[2] - room  # (3.53a), (3.53b)
        assert 0.1 * axes[0] >= products - room and axes[0] >= 1e-4 - room  # (3.53c), (3.53d)
    free = ThesisNLP(constraints=(), starts=1).solve(problem_of(noise=20.0))
    assert free.standard is not None and free.standard.proof.smallest_eigenvalue < 0.0
    assert "not-physical" in {finding.code for finding in free.findings}


@pytest.mark.parametrize("options", [{"constraints": ("3.54",)}, {"mass": (1.0,)}, {"starts": 0}, {"long": ((1,),)}])
def test_thesis_options_are_checked(options: dict[str, object]):
    with pytest.raises(EstimationError):
        ThesisNLP(**options)  # pyright: ignore[reportArgumentType]


def test_without_ipopt_the_extra_is_named(monkeypatch: pytest.MonkeyPatch):
    import sys

    monkeypatch.setitem(sys.modules, "casadi", None)
    with pytest.raises(Exception, match=r"armid\[nlp\]"):
        ThesisNLP().solve(problem_of())


def test_a_model_without_bodies_has_friction_that_is_not_negative():
    robot = model().robot
    lean = DynamicsModel(robot, (Viscous(), Coulomb(width=0.02)))
    base = find_base_parameters(lean)
    motion = lively_motion(np.random.default_rng(1), 3, RATE, 12.0)
    true = np.array([1.0, 0.5, -0.3, -0.2, 2.0, 0.1])
    torque = lean.torque(motion, true) + NOISE * np.random.default_rng(2).normal(size=motion.q.shape)
    fit, standard = estimate(
        EstimationProblem(
            accumulate_information(lean, base, raw(one_run(motion, torque, RATE))), standard_of(lean, base)
        )
    )
    np.testing.assert_allclose(standard.values, np.maximum(true, 0.0), atol=0.1)
    assert (standard.values >= 0.0).all()
    assert {finding.code for finding in fit.findings} >= {"held-at-zero"}


@pytest.mark.parametrize("prior", ["mass", "log-det"])
def test_a_joint_of_which_no_row_counts(prior: str):
    motion = lively_motion(np.random.default_rng(1), 3, RATE, 12.0)
    torque = model().torque(motion, truth()) + NOISE * np.random.default_rng(2).normal(size=motion.q.shape)
    run = one_run(motion, torque, RATE)
    run = replace(run, mask=run.mask & (np.arange(3) != 2))
    base = find_base_parameters(model())
    problem = EstimationProblem(
        accumulate_information(model(), base, raw(run)), standard_of(model(), base), model(), base
    )
    fit, standard = estimate(problem, prior=prior, weight=1.0)
    assert fit.rows.tolist() == [600, 600, 0] and standard.proof.smallest_eigenvalue > 0.0
    (said,) = [finding for finding in fit.findings if finding.code == "prior-dominated"]
    assert "FV_3" in said.evidence and "FV_1" not in said.evidence
