"""Pages: whole, safe, offline, honest about what is missing; and what two runs have changed."""

from __future__ import annotations

import base64
import gzip
import json
import re
import shutil
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from armid.errors import ArmidError, Finding, MissingExtraError
from armid.report import rendering
from armid.report.comparison import changes, pair_of
from armid.report.data.page_data import PageData, gather, stored
from armid.report.data.recording_data import evaluate_recording
from armid.report.page import render, write_comparison, write_report
from armid.report.sections.provenance import show_provenance
from armid.runs.run import Run, load_run, save_run
from armid.study.config import Study, load_study
from armid.study.identify import identify
from armid.study.recordings.processed import process_each
from armid.study.recordings.reading import read_choice
from armid.study.storage.records import to_json
from armid.validation import torque_validation
from armid.validation.torque_validation import score
from labs import (
    STUDY,
    small_model,
    small_plan,
    small_recording,
    small_truth,
    write_arm,
    write_recording,
    write_recordings,
    write_study,
)
from reports import Page, make_run

pytest.importorskip("plotly")
pytest.importorskip("jinja2")

LARGEST = 6_000_000
"""Bytes of the largest page that anyone should have to mail."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("small")


@pytest.fixture(scope="module")
def run(folder: Path) -> Run:
    return make_run(folder)


@pytest.fixture(scope="module")
def material(run: Run) -> PageData:
    return gather(run)


@pytest.fixture(scope="module")
def html(material: PageData) -> str:
    return render(material)


@pytest.fixture(scope="module")
def page(html: str) -> Page:
    return Page(html)


def moved(run: Run, folder: Path) -> Run:
    """The run in another folder, its recordings left behind."""
    shutil.copytree(run.folder, folder / "run")
    record = json.loads((folder / "run" / "study.json").read_text())
    record["folder"] = str(folder / "nowhere")
    (folder / "run" / "study.json").write_text(json.dumps(record))
    return load_run(folder / "run")


def test_the_page_says_what_the_run_says(page: Page, run: Run):
    assert "✓ pass" in page.prose and "Doubtful" in page.prose and "To record or change next" in page.prose
    for name in run.estimate.fit.names:
        assert name in page.words
    for digest in run.trained_on:
        assert digest in page.words
    assert 'path = "run2.csv"' in "".join(page.words)


def test_what_friction_was_chosen_comes_before_all_that_was_looked_at(run: Run, tmp_path: Path):
    """Hundreds of candidates stand folded; what was taken is one line a joint."""
    shutil.copytree(run.folder, tmp_path / "run")
    names = [joint.name for joint in run.robot.joints]
    evidence = [
        {"joint": name, "candidate": candidate, "ratio": 0.9, "deviation": 0.02, "chosen": candidate == "ripple 2"}
        for name in names
        for candidate in ("stribeck 0.1", "ripple 2")
    ]
    joints = [{"name": name, "ratio": 0.8, "deviation": 0.01, "chosen": ["ripple 2"]} for name in names]
    record = {"why": "", "prior_weight": None, "joints": joints, "evidence": evidence}
    (tmp_path / "run" / "friction.json").write_text(json.dumps(record))
    html = render(gather(load_run(tmp_path / "run"), data=Path(run.folder).parent))
    chosen, folded, everything, pictures = (
        html.index(mark)
        for mark in (
            'id="table-laws"',
            f"<summary>All {2 * len(names)} candidate friction laws",
            'id="table-ladder"',
            'data-plot="friction',
        )
    )
    assert chosen < folded < everything < pictures
    assert "0.80 ± 0.01" in Page(html).prose


FULL_STUDY = """
[robot]
description = "small.urdf"
gravity = [0.0, 0.1, -9.8]
lock = { joint_3 = 0.25 }
[model]
terms = ["rigid-body", "coulomb", "viscous", "coulomb"]
coulomb = [{ width = 0.02, joints = ["joint_1"] }, { width = 0.05, joints = ["joint_2"] }]
[[recording]]
path = "run1.csv"
part = [0.0, 0.7]
torque_sign = [1, 1]
exclude = [[0.5, 0.6]]
joints = ["joint_1", "joint_2", ""]
[[recording]]
path = "run1.csv"
role = "validate"
part = [0.7, 1.0]
joints = ["joint_1", "joint_2", ""]
[processing]
cutoff = 4.0
trim = 0.2
[estimation]
method = "physical"
[estimation.physical]
prior = "log-det"
weight = 2.0
total_mass = [4.0, 8.0]
masses = { 1 = [1.0, 4.0] }
[estimation.robust]
"""


@pytest.mark.parametrize("text", [STUDY, FULL_STUDY], ids=["plain", "full"])
def test_the_study_on_the_page_makes_the_same_run(text: str, tmp_path: Path):
    write_recordings(tmp_path)
    result = identify(load_study(write_study(tmp_path, text)))
    run = load_run(save_run(result, tmp_path / "run"))
    section = show_provenance(gather(run))
    again = load_study(write_study(tmp_path, section.content["study"]))
    assert plain(again) == plain(result.study)
    assert identify(again).estimate.fit.values == pytest.approx(result.estimate.fit.values, rel=1e-12)
    assert Path(section.content["folder"]) == tmp_path


def plain(study: Study) -> str:
    """A study as text, without what is not said."""

    def said(value: Any) -> Any:
        if isinstance(value, dict):
            return {key: said(each) for key, each in value.items() if each is not None and said(each) not in ({}, [])}
        return [said(each) for each in value] if isinstance(value, tuple | list) else value

    record = json.loads(to_json(asdict(study)))
    return json.dumps(said(record), sort_keys=True)


def test_nothing_is_fetched(html: str, page: Page):
    assert [where for where in page.fetched if not where.startswith(("#", "data:"))] == []
    assert not re.search(r"url\(|@import", html.split("<main")[0])
    assert "//" not in "".join(re.findall(r"<(?:script|link|img|iframe)[^>]*>", html))


def test_the_page_is_small_and_holds_plotly_once(html: str, page: Page):
    assert len(html.encode()) < LARGEST
    script = gzip.decompress(base64.b64decode(page.scripts["plotly-packed"])).decode()
    assert "plotly.js v" in script[:200] and html.count("plotly-packed") == 2  # where it is, and who reads it


def test_headings_are_in_order(page: Page):
    assert page.headings[0] == 1 and page.headings.count(1) == 1
    assert max(np.diff(page.headings)) <= 1
    assert len(page.identities) == len(set(page.identities))


def test_figures_and_tables_can_be_reached_without_eyes_or_a_mouse(page: Page):
    plots = [found for tag, found in page.elements if "data-plot" in found]
    assert len(plots) > 20 and all(found["role"] == "img" and found["aria-label"] for found in plots)
    assert {found["data-plot"] for found in plots} == set(page.data["plots"])
    tables = sum(tag == "table" for tag, _ in page.elements)
    assert tables == sum(tag == "caption" for tag, _ in page.elements) == len(page.data["tables"])
    buttons = [found for tag, found in page.elements if tag == "button" and "data-copy" in found]
    assert {(found["data-copy"], found["data-form"]) for found in buttons} == {
        (key, form) for key in page.data["tables"] for form in ("latex", "csv")
    }


def test_the_same_run_gives_the_same_page(html: str, run: Run):
    assert render(gather(run)) == html


def test_names_cannot_inject(material: PageData):
    evil = '<b>x</b></script><script>alert("1")</script>'
    run = material.run
    joints = tuple(replace(joint, name=f"{evil}{k}") for k, joint in enumerate(run.robot.joints))
    finding = Finding("code", "warning", evil, evil, evil)
    estimate = replace(run.estimate, robot=evil, findings=(finding,))
    page = Page(
        render(replace(material, run=replace(run, robot=replace(run.robot, joints=joints), estimate=estimate)))
    )
    assert page.words.count(evil) >= 2 and not any(tag == "b" and "x" in found for tag, found in page.elements)
    scripts = [tag for tag, _ in page.elements if tag == "script"]
    assert len(scripts) == 3  # data, plotly, our own
    assert evil in page.data["tables"]["torque"]["csv"].replace('""', '"')


def test_prediction_and_bands_are_those_of_the_validation(material: PageData, run: Run):
    record = material.validation.recordings[0]
    (unseen,) = material.of_role("validate")
    known = np.isfinite(unseen.residual)
    rms = np.sqrt(np.nanmean(unseen.residual**2, axis=0))
    np.testing.assert_allclose(rms, record.rms, rtol=1e-9)
    inside = np.sum(np.abs(unseen.residual) <= unseen.half_band, axis=0, where=known) / known.sum(axis=0)
    np.testing.assert_allclose(inside, record.coverage95, atol=2 / len(unseen.time))
    (train,) = material.of_role("train")
    # The stream decimates before its sharp filter, the comparison filters at full rate.
    rms = np.sqrt(np.nanmean(train.residual**2, axis=0))
    np.testing.assert_allclose(rms, run.estimate.fit.residual_rms, rtol=0.01)


def test_friction_is_the_part_that_the_laws_make(material: PageData):
    """Of a model that is right, what is seen of friction is the law and the noise of the sensor."""
    (unseen,) = material.of_role("validate")
    assert np.abs(unseen.friction).max() > 1.0
    seen = unseen.residual + unseen.friction
    assert np.sqrt(np.nanmean((seen - unseen.friction) ** 2)) < 0.1


# Recordings that are gone, moved, or others ---------------------------------------------------------------------


def test_without_recordings_the_page_says_so(run: Run, tmp_path: Path):
    page = Page(render(gather(moved(run, tmp_path))))
    assert "run1.csv was not found in" in page.prose and "--data" in page.prose
    assert "plotly-packed" not in page.identities and page.data["plots"] == {}
    assert "✓ pass" in page.prose and "Torque error of each joint" in page.prose


def test_moved_recordings_are_found(run: Run, folder: Path, tmp_path: Path):
    there = tmp_path / "elsewhere"
    there.mkdir()
    for name in ("run1.csv", "run2.csv"):
        shutil.copy(folder / name, there)
    found = gather(moved(run, tmp_path), data=there)
    assert len(found.recordings) == 2 and found.missing == ()


def test_recordings_of_one_name_in_several_folders_are_told_apart_by_what_they_hold(
    run: Run, folder: Path, tmp_path: Path
):
    there = tmp_path / "elsewhere"
    for name, day in (("run1.csv", "monday"), ("run2.csv", "tuesday")):
        (there / day).mkdir(parents=True)
        shutil.copy(folder / name, there / day / name)
    write_recording(small_recording(33), there / "run1.csv")  # the first that is met is another
    elsewhere = moved(run, tmp_path)
    found = gather(elsewhere, data=there)
    assert len(found.recordings) == 2 and found.missing == ()
    (there / "monday" / "run1.csv").unlink()
    (missing,) = gather(elsewhere, data=there).missing
    assert "run1.csv has changed since the run was made" in missing and str(there / "run1.csv") in missing


def test_other_recordings_of_that_name_are_not_taken(run: Run, tmp_path: Path):
    there = tmp_path / "elsewhere"
    there.mkdir()
    for k in (1, 2):
        write_recording(small_recording(30 + k), there / f"run{k}.csv")
    found = gather(moved(run, tmp_path), data=there)
    assert found.recordings == () and all("has changed since the run was made" in each for each in found.missing)


def test_a_damaged_record_is_refused(run: Run, tmp_path: Path):
    changed = moved(run, tmp_path)
    (tmp_path / "run" / "validation.json").write_text("[1")
    with pytest.raises(ArmidError, match=r"validation\.json"):
        gather(changed)


def test_a_record_without_a_value_for_each_joint_is_refused(run: Run, tmp_path: Path):
    changed = moved(run, tmp_path)
    path = tmp_path / "run" / "validation.json"
    record = json.loads(path.read_text())
    for name in ("share", "peak", "prior_rms"):
        kept = record["recordings"][0][name]
        path.write_text(json.dumps({**record, "recordings": [{**record["recordings"][0], name: kept[:-1]}]}))
        with pytest.raises(ArmidError, match=f"{name} has 2 values for 3 joints"):
            gather(changed)


def test_without_the_extra_the_error_names_it(run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(rendering, "find_spec", lambda name: None)
    with pytest.raises(MissingExtraError) as caught:
        write_report(run, tmp_path / "page.html")
    assert "armid[report]" in caught.value.remedy and list(tmp_path.iterdir()) == []


def test_separate_rows_are_shown_without_a_clock(tmp_path: Path):
    """Samples in any order have torque, friction and velocity, but no spectrum and no reversals."""
    write_arm(tmp_path)
    rng = np.random.default_rng(2)
    for k in (1, 2):
        motion = small_plan(k).sample(50.0)
        torque = small_model().torque(motion, small_truth()) + rng.normal(0.0, 0.02, motion.q.shape)
        order = rng.permutation(motion.samples)
        states = {"q": motion.q, "dq": motion.dq, "ddq": motion.ddq, "tau": torque}
        columns = {f"{name}{j + 1}": x[order, j] for name, x in states.items() for j in range(3)}
        np.savez(tmp_path / f"run{k}.npz", **columns)  # pyright: ignore[reportArgumentType]
    study = STUDY.replace(".csv", ".npz").replace('path = "run', 'consecutive = false\npath = "run')
    run = load_run(save_run(identify(load_study(write_study(tmp_path, study))), tmp_path / "run"))
    page = Page(render(gather(run)))
    titles = {plot["layout"]["xaxis"]["title"]["text"] for plot in page.data["plots"].values()}
    assert titles == {"row", "velocity [rad/s]", "position [rad]"}


@pytest.mark.parametrize("own", [False, True])
def test_the_band_that_is_drawn_is_the_one_that_is_judged_by(
    run: Run, tmp_path: Path, own: bool, monkeypatch: pytest.MonkeyPatch
):
    """With friction of its own for each recording, too: then a further recording's scatter is in it."""
    study = load_study(Path(run.folder).parent / "study.toml")
    train = tuple(replace(each, role="train") for each in study.recordings)
    study = replace(study, recordings=train, estimation=replace(study.estimation, friction_per_recording=own))
    made = load_run(save_run(identify(study), tmp_path / "run"))
    recording, _ = read_choice(train[1], study.folder, made.robot)
    (processed,) = process_each([(train[1], recording)], made.processing, made.robot)
    drawn = evaluate_recording(made, processed)
    judged = score(made.model, made.estimate, processed.observations)
    inside = np.mean(np.abs(drawn.residual) <= drawn.half_band, axis=0, where=np.isfinite(drawn.residual))
    np.testing.assert_allclose(inside, judged.coverage95, atol=1e-12)  # the same rows
    monkeypatch.setattr(torque_validation, "COVERED_ROWS", len(drawn.time) // 4)
    between = evaluate_recording(made, processed).half_band
    # It changes as slowly as the motion, but for the rows about reversals, where friction changes its sign.
    slow = np.abs(drawn.dq) < 0.1 * np.abs(drawn.dq).max(axis=0)
    for _ in range(4):  # rows between which the interval is drawn
        slow[1:] |= slow[:-1]
        slow[:-1] |= slow[1:]
    moving = np.where(slow, np.nan, between / drawn.half_band)
    assert np.isfinite(moving).mean() > 0.5
    assert np.nanmax(np.abs(moving - 1.0)) < 0.2


def test_a_run_that_was_never_checked_has_a_page(run: Run, tmp_path: Path):
    """No validation, and friction of its own for each recording: copies, means of friction, nothing empty."""
    study = load_study(Path(run.folder).parent / "study.toml")
    both = tuple(replace(each, role="train") for each in study.recordings)
    study = replace(study, recordings=both, estimation=replace(study.estimation, friction_per_recording=True))
    page = Page(render(gather(load_run(save_run(identify(study), tmp_path / "run")))))
    assert "every check on left-out training data passed" in page.prose and "FV_1[2]" in page.words
    assert "checks" in page.data["tables"]
    assert "Residuals on training motion" in page.prose and "nan" not in page.prose.lower().split()
    assert "FV_{1}^{(2)}" in page.data["tables"]["parameters"]["latex"]
    assert "–" not in page.data["tables"]["friction"]["latex"] and "the mean is shown" in page.prose


# Two runs -------------------------------------------------------------------------------------------------------


def changed_run(run: Run, name: str, by: float) -> Run:
    """A run in which one parameter has moved by so many of its half intervals."""
    fit = run.estimate.fit
    k = fit.names.index(name)
    values = fit.values.copy()
    values[k] += by * 0.5 * np.ptp(fit.intervals[k])
    return replace(run, estimate=replace(run.estimate, fit=replace(fit, values=values)))


def test_only_changes_beyond_the_intervals_count(run: Run):
    pair = pair_of(stored(run), stored(changed_run(run, "FS_2", 3.0)))
    found = changes(pair)
    assert found[0].name == "FS_2" and found[0].size == pytest.approx(3.0 / np.sqrt(2.0))
    assert [each.size for each in found[1:]] == [0.0] * (len(run.estimate.fit.names) - 1)
    small = changes(pair_of(stored(run), stored(changed_run(run, "FS_2", 1.3))))
    assert small[0].size < 1.0  # beyond either interval alone, not beyond that of the difference


def test_a_comparison_is_a_page(run: Run, tmp_path: Path):
    path = write_comparison(run, changed_run(run, "FV_1", -5.0), tmp_path / "change.html")
    page = Page(path.read_text(encoding="utf-8"))
    assert "1 of" in page.prose and "FV_1" in page.prose and "plotly-packed" not in page.identities
    same = Page(write_comparison(run, run, tmp_path / "same.html").read_text(encoding="utf-8"))
    assert "unchanged" in same.prose


def test_runs_of_different_arms_are_not_compared(run: Run):
    joints = tuple(replace(joint, name=f"other_{joint.name}") for joint in run.robot.joints)
    other = replace(run, robot=replace(run.robot, joints=joints))
    with pytest.raises(ArmidError, match="other_joint_1"):
        pair_of(stored(run), stored(other))
