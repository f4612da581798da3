"""A run made from a periodic motion as the thesis does it, and new recordings of any other motion."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest

from armid.excitation.fourier import Excitation
from armid.lab.inverse_dynamics_recording import record
from armid.measurement.recording import Recording
from command_line import Armid, command_line
from labs import SENSORS, small_model, small_recording, small_truth, write_arm, write_recording

OTHER_PERIOD = 6.0


@pytest.fixture
def armid(capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Armid:
    write_arm(tmp_path)
    write_recording(small_recording(1, repetitions=3), tmp_path / "train.csv")
    write_recording(of_other_period(), tmp_path / "other.csv")
    write_recording(open_ended(), tmp_path / "open.csv")
    return command_line(capfd, monkeypatch, tmp_path)


def of_other_period() -> Recording:
    a, b = np.random.default_rng(7).normal(0.0, 0.35, (2, 3, 4))
    motion = Excitation(2 * np.pi / OTHER_PERIOD, a, b, np.zeros(3), "other")
    rng = np.random.default_rng(8)
    return record(small_model(), small_truth(), motion, SENSORS, rng, repetitions=3)[0]


def open_ended() -> Recording:
    """A recording that stops in the middle of a period, so that its end does not meet its beginning."""
    whole = small_recording(3, repetitions=1)
    assert whole.time is not None and whole.effort is not None
    rows = slice(0, 730)
    return Recording(q=whole.q[rows], time=whole.time[rows], effort=whole.effort[rows])


def identified(armid: Armid, *options: str) -> None:
    done = armid(
        "identify", "small.urdf", "train.csv", "--period", 8, "--edges", "periodic", "--out", "run", *options
    )
    assert done.code == 0, done.err


def test_a_validation_recording_has_a_period_of_its_own(armid: Armid):
    identified(armid, "--validate", "other.csv")
    record = json.loads(Path("run/validation.json").read_text())
    assert record["verdict"] == "pass"
    found = json.loads(Path("run/estimate.json").read_text())["warnings"]
    assert any(each["code"] == "period-found" and "6 s" in each["evidence"] for each in found)


def test_any_motion_is_read_for_a_periodic_run(armid: Armid):
    identified(armid)
    for log in ("other.csv", "open.csv"):
        for command in (
            ("validate", "run", log),
            ("validate", "run", log, "--simulate"),
            ("predict", "run", log),
            ("recalibrate", "run", log, "--out", f"again-{log}"),
        ):
            done = armid(*command)
            assert done.code == 0, (command, done.err)
    for command in ("validate", "predict"):
        assert re.search("edges-dropped", armid(command, "run", "open.csv").err)


def test_period_and_edges_can_be_given_for_new_recordings(armid: Armid):
    identified(armid)
    for command in (("validate",), ("predict",), ("recalibrate", "--out", "again")):
        name, *options = command
        done = armid(name, "run", "other.csv", "--period", OTHER_PERIOD, "--edges", "drop", *options)
        assert done.code == 0, done.err
        wrong = armid(name, "run", "other.csv", "--edges", "cut", *options)
        assert wrong.code == 2 and "periodic" in wrong.err
    refused = armid("validate", "run", "open.csv", "--period", 30)
    assert refused.code == 2 and "30" in refused.err  # a stated period is not given up


def test_presets_of_logs_are_options(armid: Armid):
    for command in (("doctor", "small.urdf", "train.csv"), ("identify", "small.urdf", "train.csv")):
        wrong = armid(*command, "--preset", "kuka-fry")
        assert wrong.code == 2 and "kuka-fri" in wrong.err
        done = armid(*command, "--preset", "libfranka")
        assert done.code == 2 and "No column is called 'time'" in done.err  # which a log of libfranka has
    identified(armid)
    assert armid("validate", "run", "other.csv", "--preset", "libfranka").code == 2
    both = armid("identify", "small.urdf", "train.csv", "--preset", "libfranka", "--preset", "ur-rtde")
    assert both.code == 2 and "two log formats" in both.err
