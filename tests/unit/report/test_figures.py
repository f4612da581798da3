"""Figures for notebooks: the plots of the page, one joint where one is asked for, errors that say what is missing."""

from __future__ import annotations

import base64
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from armid.errors import ArmidError
from armid.excitation.limits.joint_limits import described_limits
from armid.report.data.page_data import with_recordings
from armid.report.plots.plot_specification import Plot
from armid.report.sections.friction import show_friction
from armid.report.sections.residuals import show_residuals
from armid.report.sections.torque import show_torque
from armid.runs.run import Run, load_run
from labs import small_model, small_plan
from reports import make_run

pytest.importorskip("plotly")

from armid.report.plots import notebook_figures

JOINTS = 3


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    return make_run(tmp_path_factory.mktemp("run"))


def numbers(values: Any) -> np.ndarray:
    """Coordinates of a trace of a figure, which plotly keeps as arrays or packed."""
    if isinstance(values, dict):
        return np.frombuffer(base64.b64decode(values["bdata"]), dtype=values["dtype"])
    return np.asarray(values)


KINDS = {
    "torque": (notebook_figures.plot_torque, show_torque),
    "residuals": (notebook_figures.plot_residuals, show_residuals),
    "friction": (notebook_figures.plot_friction, show_friction),
}


@pytest.mark.parametrize("kind", KINDS)
def test_a_figure_has_the_traces_of_the_page(kind: str, run: Run):
    draw, show = KINDS[kind]
    section = show(with_recordings(run))
    assert section is not None
    plots: list[Plot] = [plot for _, row in section.plots for plot in row]
    expected = [trace for plot in plots for trace in plot.traces]
    figure = draw(run)
    assert len(figure.data) == len(expected)
    for found, trace in zip(figure.data, expected, strict=True):
        assert found.name == trace.name
        np.testing.assert_array_equal(numbers(found.x), trace.x)
        np.testing.assert_array_equal(numbers(found.y), trace.y)
    assert len(figure.layout.shapes) == sum(len(plot.axes.levels) + len(plot.axes.marks) for plot in plots)
    titles = {axis.title.text for axis in figure.select_xaxes()} - {None}
    assert titles == {plot.x for plot in plots}
    assert figure.to_plotly_json()["layout"]["paper_bgcolor"] == "#ffffff"


@pytest.mark.parametrize("kind", KINDS)
def test_one_joint_is_a_part_of_all(kind: str, run: Run):
    draw, _ = KINDS[kind]
    whole, names = draw(run), run.robot.joint_names
    parts = [draw(run, joint=name, theme="dark") for name in names]
    assert sum(len(part.data) for part in parts) == len(whole.data)
    assert {part.layout.paper_bgcolor for part in parts} != {whole.layout.paper_bgcolor}
    for part in parts:
        assert 0 < len(part.data) < len(whole.data) and len({t.name for t in part.data if t.showlegend}) > 1


def test_what_is_not_there_is_said(run: Run, tmp_path: Path):
    with pytest.raises(ArmidError, match="has no joint 'joint_9'"):
        notebook_figures.plot_torque(run, joint="joint_9")
    with pytest.raises(ArmidError, match="Unknown theme 'blue'"):
        notebook_figures.plot_torque(run, theme="blue")  # pyright: ignore[reportArgumentType]
    for path in Path(run.folder).iterdir():
        (tmp_path / path.name).write_bytes(path.read_bytes())
    study = tmp_path / "study.json"
    study.write_text(study.read_text().replace(str(Path(run.folder).parent), str(tmp_path / "gone")))
    for draw, _ in KINDS.values():
        with pytest.raises(ArmidError, match=r"(?s)None of the recordings .*data=FOLDER"):
            draw(load_run(tmp_path))
        assert draw(load_run(tmp_path), data=Path(run.folder).parent).data


def test_what_is_no_value_of_armids_is_refused(run: Run):
    """A notebook gets one sentence with what to write instead, whatever it has handed over."""
    robot, plan = small_model().robot, small_plan(1)
    for draw, _ in KINDS.values():
        for wrong in ("runs/today", Path("runs/today"), None, {"run": 1}, run.robot):
            with pytest.raises(ArmidError, match=r"(?s)A run must be given; found .*load_run"):
                draw(wrong)
        with pytest.raises(ArmidError, match="A folder as data must be given; found 5"):
            draw(run, data=5)
        with pytest.raises(ArmidError, match="Unknown theme"):
            draw(run, theme=["dark"])
        with pytest.raises(ArmidError, match="has no joint 2"):
            draw(run, joint=2)
    for arguments, expected in {
        ("plan.json", robot): "load_plan",
        (run, robot): "load_plan",
        (plan, "arm.urdf"): "load_robot",
        (robot, plan): "load_plan",
    }.items():
        with pytest.raises(ArmidError, match=rf"(?s)must be given; found .*{expected}"):
            notebook_figures.plot_plan(*arguments)
    with pytest.raises(ArmidError, match=r"(?s)Limits of joints must be given; found a dict"):
        notebook_figures.plot_plan(plan, robot, limits={})


def test_a_plan_stands_against_its_limits():
    robot, plan = small_model().robot, small_plan(1)
    figure = notebook_figures.plot_plan(plan, robot)
    limits = described_limits(robot)
    drawn = [float(numbers(trace.y)[0]) for trace in figure.data if trace.name == "limit"]
    stated = [x for each in (limits.lower, limits.upper) for x in each]
    stated += [way * x for way in (1, -1) for each in (limits.velocity, limits.effort) for x in each]
    assert sorted(drawn) == sorted(x for x in stated if np.isfinite(x))
    one = notebook_figures.plot_plan(plan, robot, joint=robot.joint_names[1])
    assert JOINTS * sum(t.name != "limit" for t in one.data) == sum(t.name != "limit" for t in figure.data)
    with pytest.raises(ArmidError, match="moves 3 joints"):
        notebook_figures.plot_plan(plan, small_model().robot.lock({robot.joint_names[0]: 0.0}))
