"""The verdict of a page in words: what weighs most first, lines of a study as code, many sentences folded."""

from __future__ import annotations

import re
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from armid.errors import Finding
from armid.measurement.remedy_builders import lines
from armid.remedy import NOTE
from armid.report.data import trust
from armid.report.data.page_data import PageData, gather
from armid.report.data.residual_dependence import ResidualShares
from armid.report.data.trust import judge_trust
from armid.report.page import render
from armid.report.sections.verdict import FIRST, show_verdict
from armid.runs.run import load_run, save_run
from armid.study.config import load_study
from armid.study.identify import identify
from armid.validation.torque_validation import Score
from labs import STUDY, write_recordings, write_study
from reports import Page, make_run

pytest.importorskip("plotly")
pytest.importorskip("jinja2")


@pytest.fixture(scope="module")
def material(tmp_path_factory: pytest.TempPathFactory) -> PageData:
    return gather(make_run(tmp_path_factory.mktemp("small")))


def scored(material: PageData, scores: tuple[Score, ...], **changes: Any) -> PageData:
    """The same with other scores on held-out motion."""
    validation = replace(material.validation, recordings=scores, **changes)
    return replace(material, records=replace(material.records, validation=validation))


@pytest.mark.parametrize("left_out", [True, False])
def test_a_run_without_validation_asks_for_it(material: PageData, left_out: bool):
    changes = {} if left_out else {"left_out": None, "verdict": "not judged"}
    words = judge_trust(scored(material, (), **changes))
    assert any(
        "left-out parts of the training data only" if left_out else "held-out motion" in each
        for each in words.doubted
    ) and any("--validate" in each for each in words.wanted)
    assert not any("validation" in each for each in words.trusted)


def test_a_large_error_on_a_joint_comes_with_advice(material: PageData):
    """A doubt about the torque is not followed by "Nothing." as the next step."""
    score = material.validation.recordings[0]
    changed = replace(score, rms=score.spread * [0.4, 0.02, 0.02])
    words = judge_trust(scored(material, (changed,)))
    assert any("RMS error above" in each and "joint_1" in each for each in words.doubted)
    (advice,) = [each for each in words.wanted if "torque error of" in each]
    assert "joint_1" in advice and "joint_2" not in advice and "armid doctor" in advice


def test_bands_that_do_not_hold_are_doubted(material: PageData):
    changed = replace(material.validation.recordings[0], coverage95=np.array([0.5, 0.96, np.nan]))
    words = judge_trust(scored(material, (changed,)))
    (narrow,) = [each for each in words.doubted if "too narrow" in each]
    assert "joint_1 (50\u00a0%)" in narrow and "joint_2" not in narrow


@pytest.mark.parametrize(
    ("kind", "parts", "longer"),
    [("spectral", 5, False), ("period", 9, False), ("white", 0, False), ("block", 6, True)],
)
def test_more_recording_is_asked_for_only_where_blocks_are_few(
    material: PageData, kind: str, parts: int, longer: bool
):
    narrow = replace(material.validation.recordings[0], coverage95=np.array([0.5, 0.96, np.nan]))
    estimate = material.run.estimate
    report = replace(estimate.fit.report, parts=parts)
    fit = replace(estimate.fit, covariance_kind=kind, report=report)
    run = replace(material.run, estimate=replace(estimate, fit=fit))
    wanted = " ".join(judge_trust(scored(replace(material, run=run), (narrow,))).wanted)
    assert ("record longer" in wanted) is longer
    assert ("more recordings of the same motion do not change" in wanted) is not longer


def test_an_error_where_joints_stand_asks_for_no_more_motions(material: PageData):
    (unseen,) = material.of_role("validate")
    others = [each for each in material.recordings if each is not unseen]
    speed = unseen.dq.copy()
    speed[:3] = 0.0
    wrong = 100.0 * float(max(material.training_rms()))
    doubted: dict[bool, str] = {}
    for standing in (True, False):
        error = np.zeros_like(unseen.predicted)
        error[: 3 if standing else 50] = wrong
        predicted = unseen.measured + error
        worse = replace(material.validation.recordings[0], rms=np.sqrt(np.nanmean(error**2, axis=0)))
        recordings = (*others, replace(unseen, dq=speed, predicted=predicted))
        words = judge_trust(scored(replace(material, recordings=recordings), (worse,)))
        doubted[standing] = " ".join(words.doubted)
        assert any("more and different training motions" in each for each in words.wanted) is not standing
    assert "in which joints stand still" in doubted[True] and "times the training error" not in doubted[True]
    assert "where joints stand" not in doubted[False] and "times the training error" in doubted[False]


def test_friction_below_zero_is_doubted(material: PageData):
    fit = material.run.estimate.fit
    values = fit.values.copy()
    values[fit.names.index("FS_2")] = -50.0
    changed = replace(material.run, estimate=replace(material.run.estimate, fit=replace(fit, values=values)))
    words = judge_trust(replace(material, run=changed))
    assert any("physically impossible" in each and "FS_2" in each for each in words.doubted)
    assert not any("physically impossible" in each for each in judge_trust(material).doubted)


def test_warnings_are_passed_on_and_notes_are_not(material: PageData):
    findings = (
        Finding("a", "warning", "joint_1", "It shook.", "hold it"),
        Finding("b", "info", "", "By the way.", "never mind"),
    )
    changed = replace(material.run, estimate=replace(material.run.estimate, findings=findings))
    words = judge_trust(replace(material, run=changed))
    assert "joint_1: It shook." in words.doubted and "Hold it" in words.wanted
    assert not any("way" in each or "mind" in each for each in (*words.doubted, *words.wanted))


@pytest.mark.parametrize("verdict", ["pass", "not judged", "fail"])
def test_the_badge_tells_the_worst_that_is_known(material: PageData, verdict: str):
    """A pass on held-out torque is no green light where the page warns of a simulation, or of an error in the log."""
    judged = scored(material, material.validation.recordings, verdict=verdict)
    assert judged.verdict is not None
    sound = replace(
        judged, verdict=replace(judged.verdict, certificate=replace(judged.verdict.certificate, blame=()))
    )
    unreal = replace(judged, verdict=replace(judged.verdict, pose=replace(judged.verdict.pose, min_eigenvalue=-1.0)))
    error = (Finding("torque-sign", "error", "tau", "Turned.", "turn it"),)
    wrong = replace(sound, run=replace(sound.run, estimate=replace(sound.run.estimate, findings=error)))
    badges = [show_verdict(each).content for each in (sound, unreal, wrong)]
    if verdict == "fail":
        assert {badge["badge"] for badge in badges} == {"✗ fail"} and {badge["colour"] for badge in badges} == {
            "fail"
        }
        return
    plain, simulated, contradicted = badges
    assert (plain["colour"], plain["badge"][2:]) == (verdict.replace(" ", "-"), verdict)
    assert simulated["colour"] == contradicted["colour"] == "fail"
    assert simulated["badge"] == "✗ not for simulation" and "Do not use them in a simulation" in simulated["sentence"]
    assert contradicted["badge"] == "✗ error found"
    assert '<p class="verdict fail"><b>✗ not for simulation</b>' in render(unreal)


def test_a_line_of_a_study_stays_one(material: PageData):
    """Remedies for a study are code, with the table that it belongs to, and no sentence."""
    findings = (
        Finding(
            "a", "warning", "", "Light.", lines("near the description", "estimation", physical={"prior": "log-det"})
        ),
        Finding("b", "error", "q", "Turned.", lines(position_sign=[1, -1])),
        Finding("c", "warning", "", "Rests.", lines("nothing moves there", exclude=[[1.0, 2.0]])),
        Finding("d", "error", "effort", "Small.", gains := lines("N·m/A", drive_gain=[12.345678] * 12)),
    )
    changed = replace(material, run=replace(material.run, estimate=replace(material.run.estimate, findings=findings)))
    wanted = judge_trust(changed).wanted
    assert {
        'In [estimation] of the study (near the description): `physical = { prior = "log-det" }`',
        "In the study: `position_sign = [1, -1]`",
        "In the study (nothing moves there): `exclude = [[1.0, 2.0]]`",
        f"In the study (N·m/A): `{gains.partition(NOTE)[0]}`",
    } <= set(wanted)
    html = render(changed)
    assert "</pre>" in html and not re.search(r"</pre>\s*:", html)  # no sentence begins with what followed a block
    assert "<code>position_sign = [1, -1]</code>" in html and "`" not in Page(html).prose
    doubted = judge_trust(changed).doubted
    assert doubted.index("q: Turned.") < doubted.index("Light.")  # what contradicts comes before what questions


def test_many_sentences_are_folded_and_none_is_lost(material: PageData):
    findings = tuple(Finding("a", "warning", "", f"Doubt {k}.") for k in range(20))
    changed = replace(material.run, estimate=replace(material.run.estimate, findings=findings))
    page = Page(render(replace(material, run=changed)))
    folded = len(judge_trust(replace(material, run=changed)).doubted) - FIRST
    assert (
        folded > 10 and f"and {folded} more" in page.prose and page.prose.count("Doubt 19.") == 2
    )  # provenance, too
    assert sum(tag == "details" for tag, _ in page.elements) >= 1


def test_recordings_of_one_name_are_told_apart(tmp_path: Path):
    for name in ("train", "check"):
        (tmp_path / name).mkdir()
    write_recordings(tmp_path)
    (tmp_path / "run1.csv").rename(tmp_path / "train" / "run.csv")
    (tmp_path / "run2.csv").rename(tmp_path / "check" / "run.csv")
    text = STUDY.replace("run1.csv", "train/run.csv").replace("run2.csv", "check/run.csv")
    result = identify(load_study(write_study(tmp_path, text)))
    page = Page(render(gather(load_run(save_run(result, tmp_path / "run")))))
    assert "Validation: check/run.csv" in page.prose and "Training: train/run.csv" in page.prose


def test_a_run_is_shown_from_anywhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Made with paths relative to one working folder, reported in another."""
    write_recordings(tmp_path)
    monkeypatch.chdir(write_study(tmp_path).parent)
    save_run(identify(load_study("study.toml")), "run")
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    assert gather(load_run("../run")).missing == ()
    shutil.move(tmp_path / "run2.csv", tmp_path / "elsewhere")  # with all that belongs to it, to another place
    assert gather(load_run("../run")).missing == ()


def test_sticking_is_not_taken_for_memory(material: PageData, monkeypatch: pytest.MonkeyPatch):
    """A residual after reversals calls for friction with memory, unless the joint was found to stick there."""
    monkeypatch.setattr(trust, "residual_shares", lambda *_: ResidualShares(0.0, 0.0, 0.5))
    (seen,) = material.of_role("validate")
    measured = np.zeros_like(seen.measured)
    measured[5:9, 1] = np.nan
    stuck = replace(material, recordings=(replace(seen, measured=measured),))
    estimate = material.run.estimate
    told = Finding("sticking", "info", "a.csv", "Joints stand.")
    findings = replace(material.run, estimate=replace(estimate, findings=(*estimate.findings, told)))
    plain = [each for each in judge_trust(stuck).wanted if "reversals" in each]
    assert len(plain) == 1 and "with hysteresis instead" in plain[0] and "every joint" in plain[0]
    sticking, memory = (each for each in judge_trust(replace(stuck, run=findings)).wanted if "reversals" in each)
    assert "reversals of joint_2 is caused by sticking" in sticking and "less time at low speed" in sticking
    assert "with hysteresis instead" in memory and "joint_2" not in memory
    rests = Finding("sticking", "warning", "joint_1", "a.csv: The joint mostly stands still.")
    resting = replace(material.run, estimate=replace(estimate, findings=(*estimate.findings, rests)))
    sticking, memory = (each for each in judge_trust(replace(material, run=resting)).wanted if "reversals" in each)
    assert "reversals of joint_1 is caused by sticking" in sticking  # although its rows count
    assert "with hysteresis instead" in memory and "joint_1" not in memory
