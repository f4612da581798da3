"""Unusual MJCF against MuJoCo: repeated defaults, inherited orientations, actuators, switched-off parts, names."""

from __future__ import annotations

import itertools

import mujoco
import numpy as np
import pytest

from armid.kernel import reference
from armid.robot import frame_pose, load_robot

ORIENTATIONS = ("quat", "axisangle", "xyaxes", "zaxis", "euler")

TOLERANCE = 1e-12
"""Absolute, on metres and N·m of order one to a hundred."""

QUATERNION_WINS = int(mujoco.__version__.split(".")[0]) >= 4
"""In these versions, a quaternion replaces another form of orientation of the class around it."""

MASS = '<inertial pos="0.01 0.02 0.05" mass="1.3" diaginertia="0.01 0.02 0.015"/>'


def pair(
    first: str = MASS, second: str = MASS, *, before: str = "", after: str = "", j: str = "", k: str = ""
) -> str:
    """Two joints with given contents of their bodies, given sections before and after them, and a site."""
    return (
        f'<mujoco>{before}<worldbody><body name="a" pos="0 0 0.3"><joint name="j" {j}/>{first}'
        f'<body name="b" pos="0.1 0.2 0.3"><joint name="k" axis="0 1 0" {k}/>{second}<site name="tcp" pos="0.1 0 0"/>'
        f"</body></body></worldbody>{after}</mujoco>"
    )


def agree(text: str, folder, tip: str = "tcp"):
    """Loads a text in armid and MuJoCo, and compares pose of the tip and torque in random states."""
    path = folder / "arm.xml"
    path.write_text(text)
    robot = load_robot(path, tip=tip)
    model = mujoco.MjModel.from_xml_path(str(path))
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    model.dof_armature[:] = 0.0
    data = mujoco.MjData(model)
    inertial = robot.inertial_vector
    assert inertial is not None
    rng = np.random.default_rng(0)
    for _ in range(3):
        q, dq, ddq = rng.uniform(-1, 1, (3, 1, robot.n))
        data.qpos, data.qvel, data.qacc = q[0], dq[0], ddq[0]
        mujoco.mj_inverse(model, data)
        R, p = frame_pose(robot, q)
        np.testing.assert_allclose(p[0], data.site("tcp").xpos, rtol=0, atol=TOLERANCE)
        np.testing.assert_allclose(R[0].ravel(), data.site("tcp").xmat, rtol=0, atol=TOLERANCE)
        tau = reference.inverse_dynamics(robot.tree, inertial, q, dq, ddq)
        np.testing.assert_allclose(tau[0], data.qfrc_inverse, rtol=0, atol=TOLERANCE)
    return robot, model


@pytest.mark.parametrize(
    ("defaults", "geom"),
    [
        ('<default><geom size="0.1" mass="2"/></default><default><joint armature="0.2"/></default>', "<geom/>"),
        ('<default><geom size="0.1" mass="2"/></default><default class="main"><geom mass="5"/></default>', "<geom/>"),
        (
            '<default><geom size="0.1" mass="2"/></default>'
            '<default><default class="r"><geom mass="5"/></default></default>',
            '<geom class="r"/>',
        ),
        (
            '<default><geom size="0.1"/><default class="r"><geom mass="5"/></default></default>'
            '<default><geom size="0.3"/></default>',
            '<geom class="r"/>',
        ),
    ],
)
def test_repeated_sections_of_defaults_are_merged(tmp_path, defaults, geom):
    robot, model = agree(pair(second=geom, before=defaults), tmp_path)
    np.testing.assert_allclose([j.drive.rotor_inertia for j in robot.joints], 0.2 if "armature" in defaults else 0.0)
    assert robot.links[1].inertial is not None
    np.testing.assert_allclose(robot.links[1].inertial.mass, model.body("b").mass)


def test_defaults_of_an_included_file_are_merged(tmp_path):
    inside = '<default><joint armature="0.3"/><default class="c"><joint axis="1 0 0"/></default></default>'
    arm = pair('<geom size="0.1"/>', '<geom size="0.1"/>', before=inside).replace("mujoco>", "mujocoinclude>")
    (tmp_path / "inside.xml").write_text(arm.replace('name="a"', 'name="a" childclass="c"'))
    outside = '<mujoco><default><geom density="300"/></default><include file="inside.xml"/></mujoco>'
    robot, _ = agree(outside, tmp_path)
    assert [joint.drive.rotor_inertia for joint in robot.joints] == [0.3, 0.3]


def oriented(form: str, rng: np.random.Generator) -> str:
    """Random orientation in a given form."""
    count = {"quat": 4, "axisangle": 4, "xyaxes": 6, "zaxis": 3, "euler": 3}[form]
    values = rng.normal(size=count) * (40.0 if form == "euler" else 1.0)
    return f'{form}="{" ".join(map(str, values))}"'


@pytest.mark.parametrize(("of_class", "own"), [*itertools.product(ORIENTATIONS, ("", *ORIENTATIONS))])
def test_orientations_of_a_default_class_and_of_an_element(tmp_path, of_class, own):
    if "quat" in (of_class, own) and not QUATERNION_WINS:
        pytest.skip("this version of MuJoCo prefers the class, which a finding states")
    rng = np.random.default_rng(ORIENTATIONS.index(of_class))
    outer, inner, above = oriented(of_class, rng), oriented(own, rng) if own else "", oriented("euler", rng)
    defaults = (
        f'<default><geom type="box" size="0.1 0.02 0.03" {above}/><site {above}/>'
        f'<default class="c"><geom {outer}/><site {outer}/></default></default>'
    )
    text = pair(second=f'<geom class="c" {inner}/>', before=defaults)
    robot, _ = agree(text.replace('name="tcp"', f'name="tcp" class="c" {inner}'), tmp_path)
    told = [finding.code for finding in robot.findings if finding.code == "orientation-ambiguous"]
    assert told == ["orientation-ambiguous"] * (own == "quat" and of_class != "quat")


@pytest.mark.parametrize(("kind", "size"), [("capsule", "0.03"), ("box", "0.03 0.04"), ("cylinder", "0.1 0.2")])
def test_a_size_of_an_element_replaces_the_first_numbers_of_that_of_its_class(tmp_path, kind, size):
    defaults = f'<default><geom type="{kind}" size="0.05 0.1 0.2"/></default>'
    robot, model = agree(pair(second=f'<geom size="{size}"/>', before=defaults), tmp_path)
    (shape,) = robot.shapes
    factor = [2, 2, 2] if kind == "box" else [1, 2, 0]
    np.testing.assert_allclose(shape.size, model.geom_size[0] * factor)


@pytest.mark.parametrize(
    "geom", ["", '<geom size="0.1"/>', '<geom size="0.1" mass="0"/>', '<geom size="1" group="3"/>']
)
def test_the_inertial_stays_where_no_geom_has_a_mass(tmp_path, geom):
    compiler = '<compiler inertiafromgeom="true" inertiagrouprange="0 2"/>'
    agree(pair('<geom size="0.1"/>', MASS + geom, before=compiler), tmp_path)


@pytest.mark.parametrize("state", ["disable", "enable"])
def test_gravity_can_be_switched_off(tmp_path, state):
    option = f'<option gravity="0 1 -5"><flag gravity="{state}"/></option>'
    robot, _ = agree(pair(before=option), tmp_path)
    assert robot.gravity.tolist() == ([0, 0, 0] if state == "disable" else [0, 1, -5])


ACTUATED = [
    ('<general forcerange="-87 87"/>', '<position joint="j" kp="100"/><general joint="k"/>'),
    ('<position forcerange="-87 87"/>', '<position joint="j" kp="100"/><motor joint="k"/>'),
    ('<motor gear="3" ctrlrange="-2 2"/>', '<motor joint="j"/>'),
    ('<general gear="5"/><motor gear="3"/>', '<general joint="j" forcerange="-1 1"/><motor joint="k"/>'),
    ('<general gear="5"/><default class="c"><velocity forcerange="-4 4"/></default>', '<motor class="c" joint="j"/>'),
    ("", '<motor joint="j" gear="50" forcerange="-2 2" ctrlrange="-1 1"/>'),
    ("", '<motor joint="j" gear="50" forcerange="-1 1" ctrlrange="-2 2"/>'),
    ("", '<motor joint="j" ctrlrange="-1 1" ctrllimited="false"/>'),
    ("", '<motor joint="j" ctrlrange="-1 1" forcerange="-9 9" ctrllimited="false"/>'),
    ("", '<motor joint="j" ctrlrange="-1 1" forcerange="-0.5 0.5" forcelimited="false"/>'),
]  # fmt: skip


@pytest.mark.parametrize(("defaults", "actuators"), ACTUATED)
def test_effort_limits_are_the_largest_forces_of_the_actuators(tmp_path, defaults, actuators):
    text = pair(before=f"<default>{defaults}</default>", after=f"<actuator>{actuators}</actuator>")
    robot, model = agree(text, tmp_path)
    limits = dict.fromkeys(robot.joint_names, np.inf)
    for i in range(model.nu):
        actuator = model.actuator(i)
        bounds = [actuator.forcerange[1]] if actuator.forcelimited[0] else []
        is_motor = actuator.gainprm[0] == 1.0 and not actuator.biasprm.any()
        if is_motor and actuator.ctrllimited[0]:
            bounds.append(actuator.ctrlrange[1])
        if bounds:
            limits[model.joint(actuator.trnid[0]).name] = actuator.gear[0] * min(bounds)
    assert {joint.name: joint.effort_limit for joint in robot.joints} == pytest.approx(limits)


@pytest.mark.parametrize(
    ("joint", "actuators"),
    [
        ('range="-9 9"', ""),
        ('actuatorfrcrange="-9 9"', ""),
        ("", '<actuator><motor joint="j" forcerange="-5 5"/></actuator>'),
    ],
)
def test_a_range_that_mujoco_refuses_is_named(tmp_path, joint, actuators):
    text = pair(before='<compiler autolimits="false"/>', after=actuators, j=joint)
    with pytest.raises(ValueError, match="autolimits"):
        mujoco.MjModel.from_xml_string(text)
    (tmp_path / "arm.xml").write_text(text)
    robot = load_robot(tmp_path / "arm.xml")
    assert [(finding.code, finding.channel) for finding in robot.findings] == [("limits-unknown", "j")]
    assert np.isinf([*robot.joints[0].position_limits, robot.joints[0].effort_limit]).all()


@pytest.mark.parametrize(
    ("defaults", "tie"),
    [
        ('<equality active="false"/>', "<joint"),
        ('<default class="c"><equality active="false"/></default>', '<joint class="c"'),
        ('<equality active="false"/>', '<joint active="true"'),
        ("", "<joint"),
    ],
)
def test_equalities_that_a_default_class_disables(tmp_path, defaults, tie):
    text = pair(before=f"<default>{defaults}</default>", after=f'<equality>{tie} joint1="k" joint2="j"/></equality>')
    path = tmp_path / "arm.xml"
    path.write_text(text)
    active = bool(mujoco.MjModel.from_xml_string(text).eq_active0[0])
    assert load_robot(path).joint_names == (("j",) if active else ("j", "k"))


def test_generated_names_are_free_ones(tmp_path):
    text = pair().replace('name="a"', 'name="body_0"').replace('name="b" pos', "pos")
    text = text.replace('name="j"', 'name="body_1_joint_0"').replace('name="k"', "")
    robot, _ = agree(text, tmp_path)
    assert [link.name for link in robot.links] == ["body_0", "body_1"]
    assert robot.joint_names == ("body_1_joint_0", "body_1_joint_1")
