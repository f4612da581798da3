"""Bodies of adjacent links: spheres on two jaws, whose distance is known in closed form."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from armid.errors import ArmidError
from armid.excitation.collision import adjacent_link_collisions, closest_approach
from armid.excitation.collision.adjacent_link_collisions import ROUGH, STEP, AdjacentLinks, adjacent_links
from armid.excitation.collision.ignored_pairs import IgnoredBodies, ignored_of_srdf
from armid.excitation.collision.required_distances import LEAST
from armid.excitation.design.objective import CriterionGoal
from armid.excitation.limits.joint_limits import limits_of
from armid.model.base_parameters import find_base_parameters
from armid.model.dynamics_model import DynamicsModel
from armid.model.terms import RigidBody
from armid.report.preflight_page import render_preflight
from armid.report.preview.animation_frames import clip_of_motion
from armid.report.preview.nearest_bodies import bodies_to_watch, closest
from armid.robot import Robot, load_robot
from armid.study.plans.design import design_plan
from armid.study.plans.design_options import DesignConstraints, DesignGoal, SearchBudget
from armid.study.plans.poses_and_sweeps import MovesGoal, design_moves
from armid.study.plans.preflight_text import report_record, report_text
from mesh_texts import write_mesh

pytestmark = pytest.mark.collision

ARM, RADIUS, WIDTH = 0.1, 0.02, 2.5
"""Distance of the spheres from the axis and their radius [m], and range of the joint [rad]."""

TOUCH = 2.0 * math.asin(RADIUS / ARM)
"""Angle of the jaws below which the spheres overlap [rad]."""

RESOLVED = 1e-4
"""Error of an end of a range that bisection finds [m]: the arm times a seventh halving of a step is 4e-5 m."""

PIN = '<collision><geometry><sphere radius="0.01"/></geometry></collision>'
"""Body on the axis, which touches its like on the other link at all angles."""


def sphere(radius: float, x: float = ARM, z: float = 0.0) -> str:
    return f'<collision><origin xyz="{x} 0 {z}"/><geometry><sphere radius="{radius}"/></geometry></collision>'


def jaws(
    folder: Path,
    still: str = sphere(RADIUS) + PIN,
    moving: str = sphere(RADIUS) + PIN,
    limit: str = f'lower="0" upper="{WIDTH}"',
    more: str = "",
) -> Robot:
    """Jaws that open about z, and close at the lower end of their range."""
    kind = "revolute" if "lower" in limit else "continuous"
    inertia = '<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/>'
    inertial = f'<inertial><origin xyz="0.05 0 0"/><mass value="1"/>{inertia}</inertial>'
    path = folder / "SO_jaws.SLDASM.urdf"
    path.write_text(
        f'<robot name="SO_jaws.SLDASM"><link name="fixed">{still}</link><link name="jaw">{inertial}{moving}</link>'
        f'<joint name="grip" type="{kind}"><parent link="fixed"/><child link="jaw"/><axis xyz="0 0 1"/>'
        f'<limit {limit} velocity="2" effort="9"/>{more}</joint></robot>'
    )
    return load_robot(path)


def gap(q: np.ndarray | float) -> np.ndarray:
    """Distance of the two outer spheres at an angle of the jaws [m]."""
    return 2.0 * ARM * np.abs(np.sin(0.5 * np.asarray(q))) - 2.0 * RADIUS


def links(robot: Robot, margin: float = 0.02, ignored: tuple[IgnoredBodies, ...] = ()) -> AdjacentLinks:
    return adjacent_links(robot, robot.shapes, limits_of(robot), margin, ignored)


def planned(robot: Robot, ignored: tuple[IgnoredBodies, ...] = (), start: np.ndarray | None = None):
    goal = CriterionGoal(
        DynamicsModel(robot, (RigidBody(),)), find_base_parameters(DynamicsModel(robot, (RigidBody(),)))
    )
    rules = DesignConstraints(clearance=0.02, ignored=ignored, acceleration=5.0)
    return design_plan(DesignGoal(goal, 10.0, 4, start), rules, SearchBudget(1e-3, 1, 0))


def test_a_range_ends_where_bodies_reach_their_distance(tmp_path):
    """Half of the distance that they exceed nearly everywhere, at most the clearance; wherever the range begins."""
    robot = jaws(tmp_path)
    for margin in (0.02, 0.002):
        found = links(robot, margin)
        (pair,) = [each for each in found.checked if each.pair == "fixed - jaw"]
        assert 0.0 < pair.required_distance <= margin
        narrowed = found.narrowed(limits_of(robot), None)
        assert narrowed.lower[0] > TOUCH and narrowed.upper[0] == WIDTH
        assert pair.required_distance <= gap(narrowed.lower[0]) < pair.required_distance + RESOLVED


def test_bodies_that_are_apart_in_the_whole_range_do_not_narrow_it(tmp_path):
    robot = jaws(tmp_path, limit=f'lower="{TOUCH + 0.3}" upper="{WIDTH}"')
    found = links(robot)
    assert {str(each.pair) for each in found.checked} >= {"fixed - jaw"}
    assert found.narrowed(limits_of(robot), None).lower[0] == limits_of(robot).lower[0]


def test_a_joint_without_limits_gets_both_where_bodies_collide(tmp_path):
    robot = jaws(tmp_path, limit="")
    narrowed = links(robot, 0.002).narrowed(limits_of(robot), np.array([-1.5]))
    assert -math.pi <= narrowed.lower[0] < -1.5 < narrowed.upper[0] < -TOUCH
    free = jaws(tmp_path, sphere(RADIUS, z=0.3), sphere(RADIUS), limit="")
    assert not np.isfinite(links(free).narrowed(limits_of(free), None).upper[0])


def test_a_start_pose_in_contact_is_refused_with_the_pair_and_the_options(tmp_path):
    robot = jaws(tmp_path)
    with pytest.raises(ArmidError, match=r"(?s)fixed - jaw touch or are closer.*grip with --start.*--ignore-pair"):
        links(robot).narrowed(limits_of(robot), np.array([0.5 * TOUCH]))


@pytest.mark.parametrize(
    ("radius", "z", "cause"),
    [
        (RADIUS, 0.0, "touching in all positions"),
        (RADIUS, 2.0 * RADIUS + 0.5 * LEAST, "touching or less than 1 mm apart in most positions"),
    ],
)
def test_bodies_on_the_axis_are_left_out_with_the_reason(tmp_path, radius, z, cause):
    robot = jaws(tmp_path, sphere(radius, 0.0), sphere(radius, 0.0, z))
    found = links(robot)
    assert not found.checked and [str(each.pair) for each in found.left_out] == ["fixed - jaw"]
    assert found.left_out[0].why.startswith(f"adjacent links, {cause}")


def test_a_gap_that_never_changes_is_kept_and_narrows_nothing(tmp_path):
    robot = jaws(tmp_path, sphere(RADIUS, 0.0), sphere(RADIUS, 0.0, 2.0 * RADIUS + 0.004))
    (pair,) = links(robot).checked
    assert pair.required_distance == pytest.approx(0.002, abs=1e-6)  # half of 4 mm; Coal's tolerance
    assert links(robot).narrowed(limits_of(robot), None).lower[0] == 0.0


def boxes(path: Path, *each: tuple[tuple[float, float, float], tuple[float, float, float]]) -> str:
    """Collision element of a mesh of boxes, each given by its lower and upper corner [m]."""
    corners = [np.array([[(low, high)[bit][axis] for axis, bit in enumerate(bits)]
               for bits in np.ndindex(2, 2, 2)]) for low, high in each]  # fmt: skip
    faces = np.array([[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
                      [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]])  # fmt: skip
    write_mesh(path, np.vstack(corners), np.vstack([faces + 8 * k for k in range(len(corners))]))
    return f'<collision><geometry><mesh filename="{path.name}"/></geometry></collision>'


PLATE = ((-0.05, -0.05, -0.01), (0.05, 0.05, 0.0))
FLANGE = ((-0.05, -0.05, 0.004), (0.05, 0.05, 0.014))
"""Plates that face each other across a gap of 4 mm."""


def flange(folder: Path, *, lugs: bool) -> Robot:
    """Two plates about the axis; with lugs a post and an arm at a radius of 0.1 m, which meet at an angle of zero."""
    post = (((0.09, -0.005, -0.01), (0.11, 0.005, 0.02)),) if lugs else ()
    arm = (((0.0, -0.004, 0.004), (0.1, 0.004, 0.014)),) if lugs else ()
    still, moving = boxes(folder / "still.stl", PLATE, *post), boxes(folder / "moving.stl", FLANGE, *arm)
    return jaws(folder, still, moving, f'lower="{-math.pi}" upper="{math.pi}"')


def test_a_gap_of_meshes_that_never_changes_is_measured_in_a_few_positions_only(tmp_path, monkeypatch):
    """Detailed meshes that face each other across a gap take a second for each position."""
    measured = [0]

    def counted(function):
        def count(shapes, pairs, *more):
            measured[0] += next(len(x[1]) for x in more if isinstance(x, tuple))
            return function(shapes, pairs, *more)

        return count

    for module in (adjacent_link_collisions, closest_approach):
        for name in ("distances", "too_close"):
            monkeypatch.setattr(module, name, counted(getattr(module, name)))
    robot = flange(tmp_path, lugs=False)
    (pair,) = links(robot).checked
    assert pair.constant and measured[0] <= 2 * ROUGH
    opened = planned(robot)
    measured[0] = 0
    q = opened.plan.excitation.sample(1000.0).q
    (found,) = closest_approach.closest_approaches(opened.collision, robot, np.arange(len(q)) / 1000.0, q)
    assert found.constant and found.distance == pytest.approx(0.004, abs=1e-6)
    assert measured[0] <= 2 * (ROUGH + 1)  # by convex bodies first


def test_lugs_that_meet_between_the_first_positions_narrow_the_range(tmp_path):
    """The gap of the plates is the same in all positions that are examined first, and the lugs meet at zero."""
    found = links(flange(tmp_path, lugs=True))
    (pair,) = found.checked
    assert not pair.constant
    narrowed = found.narrowed(limits_of(flange(tmp_path, lugs=True)), None)
    assert not narrowed.lower[0] < 0.0 < narrowed.upper[0]


def test_a_gap_that_changes_is_not_constant(tmp_path):
    assert not any(each.constant for each in links(jaws(tmp_path)).checked)


def test_bodies_that_leave_a_joint_hardly_any_range_are_left_out(tmp_path):
    """Eight posts around the axis, between which a jaw has no room of a third of its range."""
    turns = [f'<origin xyz="{ARM * math.cos(a)} {ARM * math.sin(a)} 0"/>' for a in np.arange(8) * 0.25 * math.pi]
    posts = "".join(f'<collision>{turn}<geometry><sphere radius="0.015"/></geometry></collision>' for turn in turns)
    robot = jaws(tmp_path, posts, sphere(0.015), limit=f'lower="{-math.pi}" upper="{math.pi}"')
    found = links(robot, 0.001)
    assert any("less than a third" in each.why for each in found.left_out)
    narrowed = found.narrowed(limits_of(robot), None)
    assert narrowed.upper[0] - narrowed.lower[0] >= 2.0 * math.pi / 3.0 - STEP


@pytest.fixture(scope="module")
def opened(tmp_path_factory):
    """A plan of the jaws."""
    return planned(jaws(tmp_path_factory.mktemp("jaws")))


def test_a_plan_keeps_adjacent_links_apart_and_says_so(opened):
    """By the closed form, at 1 kHz; the report names the joint, the pair, its distance and what is not checked."""
    q = opened.plan.excitation.sample(1000.0).q[:, 0]
    (pair,) = [each for each in opened.preflight.approaches if each.pair == "fixed - jaw"]
    assert gap(q).min() >= pair.required_distance > 0.0
    assert pair.distance == pytest.approx(gap(q).min(), abs=RESOLVED) and pair.is_sufficient
    assert opened.preflight.verdict == "pass"
    (finding,) = [each for each in opened.findings if each.code == "adjacent-range"]
    assert "grip" in finding.evidence and "fixed - jaw" in finding.evidence and "--ignore-pair" in finding.remedy


def test_the_verdict_counts_what_is_not_checked_and_every_account_lists_it(opened):
    """The pins on the axis always touch."""
    said = "every limit holds (torque without friction and rotor inertia), and checked bodies keep apart"
    left = "adjacent links, touching in all positions of their joint"
    text, page, record = report_text(opened), render_preflight(opened), report_record(opened)
    for account in (text, page, record["said"]):
        reduced = r", 1 pair at [\d.]+ mm or more instead of the clearance of 20 mm"
        assert re.search(rf"{re.escape(said)}{reduced} \(not checked: 1 pair of adjacent links\)", account)
    assert f"{left}: fixed shape 2 - jaw shape 2" in text
    assert re.search(
        r'<li>adjacent links, touching in all [^<]*<span class="names">fixed shape 2 - jaw shape 2<', page
    )
    assert "1 pair of bodies is not checked" in page
    assert {each["pair"]: each["reason"] for each in record["skipped_pairs"]} == {"fixed shape 2 - jaw shape 2": left}
    assert record["torque_lacks"] == "friction and rotor inertia"


def test_described_drives_are_not_missing_in_the_verdict(tmp_path):
    designed = planned(jaws(tmp_path, more='<dynamics damping="0.5" friction="0.1"/>'))
    assert designed.preflight.sentence.startswith("every limit holds (torque without rotor inertia), and")


def test_pairs_of_an_srdf_are_listed_once_with_its_reason_and_named_where_they_touch(tmp_path):
    """The motion begins with closed jaws."""
    robot = jaws(tmp_path)
    path = tmp_path / "jaws.srdf"
    path.write_text('<robot name="x"><disable_collisions link1="fixed" link2="jaw" reason="Adjacent"/></robot>')
    designed = planned(robot, ignored_of_srdf(path), np.array([0.5 * TOUCH]))
    assert "left-out-pairs-touch" in {each.code for each in designed.findings}
    sentence = designed.preflight.sentence
    assert "not checked: 1 pair of adjacent links, 3 pairs as requested; in this plan 1 of these touches)" in sentence
    text, page = report_text(designed, findings=False), render_preflight(designed)
    assert text.count("jaws.srdf: Adjacent: fixed - jaw (3 pairs of bodies)") == 1
    assert page.count("3 pairs of bodies)</span>") == 1
    (finding,) = [each for each in designed.findings if each.code == "pairs-ignored"]
    assert "3 pairs of bodies are not checked, as requested" in finding.evidence
    assert finding.evidence.count("fixed - jaw") == 1


@pytest.mark.parametrize("kind", ["poses", "sweeps"])
def test_poses_and_sweeps_keep_adjacent_links_apart(tmp_path, kind):
    robot = replace(jaws(tmp_path), gravity=np.array([0.0, -9.81, 0.0]))
    designed = design_moves(
        DynamicsModel(robot, (RigidBody(),)), MovesGoal(kind, poses=4), DesignConstraints(clearance=0.02)
    )
    assert designed.preflight.verdict == "pass" and "torque without friction" in designed.preflight.sentence
    assert gap(designed.plan.sample(100.0).q[:, 0]).min() > 0.0


def test_the_preview_draws_adjacent_links_where_they_are_nearest(tmp_path, opened):
    robot = opened.robot
    watched = bodies_to_watch(robot)
    assert watched is not None
    motion = opened.plan.sample(50.0)
    found = closest(robot, clip_of_motion(motion, "jaws"), watched)
    assert found is not None and {found.pairs[k] for k in found.pair} >= {"fixed – jaw"}
    exact = np.interp(found.time, motion.time, gap(motion.q[:, 0]))
    mine = np.array([found.pairs[k] == "fixed – jaw" for k in found.pair])
    assert found.distance[mine] == pytest.approx(exact[mine], abs=2e-3)  # interpolated between 128 positions


def test_a_long_name_breaks_at_its_separators(opened):
    assert "<h1>SO_<wbr>jaws.<wbr>SLDASM</h1>" in render_preflight(opened)
