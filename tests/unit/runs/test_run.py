"""Runs on disk: whole or not at all, read back, applied to more data."""

from __future__ import annotations

import json
import os
import shutil
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest

from armid.dataclass_files import load
from armid.errors import ArmidError, OutputError, StudyError
from armid.estimation.estimate_record import Estimate
from armid.excitation.fourier import save_plan
from armid.measurement.log_format import LogFormat
from armid.output import renaming
from armid.runs import run as run_module
from armid.runs.run import FORMAT, load_run, refuse_folder, save_run
from armid.runs.validation_and_prediction import motion_of, predict, validate_run, write_torque
from armid.study.config import ModelChoice, load_study
from armid.study.identify import Result, identify
from labs import RUN_FILES, small_folder, small_plan, small_recording, write_recording, write_recordings, write_study


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The small arm, its recordings and its study."""
    return small_folder(tmp_path_factory)


@pytest.fixture(scope="module")
def result(folder: Path) -> Result:
    return identify(load_study(folder / "study.toml"))


HALF = """
[robot]
description = "small.urdf"
[[recording]]
path = "run1.csv"
part = [0.0, 0.5]
[[recording]]
path = "run1.csv"
role = "validate"
part = [0.5, 1.0]
"""
"""One recording of which the first half trains and the second validates."""


def contents(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()}


def test_a_run_survives_its_folder(result: Result, tmp_path: Path):
    folder = save_run(result, tmp_path / "deep" / "run")
    assert contents(folder) == RUN_FILES and contents(folder.parent) == {"run"}
    run = load_run(folder)
    assert run.robot.joint_names == result.robot.joint_names and run.model.terms == result.model.terms
    assert run.processing == result.study.processing
    np.testing.assert_array_equal(run.estimate.fit.values, result.estimate.fit.values)
    np.testing.assert_array_equal(run.estimate.fit.covariance, result.estimate.fit.covariance)
    assert run.estimate.findings == result.estimate.findings and run.estimate.terms == result.estimate.terms
    assert run.trained_on == (result.training[0].sha256,)
    motion = small_plan(5).sample(50.0)
    np.testing.assert_array_equal(predict(run, motion), predict(load_run(folder), motion))


def test_the_estimate_of_another_run_is_refused(result: Result, folder: Path, tmp_path: Path):
    """Also in a run of an earlier version, which has no digests of its archives."""
    other = identify(replace(load_study(folder / "study.toml"), model=ModelChoice(("rigid-body", "viscous"))))
    mixed, source = save_run(result, tmp_path / "mixed"), save_run(other, tmp_path / "other")
    (mixed / "estimate.npz").write_bytes((source / "estimate.npz").read_bytes())
    with pytest.raises(ArmidError, match="was changed or damaged"):
        load_run(mixed)
    kept = json.loads((mixed / "model.json").read_text())
    del kept["sha256"]
    (mixed / "model.json").write_text(json.dumps(kept))
    with pytest.raises(ArmidError, match="is not the estimate of this run"):
        load_run(mixed)


def test_the_kept_study_is_the_resolved_one(result: Result, tmp_path: Path):
    kept = json.loads((save_run(result, tmp_path / "run") / "study.json").read_text())
    assert kept["model"]["terms"] == ["rigid-body", "viscous", "coulomb", "offset"]
    assert kept["processing"]["cutoff"] == 5.0 and kept["estimation"]["method"] == "wls"
    assert [each["role"] for each in kept["recordings"]] == ["train", "validate"]


def test_everything_of_a_reading_survives(result: Result, tmp_path: Path):
    reading = LogFormat(
        rate=100.0, torque_sign=[1, -1, 1], drive_gain=[2.0, 3.0, 4.0], drive_gain_deviation=0.1,
        position_sign=[1, 1, -1], time_unit=0.001,
        transmission=2.0 * np.eye(3), joint_offset=[0.1, 0.2, 0.3], columns={"q": "q{}"}, joints=["a", "b", "c"],
        exclude=[[1.0, 2.0]], period=8.0, start=0.5, consecutive=True, units=["deg", "rad", "deg"], preset="ur-rtde",
    )  # fmt: skip
    choices = (replace(result.study.recordings[0], reading=reading), *result.study.recordings[1:])
    changed = replace(result, study=replace(result.study, recordings=choices), given_format=None)
    found = load_run(save_run(changed, tmp_path / "run")).log_format
    for name, value in asdict(reading).items():
        np.testing.assert_array_equal(getattr(found, name), value, err_msg=name)


def test_shapes_memory_and_load_survive(folder: Path, tmp_path: Path):
    """Tuples of numbers, the bodies of the load to the last bit, and what prediction makes of them."""
    terms = ("rigid-body", "viscous", "coulomb", "offset", "hysteresis", "ripple")
    shapes = {"coulomb": {"width": 0.02}, "hysteresis": {"widths": [0.01, 0.05]}, "ripple": {"harmonics": [2, 3]}}
    result = identify(replace(load_study(folder / "study.toml"), model=ModelChoice(terms, shapes)))
    bodies = np.random.default_rng(0).normal(size=(3, 10))
    result = replace(result, model=replace(result.model, load_parameters=bodies))
    run = load_run(save_run(result, tmp_path / "run"))
    assert run.model.terms == result.model.terms
    assert np.array_equal(run.model.load_parameters, bodies)
    assert run.estimate.terms == result.estimate.terms
    assert {use.name: use.shapes for use in run.estimate.terms} == {
        "rigid-body": {},
        "viscous": {},
        "coulomb": {"width": 0.02},
        "offset": {},
        "hysteresis": {"widths": (0.01, 0.05)},
        "ripple": {"harmonics": (2, 3), "motor_harmonics": ()},
    }
    found, _ = validate_run(run, [str(folder / "run2.csv")], {})
    np.testing.assert_allclose(found.recordings[0].rms, result.validation.recordings[0].rms, rtol=1e-12)
    moved, _ = motion_of(run, str(folder / "run2.csv"), rate=40.0, reading={})
    assert moved.memory is not None and np.array_equal(moved.memory, run.model.remember(moved).memory)
    unloaded = replace(result, model=replace(result.model, load_parameters=None))
    assert load_run(save_run(unloaded, tmp_path / "unloaded")).model.load_parameters is None


def test_memory_begins_anew_after_a_gap(folder: Path, tmp_path: Path):
    chosen = ModelChoice(("rigid-body", "viscous", "coulomb", "hysteresis"), {"hysteresis": {"widths": [0.05]}})
    result = identify(replace(load_study(folder / "study.toml"), model=chosen))
    run = load_run(save_run(result, tmp_path / "run"))
    log = small_recording(2)
    there = np.delete(np.arange(log.samples), np.s_[600:700])
    rows = {name: getattr(log, name)[there] for name in ("time", "q", "effort", "valid")}
    moved, _ = motion_of(run, str(write_recording(replace(log, **rows), tmp_path / "gap.csv")), rate=40.0, reading={})
    gap = int(np.argmax(np.diff(moved.time))) + 1
    assert gap == 600 and moved.memory is not None
    for part in (moved[:gap], moved[gap:]):
        assert np.array_equal(part.memory, run.model.remember(part).memory)
    assert not np.array_equal(moved.memory, run.model.remember(moved).memory)


def test_a_run_is_replaced_by_another(result: Result, tmp_path: Path):
    folder = save_run(result, tmp_path / "run")
    (folder / "estimate.json").write_text("{}")
    save_run(result, folder)
    assert json.loads((folder / "estimate.json").read_text())["robot"] == "small"
    assert contents(tmp_path) == {"run"}


def test_an_empty_folder_is_taken(result: Result, tmp_path: Path):
    (tmp_path / "run").mkdir()
    assert contents(save_run(result, tmp_path / "run")) == RUN_FILES


def test_a_folder_that_holds_something_else_is_left_alone(result: Result, tmp_path: Path):
    thesis = tmp_path / "thesis"
    thesis.mkdir()
    (thesis / "chapter1.txt").write_text("years of work")
    for refuse in (lambda: save_run(result, thesis), lambda: refuse_folder(thesis)):
        with pytest.raises(OutputError, match="is not a run of armid") as caught:
            refuse()
        assert "--out" in caught.value.remedy
    assert contents(thesis) == {"chapter1.txt"} and contents(tmp_path) == {"thesis"}


def test_the_working_folder_is_not_pulled_away(result: Result, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(OutputError, match="is the current working folder"):
        save_run(result, ".")
    assert contents(tmp_path) == set()


def test_a_folder_below_a_file_cannot_be_written(result: Result, tmp_path: Path):
    (tmp_path / "file").write_text("in the way")
    for target in ("file", "file/run", "file/deep/run"):
        with pytest.raises(OutputError, match="file"):
            save_run(result, tmp_path / target)
    assert (tmp_path / "file").read_text() == "in the way" and contents(tmp_path) == {"file"}


@pytest.mark.skipif(os.geteuid() == 0, reason="the superuser may write everywhere")
def test_a_folder_without_permission_cannot_be_written(result: Result, tmp_path: Path):
    tmp_path.chmod(0o500)
    try:
        with pytest.raises(OutputError, match="could not be written: Permission denied"):
            save_run(result, tmp_path / "run")
    finally:
        tmp_path.chmod(0o700)
    assert contents(tmp_path) == set()


@pytest.mark.parametrize("failure", [KeyboardInterrupt(), OSError(28, "No space left on device")])
@pytest.mark.parametrize("before", [False, True])
def test_a_write_that_breaks_off_leaves_what_was(
    result: Result, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, failure: BaseException, before: bool
):
    folder = tmp_path / "run"
    if before:
        save_run(result, folder)
        kept = {path.name: path.read_bytes() for path in folder.iterdir()}

    def broken(*arguments: object) -> None:
        raise failure

    for name in ("save", "replace_file"):  # after some files, and before any
        with monkeypatch.context() as patch:
            patch.setattr(run_module, name, broken)
            with pytest.raises(KeyboardInterrupt if isinstance(failure, KeyboardInterrupt) else OutputError):
                save_run(result, folder)
        assert contents(tmp_path) == ({"run"} if before else set())
    if before:
        assert {path.name: path.read_bytes() for path in folder.iterdir()} == kept


def test_a_rename_that_fails_brings_the_old_run_back(result: Result, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """On a system that cannot exchange two names in one step."""
    monkeypatch.setattr(renaming, "_exchange", lambda *_: False)
    folder = save_run(result, tmp_path / "run")
    rename = Path.rename

    def second_fails(self: Path, target: Path) -> Path:
        if target.name == "run" and not self.name.endswith(".old"):
            raise OSError(5, "Input/output error")
        return rename(self, target)

    monkeypatch.setattr(Path, "rename", second_fails)
    with pytest.raises(OutputError, match="Input/output error"):
        save_run(result, folder)
    assert contents(tmp_path) == {"run"} and contents(folder) == RUN_FILES


@pytest.mark.parametrize(
    "name", sorted(RUN_FILES - {"estimate.json", "validation.json", "information.npz", "study.json"})
)
@pytest.mark.parametrize("damage", ["gone", "cut", "other"])
def test_a_damaged_run_is_refused(result: Result, tmp_path: Path, name: str, damage: str):
    path = save_run(result, tmp_path / "run") / name
    if damage == "gone":
        path.unlink()
    else:
        path.write_bytes(path.read_bytes()[:100] if damage == "cut" else b"[1, 2]")
    with pytest.raises(ArmidError, match=name):
        load_run(tmp_path / "run")


@pytest.mark.parametrize("digest", [["1f"], 3, None])
def test_a_digest_that_is_no_text_is_refused(result: Result, tmp_path: Path, digest: object):
    path = save_run(result, tmp_path / "run") / "model.json"
    path.write_text(json.dumps({**json.loads(path.read_text()), "trained_on": [digest]}))
    with pytest.raises(ArmidError, match="digest must be a string"):
        load_run(tmp_path / "run")


def test_a_run_of_a_version_with_other_fields_is_refused(result: Result, tmp_path: Path):
    path = save_run(result, tmp_path / "run") / "estimate.npz"
    with np.load(path) as archive:
        arrays = {name: archive[name] for name in archive.files}
    header = json.loads(bytes(arrays["value.json"]))
    header["value"]["grounds"] = header["value"].pop("fit")
    arrays["value.json"] = np.frombuffer(json.dumps(header).encode(), dtype=np.uint8)
    np.savez(path, **arrays)
    with pytest.raises(ArmidError, match="another version of armid"):
        load(Estimate, path)


@pytest.mark.parametrize("name", ["robot.npz", "estimate.npz", "information.npz"])
def test_an_archive_that_was_changed_is_refused(result: Result, tmp_path: Path, name: str):
    path = save_run(result, tmp_path / "run") / name
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(bytes(data))
    with pytest.raises(ArmidError, match=rf"{name} was changed or damaged"):
        load_run(tmp_path / "run")


def test_a_run_without_digests_is_read(result: Result, tmp_path: Path):
    path = save_run(result, tmp_path / "run") / "model.json"
    kept = json.loads(path.read_text())
    assert set(kept.pop("sha256")) == {"robot.npz", "estimate.npz", "information.npz"}
    path.write_text(json.dumps(kept))
    assert load_run(tmp_path / "run").estimate.method == result.estimate.method


def test_a_run_of_a_later_format_is_refused(result: Result, tmp_path: Path):
    path = save_run(result, tmp_path / "run") / "model.json"
    kept = json.loads(path.read_text())
    assert kept["format"] == FORMAT
    path.write_text(json.dumps({**kept, "format": FORMAT + 1}))
    with pytest.raises(ArmidError, match=f"has format {FORMAT + 1}; this version of armid reads format {FORMAT}"):
        load_run(tmp_path / "run")


def test_what_is_no_run_is_refused(tmp_path: Path):
    for path in (tmp_path, tmp_path / "nowhere"):
        with pytest.raises(ArmidError, match="is not a run of armid"):
            load_run(path)


# A run applied to more data --------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def saved(result: Result, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return save_run(result, tmp_path_factory.mktemp("runs") / "run")


def test_a_run_judges_an_unseen_recording_as_its_study_would(result: Result, saved: Path, folder: Path):
    found, _ = validate_run(load_run(saved), [str(folder / "run2.csv")], {})
    np.testing.assert_allclose(found.recordings[0].rms, result.validation.recordings[0].rms, rtol=1e-12)
    assert found.verdict == "pass" and found.checks[0].value == result.validation.checks[0].value


def test_the_doctor_looks_at_what_a_run_is_judged_by(saved: Path, folder: Path):
    run = load_run(saved)
    unseen = str(folder / "run2.csv")
    _, findings = validate_run(run, [unseen], {})
    assert [f.code for f in findings if f.severity == "error"] == []
    found, findings = validate_run(run, [unseen], {"torque_sign": -1})
    assert found.verdict == "fail" and "errors in the recordings (torque-sign)" in [c.name for c in found.checks]
    assert [(f.code, f.remedy) for f in findings if f.severity == "error"] == [("torque-sign", "torque_sign = 1")]


def test_a_run_does_not_judge_by_what_trained_it(saved: Path, folder: Path, tmp_path: Path):
    copy = shutil.copy(folder / "run1.csv", tmp_path / "another.csv")
    with pytest.raises(StudyError, match=r"another\.csv cannot be used to validate .* trained on the same data"):
        validate_run(load_run(saved), [str(copy)], {})


def test_a_file_of_which_only_a_part_trained_is_refused_too(tmp_path: Path):
    write_recordings(tmp_path)
    result = identify(load_study(write_study(tmp_path, HALF)))
    run = load_run(save_run(result, tmp_path / "run"))
    with pytest.raises(StudyError, match="trained on the same data"):
        validate_run(run, [str(tmp_path / "run1.csv")], {})


def test_what_was_cut_out_of_the_training_is_not_cut_out_of_others(folder: Path, tmp_path: Path):
    study = load_study(folder / "study.toml")
    cut_out = replace(study.recordings[0], reading=LogFormat(exclude=[[0.0, 8.0]]))
    result = identify(replace(study, recordings=(cut_out, study.recordings[1])))
    assert result.estimate.fit.rows.max() < 250
    run = load_run(save_run(result, tmp_path / "run"))
    found, _ = validate_run(run, [str(folder / "run2.csv")], {})
    np.testing.assert_allclose(found.recordings[0].rms, result.validation.recordings[0].rms, rtol=1e-12)


def test_the_motion_of_plans_and_recordings(saved: Path, folder: Path, tmp_path: Path):
    run = load_run(saved)
    plan = small_plan(3)
    along, _ = motion_of(run, str(save_plan(plan, tmp_path / "plan.json")), rate=40.0, reading={})
    np.testing.assert_array_equal(along.q, plan.sample(40.0).q)
    recorded, _ = motion_of(run, str(folder / "run2.csv"), rate=40.0, reading={})
    inner = slice(100, -100)
    exact = small_plan(2).sample(100.0, 2)
    np.testing.assert_allclose(recorded.q[inner], exact.q[inner], atol=2e-4)
    with pytest.raises(ArmidError, match="thesis-a1 moves 7 joints, but small has 3"):
        motion_of(run, "thesis-a1", rate=40.0, reading={})
    with pytest.raises(ArmidError, match="rate of a plan must be above 0; found 0 Hz"):
        motion_of(run, str(tmp_path / "plan.json"), rate=0.0, reading={})
    with pytest.raises(ArmidError, match=r"nowhere\.json"):
        motion_of(run, "nowhere.json", rate=40.0, reading={})


def test_a_plan_for_joints_with_other_names_is_reported(saved: Path, tmp_path: Path):
    run = load_run(saved)
    path = save_plan(small_plan(3), tmp_path / "plan.json")
    record = json.loads(path.read_text())
    path.write_text(json.dumps(record | {"joints": ["shoulder", "elbow", "wrist"]}))
    _, (finding,) = motion_of(run, str(path), rate=40.0, reading={})
    assert finding.code == "plan-of-other-joints" and "shoulder, elbow, wrist" in finding.evidence
    path.write_text(json.dumps(record | {"joints": None}))
    assert motion_of(run, str(path), rate=40.0, reading={})[1] == ()
    path.write_text(json.dumps(record | {"joints": run.robot.joint_names}))
    assert motion_of(run, str(path), rate=40.0, reading={})[1] == ()


def test_a_motion_needs_no_torque_and_no_row_is_too_slow_for_it(saved: Path, tmp_path: Path):
    recording = small_recording(2)
    assert recording.time is not None
    table = np.column_stack([recording.time, recording.q])
    np.savetxt(tmp_path / "motion.csv", table, delimiter=",", header="t,q1,q2,q3", comments="")
    run = load_run(saved)
    slow = replace(run, processing=replace(run.processing, slow=50.0, saturation=0.5))
    driven = replace(slow, log_format=LogFormat(drive_gain=[2.0, 2.0, 2.0], drive_gain_deviation=0.1))
    expected, _ = motion_of(run, str(tmp_path / "motion.csv"), rate=1.0, reading={})
    for each in (slow, driven):
        found, _ = motion_of(each, str(tmp_path / "motion.csv"), rate=1.0, reading={})
        np.testing.assert_array_equal(found.ddq, expected.ddq)
    assert expected.samples == recording.samples


@pytest.mark.parametrize("suffix", [".csv", ".npz"])
def test_torque_is_written_in_full(saved: Path, tmp_path: Path, suffix: str):
    run = load_run(saved)
    motion = small_plan(3).sample(50.0)
    torque = predict(run, motion)
    path = write_torque(tmp_path / f"torque{suffix}", motion, torque, run.robot.joint_names)
    if suffix == ".csv":
        assert path.read_text().splitlines()[0] == "t,tau1,tau2,tau3"
        table = np.loadtxt(path, delimiter=",", skiprows=1)
        time, found = table[:, 0], table[:, 1:]
    else:
        with np.load(path) as archive:
            time, found = archive["time"], archive["torque"]
            assert archive["joints"].tolist() == ["joint_1", "joint_2", "joint_3"]
    np.testing.assert_array_equal(found, torque)
    np.testing.assert_array_equal(time, motion.time)


def test_torque_is_not_written_under_another_suffix(saved: Path, tmp_path: Path):
    motion = small_plan(3).sample(50.0)
    with pytest.raises(ArmidError, match=r"\.csv nor \.npz"):
        write_torque(tmp_path / "torque.xlsx", motion, motion.q, "abc")
    assert contents(tmp_path) == set()
