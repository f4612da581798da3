"""Folding, names and order of a report; plots of residuals."""

from __future__ import annotations

import csv
import io
import json
import re
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from armid.estimation.link_properties import QUANTITIES, link_table
from armid.excitation.collision.closest_approach import ClosestApproach
from armid.model.dynamics_model import DynamicsModel
from armid.model.parameter_name import parameter_names
from armid.model.terms import Coulomb, Hysteresis, Ripple, Viscous
from armid.report.data.friction_law_text import law_text
from armid.report.data.joint_names import by_joint, heading_of, label_of
from armid.report.data.page_data import PageData, gather, stored
from armid.report.heading import commands_of
from armid.report.page import render
from armid.report.plots.arm_picture import skeleton
from armid.report.plots.plot_specification import PlotRange
from armid.report.preflight_page import nearest_of_links
from armid.report.sections import parameters
from armid.report.sections.link_properties import show_link_properties
from armid.report.sections.parameters import show_parameters
from armid.report.sections.residuals import show_residuals
from armid.report.sections.standard_parameters import show_standard_parameters
from armid.report.sections.torque import show_torque
from armid.report.tables import Column, Table, TableCell
from armid.robot import Robot, load_robot
from armid.robot.collision_body_names import BodyName, BodyPair
from armid.runs.run import load_run
from armid.study.storage.provenance import RunOrigin
from paged import understood
from reports import Page, make_run

pytest.importorskip("plotly")
pytest.importorskip("jinja2")

NAMES = ("base_yaw", "shoulder", "elbow")
"""Names of joints from which nobody can tell the numbers."""


@pytest.fixture(scope="module")
def material(tmp_path_factory: pytest.TempPathFactory) -> PageData:
    return named(gather(make_run(tmp_path_factory.mktemp("small"))))


@pytest.fixture(scope="module")
def bodies(tmp_path_factory: pytest.TempPathFactory) -> PageData:
    """A run that has standard parameters, most of them not identifiable."""
    return stored(make_run(tmp_path_factory.mktemp("physical"), "physical"))


@pytest.fixture(scope="module")
def html(material: PageData) -> str:
    return render(material)


def named(material: PageData) -> PageData:
    """The run with joints of other names."""
    run = material.run
    joints = tuple(replace(joint, name=name) for joint, name in zip(run.robot.joints, NAMES, strict=True))
    return replace(material, run=replace(run, robot=replace(run.robot, joints=joints)))


def details(html: str) -> list[str]:
    """Return what is folded, outermost parts."""
    found, depth, begin = [], 0, 0
    for mark in re.finditer(r"<(/?)details", html):
        if not mark[1]:
            begin, depth = (mark.start() if depth == 0 else begin), depth + 1
        else:
            depth -= 1
            found += [html[begin : mark.start()]] if depth == 0 else []
    return found


# Folding --------------------------------------------------------------------------------------------------------


def test_long_tables_and_pictures_of_single_joints_are_folded_and_short_ones_are_not(html: str):
    body = html.split("<main")[1].split("<script")[0]
    inside = "".join(details(body))
    for key in ("parameters", "groupings", "provenance", "excitation", "residuals", "checks"):
        assert f'id="table-{key}"' in inside
    for key in ("torque", "friction", "laws"):
        assert f'id="table-{key}"' in body and f'id="table-{key}"' not in inside
    for key in ("residual-time-0", "friction-velocity-2", "torque-1-0"):
        assert f'data-plot="{key}"' in inside
    # One recording's torque is seen at once.
    assert sum("data-wide" in each for each in details(body)) == 1
    (first,) = [each for each in details(body) if "data-wide" in each]
    assert " open" in first[:40] and 'data-plot="torque-0-0"' in first


def test_a_folded_table_is_there_to_be_searched(html: str):
    assert "FV_3" in Page(html).words


# Names of joints ------------------------------------------------------------------------------------------------


def test_labels_of_joints(material: PageData):
    joints = material.run.robot.joints
    assert (heading_of(joints, 2), label_of(joints, 2)) == ("joint 3 · elbow", "3 · elbow")
    numbered = tuple(replace(joint, name=name) for joint, name in zip(joints, ("A1", "joint_0", "j3"), strict=True))
    assert [label_of(numbered, j) for j in range(3)] == ["A1", "2 · joint_0", "j3"]
    said = by_joint(parameter_names(["FV_1", "FS_1", "XX_3"]), joints)
    assert said == "FV_1, FS_1 (base_yaw); XX_3 (elbow)"


def test_parameters_stand_below_the_names_of_their_joints(material: PageData, html: str):
    (table,) = show_parameters(material).tables
    names = [row[0].text for row in table.rows]
    starts = sorted(table.groups)
    assert [table.groups[k] for k in starts] == [f"joint {j + 1} · {name}" for j, name in enumerate(NAMES)]
    for k, begin in enumerate(starts):
        end = (*starts, len(names))[k + 1]
        assert {name.number for name in parameter_names(names[begin:end])} == {k + 1}
    assert sorted(names) == sorted(material.run.estimate.fit.names)
    page = html.split('id="table-parameters"')[1]
    assert page.index("joint 3 · elbow") < page.index("FV_3") and page.index("joint 2 ·") < page.index("FV_2")
    assert re.search(r"\d+ inertial \+ \d+ friction", html)


def test_the_assumption_about_friction_stands_beside_the_intervals(
    material: PageData, html: str, monkeypatch: pytest.MonkeyPatch
):
    said = "assume that the model is right, including its form of friction"
    assert said in html and "This log contradicts that" not in html
    monkeypatch.setattr(parameters, "depends_on_velocity", lambda _, j: j == 2)
    assert show_parameters(material).content["contradicting"] == "3 · elbow"
    assert "the residual of 3 · elbow depends on the velocity" in render(material)


def test_every_part_of_the_page_says_the_names(material: PageData, html: str):
    page = Page(html)
    for key in ("torque", "friction", "laws", "excitation", "residuals"):
        rows = list(csv.reader(io.StringIO(page.data["tables"][key]["csv"])))
        assert [row[0] for row in rows[1:4]] == [f"{j + 1} · {name}" for j, name in enumerate(NAMES)]
    for section in (show_torque(material), show_residuals(material)):
        assert section is not None
        titles = {title for row, plots in section.plots for title in (row, *(plot.title for plot in plots))}
        assert {f"joint {j + 1} · {name}" for j, name in enumerate(NAMES)} <= titles


def test_groups_of_a_table_are_in_its_copies():
    rows = [[TableCell("a", 1.0)], [TableCell("b", 2.0)], [TableCell("c", 3.0)]]
    table = Table("t", "Three", (Column("x"),), rows, groups={0: "joint 1 · base", 2: "joint 2 · top"})
    assert table.csv() == "x,group\n1.0,joint 1 · base\n2.0,joint 1 · base\n3.0,joint 2 · top\n"
    latex = table.latex().splitlines()
    assert latex[4] == r"\multicolumn{1}{l}{joint 1 $\cdot$ base} \\" and latex[5] == r"a \\"
    assert sum(r"\multicolumn" in line for line in latex) == 2


# Friction -------------------------------------------------------------------------------------------------------


def test_a_basis_with_memory_is_one_sum(material: PageData):
    """Five elements of hysteresis beside other laws are one line and not five terms of their stiffness."""
    robot = material.run.robot
    terms = (
        Viscous(),
        Coulomb(width=0.02),
        Hysteresis(widths=(0.001, 0.003, 0.01, 0.03, 0.1)),
        Ripple(harmonics=(2.0,)),
    )
    laws = [law for _, law in DynamicsModel(robot, terms).laws if law.joint == 1]
    said = law_text(laws)
    assert said == (
        "FV · dq + FS · tanh(50 dq) + Σ FHₖ · slip(q, rₖ) + RS2 · sin(2 q) + RC2 · cos(2 q), "
        "k = 1…5, r = 0.001, 0.003, 0.01, 0.03, 0.1"
    )
    assert law_text([]) == ""


def test_the_page_has_one_line_of_friction_a_joint(html: str):
    record = Page(html).data["tables"]["laws"]["csv"]
    assert len(record.splitlines()) == 1 + len(NAMES)


# Residuals ------------------------------------------------------------------------------------------------------


def test_a_few_spikes_do_not_flatten_a_residual():
    rng = np.random.default_rng(4)
    x = np.arange(4000.0)
    y = rng.normal(0.0, 0.01, len(x))
    y[[100, 3000]] = 2.0, -1.5
    sight = PlotRange.of(y)
    assert sight.span is not None and sight.span[1] < 0.05 and sight.peak == 2.0
    assert np.mean(np.abs(y) <= sight.limit) >= 0.995 and sight.share == pytest.approx(2 / 4000, abs=6e-3)
    above, below = sight.cut(x, y, "residual")
    assert 100.0 in above.x and 3000.0 in below.x and (above.y > 0).all() and (below.y < 0).all()
    assert sight.span[0] < below.y.min() and above.y.max() < sight.span[1]  # the marks are in the picture
    # Nor do spikes that come once a period, 2 % of the rows.
    y[::50] = 2.0
    assert PlotRange.of(y).limit < 0.1 and PlotRange.of(y).share == pytest.approx(0.02, abs=0.006)
    # What has no tail is shown whole.
    assert PlotRange.of(np.sin(x)).span is None and PlotRange.of(np.sin(x)).cut(x, np.sin(x), "") == ()
    assert PlotRange.of(np.full(3, np.nan)).span is None


def test_the_page_scales_residuals_to_most_rows_and_says_what_is_cut(material: PageData):
    (held_out,) = material.of_role("validate")
    measured = held_out.measured.copy()
    measured[len(measured) // 2, 0] += 50.0
    others = tuple(each for each in material.recordings if each is not held_out)
    changed = replace(material, recordings=(*others, replace(held_out, measured=measured)))
    section = show_residuals(changed)
    assert section is not None
    plots = [plot for _, row in (*section.plots, *show_torque(changed).plots) for plot in row]
    for key in ("residual-time-0", "residual-velocity-0", "left-0-0"):
        (plot,) = [each for each in plots if each.key == key]
        assert plot.axes.span is not None and plot.axes.span[1] < 5.0
        assert "above" in {trace.role for trace in plot.traces}
    (plot,) = [each for each in plots if each.key == "residual-time-0"]
    assert "outside the plot, up to 50" in plot.caption


def test_the_residual_stands_below_each_torque(material: PageData):
    for _, plots in show_torque(material).plots:
        assert len(plots) == 2 * len(NAMES)
        for upper, lower in zip(plots[::2], plots[1::2], strict=True):
            assert upper.key.replace("torque", "left") == lower.key and upper.group == lower.group != ""
            assert "residual" in lower.y and (lower.traces[1].x[[0, -1]] == upper.traces[1].x[[0, -1]]).all()


# The head of the page -------------------------------------------------------------------------------------------


def test_date_host_and_recordings_are_at_the_top(material: PageData):
    made = RunOrigin("2024-02-29T13:05:07+02:00", "bench-7", "9.9")
    top = Page(render(replace(material, run=replace(material.run, made=made)))).prose.split("Verdict", 2)[1]
    for said in ("29 February 2024, 13:05 (UTC+02:00) on bench-7, armid 9.9", "run1.csv (", "run2.csv ("):
        assert said in top


def test_a_run_keeps_when_and_where_it_was_made_and_older_ones_are_read(material: PageData, tmp_path: Path):
    made = load_run(material.run.folder).made
    assert re.fullmatch(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d[+-]\d\d:\d\d", made.at) and made.host and made.version
    old = shutil.copytree(material.run.folder, tmp_path / "run")
    kept = json.loads((old / "model.json").read_text())
    del kept["made"]
    (old / "model.json").write_text(json.dumps(kept))
    run = load_run(old)
    assert run.made == RunOrigin()
    assert "date not recorded" in render(stored(run))


def test_the_next_commands_have_the_path_of_the_run(material: PageData, tmp_path: Path):
    commands = [command for command, _ in commands_of(material)]
    assert {command.split()[1] for command in commands} >= {"export", "validate", "preview", "certify"}
    for command in commands:
        assert material.run.folder in command
        understood(command)
    spaced = replace(material, run=replace(material.run, folder="my runs/today"))
    assert all("'my runs/today'" in command for command, _ in commands_of(spaced))


def test_the_page_has_no_placeholder_where_the_run_is_meant(html: str):
    assert not re.search(r"armid \w+ RUN\b", Page(html).prose)


@pytest.mark.parametrize("name", ["iiwa14-r820", "two-arms"])
def test_the_picture_shows_every_joint_once(name: str, material: PageData):
    robot: Robot = load_robot(name) if name == "iiwa14-r820" else material.run.robot
    poses = np.random.default_rng(1).uniform(-1.5, 1.5, (40, robot.n))
    page = Page(f"<main>{skeleton(robot, poses)}</main>")
    numbers = " ".join(word for word in page.words if re.fullmatch(r"[\d ]+", word)).split()
    assert sorted(map(int, numbers)) == list(range(1, robot.n + 1))
    assert sum(tag == "line" for tag, _ in page.elements) == robot.n + 1
    (svg,) = [found for tag, found in page.elements if tag == "svg"]
    assert all(joint.name in str(svg["aria-label"]) for joint in robot.joints)
    numbers = [float(x) for _, found in page.elements for key in ("x1", "x2", "y1", "y2") if (x := found.get(key))]
    assert min(numbers) >= 0.0 and max(numbers) <= 240.0


# What is known, and words ---------------------------------------------------------------------------------------


def test_what_is_not_identifiable_has_no_interval(bodies: PageData):
    section, fit = show_standard_parameters(bodies), bodies.run.estimate.fit.standard
    assert section is not None and fit is not None and "not identifiable" in fit.status
    (table,) = section.tables
    titles = [column.title for column in table.columns]
    low, high = titles.index("95 % from"), titles.index("to")
    status = dict(zip(fit.names, fit.status, strict=True))
    for row in table.rows:
        known = status[row[0].text] != "not identifiable"
        assert all((cell.text != "–") is known and (cell.value != "") is known for cell in (row[low], row[high]))


BANNED = (
    "unseen",
    "description alone",
    "nominal",
    "Noticed on the way",
    "freedom in the middle",
    "of it by",
    "real body has",
)


def test_the_page_speaks_the_words_of_the_field(html: str, bodies: PageData):
    for prose in (Page(html).prose, Page(render(bodies)).prose):
        assert [word for word in BANNED if word in prose] == []
    assert "root of the sum of squares over joints" in Page(html).prose and "(median)" in Page(html).prose


def test_links_of_several_bodies_are_one_pair_and_the_worst_of_it_is_shown():
    found = nearest_of_links(
        [
            ClosestApproach(BodyPair(BodyName("base_link", 2), BodyName("gripper_link", 3)), 0.030, 1.0, 0.02),
            ClosestApproach(BodyPair("base_link", "gripper_link"), 0.040, 2.0, 0.05),
            ClosestApproach(BodyPair("upper_arm", BodyName("gripper_link", 2)), 0.010, 3.0, 0.02),
        ]
    )
    # One that comes too close is not hidden behind a nearer one that may.
    assert [(each.pair.links, each.distance) for each in found] == [
        ("upper_arm - gripper_link", 0.010),
        ("base_link - gripper_link", 0.040),
    ]


# Bodies ---------------------------------------------------------------------------------------------------------


def test_links_show_their_bodies_as_described_and_as_identified(bodies: PageData):
    fit = bodies.run.estimate.fit
    assert fit.standard is not None
    # No torque of this arm shows a mass by itself; here the last link counts as known.
    last = f"_{bodies.run.robot.n}"
    names = zip(fit.standard.names, fit.standard.status, strict=True)
    status = tuple("identified" if name.endswith(last) else each for name, each in names)
    known_last = replace(fit, standard=replace(fit.standard, status=status))
    bodies = replace(bodies, run=replace(bodies.run, estimate=replace(bodies.run.estimate, fit=known_last)))
    section, table = show_link_properties(bodies), link_table(bodies.run.model, bodies.run.estimate)
    assert section is not None
    (shown,) = section.tables
    rows = list(csv.reader(io.StringIO(shown.csv())))
    column = {title.split(" [")[0]: k for k, title in enumerate(rows[0])}
    assert {"mass", "com x", "com y", "com z", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz"} <= set(column)
    for j, body in enumerate(table.links):
        old, new = (row for row in rows[1:] if row[0] == f"{j + 1} · {body.link}")
        assert (old[1], new[1]) == ("CAD/URDF", "identified")
        for k, name in enumerate(QUANTITIES):
            assert float(old[column[name]]) == pytest.approx(body.description[k], abs=1e-12)
            assert float(new[column[name]]) == pytest.approx(body.estimate[k], abs=1e-12)
    cells = [cell for row in shown.rows if row[1].text == "identified" for cell in row[2:]]
    known = np.isfinite([body.intervals for body in table.links]).all(axis=2)
    assert sum("±" in cell.text for cell in cells) == int(known.sum()) > 0
    assert all(("±" in cell.text) is (cell.kind != "guessed") for cell in cells)


def test_base_parameters_have_the_bodies_of_the_description_and_the_way_to_others(material: PageData):
    section = show_link_properties(material)
    assert section is not None and "--method physical" in section.content["note"]
    assert {row[1].text for row in section.tables[0].rows} == {"CAD/URDF"}
