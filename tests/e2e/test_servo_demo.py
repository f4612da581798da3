"""`armid demo --servo`: the whole way on the virtual hobby arm, and its comparison with the truth."""

from __future__ import annotations

import pytest

from armid.cli.servos.servo_demo import KINDS, compare_with_truth
from command_line import Armid, command_line

pytest.importorskip("mujoco")


@pytest.fixture
def armid(capfd, monkeypatch, tmp_path) -> Armid:
    return command_line(capfd, monkeypatch, tmp_path)


@pytest.mark.long
def test_the_demo_finds_the_truth(armid, tmp_path):
    """The stiffness comes from the weight of links that are described with an error of 5 %."""
    done = armid("demo", "--servo", "--out", "demo", "--json")
    assert done.code == 0, done.err
    compared = done.json["truth"]
    assert len(compared) == 6 * len(KINDS)
    assert max(abs(each["error"]) for each in compared if each["kind"] == "stiffness") < 0.25
    assert max(abs(each["error"]) for each in compared if each["kind"] == "delay") < 0.2 * 0.02  # of a sample
    score = done.json["validation"]
    assert score["model"]["total"] < 0.05 * score["command"]["total"]
    assert (tmp_path / "demo" / "result" / "servo.json").is_file()
    assert (tmp_path / "demo" / "unseen" / "truth.json").is_file()


def test_a_preset_of_the_other_demo_is_refused(armid, tmp_path):
    done = armid("demo", "--servo", "--preset", "thesis")
    assert done.code != 0 and "exclude each other" in done.err and not (tmp_path / "runs").exists()


def test_errors_are_relative_but_for_offsets_and_delays():
    values = [
        {"kind": kind, "joint": "b", "value": value, "low": value - 1e-3, "high": value + 1e-3}
        for kind, value in (("stiffness", 11.0), ("delay", 0.01), ("FS", 0.0501), ("rotor_inertia", 0.02))
    ]
    truth = {
        "servo": {"stiffness": [1.0, 10.0], "delay": [0.0, 0.012]},
        "parameters": {"FS_2": 0.05, "IA_2": 0.01, "FS_1": 9.0, "IA_1": 9.0},
    }
    found = compare_with_truth({"joints": ["a", "b"], "values": values}, truth)
    assert [each["error"] for each in found] == pytest.approx([0.1, -0.002, 0.002, 1.0])
    assert [each["inside"] for each in found] == [False, False, True, False]
