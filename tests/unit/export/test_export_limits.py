"""Limits in files of their own: those that are known, none of zero, asked for where the format needs them."""

from __future__ import annotations

import xml.etree.ElementTree as ET

import pytest

from armid.cli.motion.number_options import parse_limits
from armid.errors import ArmidError, OutputError
from armid.export.write import export_run
from armid.robot import load_robot
from exports import run_of

TABLE = """name = "arm"
convention = "modified"
[[joint]]
name = "turn"
kind = "continuous"
{turn}
[[joint]]
name = "lift"
alpha = "pi/2"
position = [-1, 1]
{lift}
[[joint]]
name = "slide"
kind = "prismatic"
{slide}
"""
BOTH = "velocity = 2\neffort = 80"


def run(tmp_path, **given):
    path = tmp_path / "arm.toml"
    path.write_text(TABLE.format(**{"turn": "", "lift": BOTH, "slide": BOTH + "\nposition = [0, 0.4]", **given}))
    return run_of(tmp_path / "run", path)


def limits(path):
    found = {joint.get("name"): joint.find("limit") for joint in ET.parse(path).getroot().iter("joint")}
    return {name: None if limit is None else dict(limit.attrib) for name, limit in found.items()}


@pytest.mark.parametrize("turn", ["", "velocity = 2", "effort = 80"])
def test_a_continuous_joint_without_limits_has_none_in_the_file(tmp_path, turn):
    exported = export_run(run(tmp_path, turn=turn), "urdf", tmp_path / "out.urdf")
    found = limits(exported.path)
    assert found["turn"] is None
    assert float(found["lift"]["effort"]) == 80.0 and float(found["slide"]["upper"]) == 0.4
    (said,) = [finding for finding in exported.findings if finding.code == "limits-unknown"]
    assert "turn" in said.evidence and "--limit turn." in said.remedy
    again = load_robot(exported.path)
    assert [joint.kind for joint in again.joints] == ["continuous", "revolute", "prismatic"]


def test_limits_that_are_known_are_written(tmp_path):
    exported = export_run(run(tmp_path, turn=BOTH), "urdf", tmp_path / "out.urdf")
    assert {key: float(value) for key, value in limits(exported.path)["turn"].items()} == {
        "effort": 80,
        "velocity": 2,
    }
    assert not {"limits-unknown", "limits-given"} & {finding.code for finding in exported.findings}


def test_joints_with_stops_ask_for_theirs(tmp_path):
    made = run(tmp_path, lift="velocity = 2", slide="")
    with pytest.raises(OutputError, match="are missing: lift, slide") as caught:
        export_run(made, "urdf", tmp_path / "out.urdf")
    assert not (tmp_path / "out.urdf").exists() and not list(tmp_path.glob("*.armid.json"))
    option = caught.value.remedy.partition("--limit ")[2]
    assert (
        option
        == "turn.velocity=2,turn.effort=100,lift.effort=100,slide.velocity=2,slide.effort=100,slide.position=-0.5:0.5"
    )
    exported = export_run(made, "urdf", tmp_path / "out.urdf", limits=parse_limits([option]))
    found = limits(exported.path)
    assert [float(x) for x in found["slide"].values()] == [-0.5, 0.5, 100.0, 2.0]
    assert float(found["lift"]["velocity"]) == 2.0 and float(found["lift"]["effort"]) == 100.0
    assert "only examples" in caught.value.remedy
    (said,) = [finding for finding in exported.findings if finding.code == "limits-given"]
    assert "lift.effort = 100" in said.evidence and "slide.lower = -0.5, slide.upper = 0.5" in said.evidence
    assert "lift.velocity" not in said.evidence  # the description has it


def test_everything_that_is_missing_is_asked_for_at_once(tmp_path):
    """One option line, also of a continuous joint, which needs no limits; no finding asks for more afterwards."""
    made = run(tmp_path, turn="effort = 5", lift="velocity = 2")
    with pytest.raises(OutputError, match=r"are missing: lift \(and of turn") as caught:
        export_run(made, "urdf", tmp_path / "out.urdf")
    option = caught.value.remedy.partition("--limit ")[2]
    assert option == "turn.velocity=2,lift.effort=100"
    exported = export_run(made, "urdf", tmp_path / "out.urdf", limits=parse_limits([option]))
    assert "limits-unknown" not in {finding.code for finding in exported.findings}


def test_limits_are_asked_for_beside_what_else_hinders(tmp_path, monkeypatch):
    def refuse(*_, **__):
        raise OutputError("Unknown mass.", possible="--allow-unidentified", remedy="give masses.")

    monkeypatch.setattr("armid.export.preparation.refuse_unidentified", refuse)
    with pytest.raises(OutputError, match=r"Unknown mass\. A URDF needs limits") as caught:
        export_run(run(tmp_path, lift=""), "urdf", tmp_path / "out.urdf")
    assert caught.value.remedy.startswith("give masses. In addition, ") and "lift.effort=100" in caught.value.remedy


def test_no_limit_of_zero_anywhere(tmp_path):
    made = run(tmp_path, lift="", slide="")
    exported = export_run(
        made, "urdf", tmp_path / "a.urdf", limits=parse_limits(["*.velocity=3,*.effort=9,slide.position=0:1"])
    )
    assert all(
        float(each[key]) > 0.0 for each in limits(exported.path).values() if each for key in ("effort", "velocity")
    )
    text = export_run(made, "sdf", tmp_path / "a.sdf").path.read_text()
    assert "<effort>0" not in text and "<velocity>0" not in text
    assert "actuatorfrcrange" not in export_run(made, "mjcf", tmp_path / "a.xml").path.read_text()


def test_limits_of_an_edited_description_stay(tmp_path):
    first = export_run(run(tmp_path, turn=BOTH), "urdf", tmp_path / "arm.urdf").path
    with pytest.raises(OutputError, match="its limits are kept"):
        export_run(run_of(tmp_path / "b", first), "urdf", limits={("turn", "effort"): 3.0})
    with pytest.raises(ArmidError, match="no joint 'wrist'"):
        export_run(run(tmp_path), "urdf", tmp_path / "c.urdf", limits={("wrist", "effort"): 3.0})
