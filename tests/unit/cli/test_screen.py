"""Tables of the screen: friction that was chosen, where its prior comes from, and errors with what they are of."""

from __future__ import annotations

from dataclasses import replace
from io import StringIO
from typing import Any

import numpy as np
import pytest
from rich.console import Console

from armid.cli.commands.doctor import _report
from armid.cli.console import print_error, print_findings, validation_table
from armid.cli.parameter_tables import friction_selection_table, print_links
from armid.errors import ArmidError, EstimationError, Finding
from armid.estimation.estimate_record import Estimate
from armid.estimation.friction.selection import FrictionSelection, SelectionEvidence
from armid.estimation.link_properties import link_table
from armid.estimation.prior import CHOSEN, GIVEN, weight_finding
from armid.estimation.standard_parameter_resolution import PriorUse
from armid.measurement.remedy_builders import lines
from armid.model.terms import Hysteresis, Stribeck
from armid.study.diagnosis import Diagnosis, diagnosed_error
from armid.study.selection_prior_options import with_origin_of_weight
from armid.validation.torque_validation import Score, Validation
from cranes import CRANE, estimate, model, problem
from labs import small_model


def printed(table: Any, width: int = 80) -> str:
    screen = StringIO()
    Console(file=screen, width=width, highlight=False).print(table)
    return screen.getvalue()


def ladder(weight: float | None = 421.0) -> FrictionSelection:
    evidence = (SelectionEvidence("joint_2", "hysteresis", "hysteresis 0.001, 0.03", 0.8, 0.02, chosen=True),)
    added = (Hysteresis((0.001, 0.02, 0.03), ("joint_2",)), Stribeck(0.05, joints=("joint_2", "joint_3")))
    return FrictionSelection(small_model(), added, evidence, np.array([1.0, 0.8, 0.9]), np.full(3, 0.02), weight)


def test_friction_stands_joint_by_joint_and_law_by_law():
    text = printed(friction_selection_table(ladder(), small_model().robot), 100)
    assert "RMS ratio, with / without" in " ".join(text.split())
    rows = [[cell.strip() for cell in line.split("│")[1:-1]] for line in text.splitlines() if line.startswith("│")]
    assert rows == [
        ["1", "joint_1", "-", "none"],
        ["2", "joint_2", "0.80 ± 0.02", "hysteresis over 0.001, 0.02, 0.03 rad"],
        ["", "", "", "Stribeck effect at 0.05 rad/s"],
        ["3", "joint_3", "0.90 ± 0.02", "Stribeck effect at 0.05 rad/s"],
    ]


def with_weight(weight: float) -> Estimate:
    found = estimate(problem())
    said = weight_finding("log-det prior", weight, GIVEN)
    assert found.fit.standard is not None
    standard = replace(found.fit.standard, prior=PriorUse("log-det", weight, GIVEN, 1.0))
    return replace(found, findings=(said,), fit=replace(found.fit, standard=standard))


@pytest.mark.parametrize(("weight", "how"), [(421.0, CHOSEN), (7.0, GIVEN)])
def test_a_weight_that_the_choice_of_friction_brought_was_given_by_nobody(weight: float, how: str):
    found = with_origin_of_weight(with_weight(weight), ladder())
    assert found.findings[0] == weight_finding("log-det prior", weight, how)
    assert found.fit.standard is not None and found.fit.standard.prior.how == how
    unselected = with_origin_of_weight(with_weight(weight), None)
    assert unselected.findings[0] == weight_finding("log-det prior", weight, GIVEN)


LONG = ", ".join(f'"panda_joint{k}_position"' for k in range(1, 8))


@pytest.mark.parametrize("width", ["40", "80", "120"])
def test_a_remedy_to_paste_is_not_broken(
    width: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    monkeypatch.setenv("COLUMNS", width)
    remedies = (lines(columns={"q": LONG.replace('"', "").split(", ")}), f"give --columns 'q={LONG}'")
    print_findings([Finding("x", "warning", "", "Evidence.", remedy) for remedy in remedies])
    _report((Diagnosis("log.csv", tuple(Finding("x", "info", "", "Evidence.", remedy) for remedy in remedies)),))
    said = capsys.readouterr()
    for text in (said.err, said.out):
        printed_lines = [line.strip() for line in text.splitlines()]
        assert all(line in printed_lines for remedy in remedies for line in remedy.splitlines())


def test_a_sentence_stays_in_the_line_of_its_finding(capsys: pytest.CaptureFixture[str]):
    print_findings([Finding("x", "info", "", "Evidence.", "record longer.")])
    assert capsys.readouterr().err == "info x Evidence. record longer.\n"


def test_one_remedy_of_several_findings_is_printed_once(capsys: pytest.CaptureFixture[str]):
    remedy = lines("or give the right columns", columns={"dq": ""})
    other = lines(torque_sign=-1)
    print_findings(
        [Finding("x", "error", "b", "Two.", other)] + [Finding("v", "error", j, "Off.", remedy) for j in "ac"]
    )
    assert capsys.readouterr().err.splitlines() == [
        "error x b: Two.",
        f"  {other}",
        "error v a: Off.",
        "error v c: Off.",
        f"  {remedy}",
    ]
    print_findings([Finding("x", "info", j, "Evidence.", "record longer.") for j in "ab"])
    assert capsys.readouterr().err.count("record longer.") == 2  # sentences stay with their findings
    uneven = [Finding("x", "info", f"logs/{j}.csv", f"Steps of {j}.", "") for j in "abc"]
    print_findings(uneven)  # of many infos the first, and where the others are
    assert capsys.readouterr().err.splitlines() == ["info x logs/a.csv: Steps of a.", "info x 2 more: b.csv, c.csv."]
    print_findings(uneven, whole=True)
    assert capsys.readouterr().err.count("Steps of") == 3
    print_findings([replace(each, severity="warning") for each in uneven])
    assert capsys.readouterr().err.count("Steps of") == 3
    joined = diagnosed_error(EstimationError("Singular."), [Finding("v", "error", j, "Off.", remedy) for j in "ac"])
    assert joined.remedy.count("columns") == 2 and joined.remedy == remedy  # the key, and the word of its note
    lost = Finding("run-short", "warning", "log", "No row can be used.", "record longer.")
    few = diagnosed_error(EstimationError("Singular.", remedy="move."), [lost, replace(lost, code="clock-jitter")])
    assert few.problem == "Singular. [run-short] No row can be used." and few.remedy == "move."


def test_guessed_columns_take_one_line_unless_they_are_doubted_or_asked_for(capsys: pytest.CaptureFixture[str]):
    remedy = lines(columns={"q": LONG.replace('"', "").split(", ")})
    guessed = [Finding("columns-guessed", "info", "", f"{k}: q is {LONG}.", remedy) for k in "ab"]
    print_findings(guessed)
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("info columns-guessed") and "armid doctor" in line
    print_findings([Finding("columns-guessed", "info", "", "The time column was chosen by its name: time is x.", "")])
    assert "The time column was chosen by its name: time is x." in capsys.readouterr().err
    print_findings(guessed, whole=True)
    assert str(remedy) in capsys.readouterr().err
    print_findings([replace(guessed[0], severity="warning")])
    assert str(remedy) in capsys.readouterr().err


def score(path: str, size: float) -> Score:
    each = np.array([size, 2.0 * size])
    return Score(path, "", each, each, np.ones(2), 3.0 * each, 1.0 - 0.1 * each, 10.0 * each)


def test_columns_of_several_recordings_are_the_worst_and_say_so():
    held = (score("a/one.csv", 0.1), score("b/two.csv", 0.3))
    text = printed(validation_table(Validation(("x", "y"), held, "pass", ()), [score("t.csv", 0.05)], ["N·m"] * 2))
    flat = " ".join(text.split())
    assert "train: t.csv; valid. 1: one.csv, valid. 2: two.csv" in flat and "the worst value of each joint" in flat
    (row,) = [line for line in text.splitlines() if line.startswith("2 ")]
    cells = [cell.strip() for cell in row.split("│")]
    # Number, joint, training, both recordings, description (root mean square), relative, peak, share in the band.
    assert cells == ["2", "y", "0.100", "0.200", "0.600", "4.472", "60.0 %", "1.800", "94 %"]


def test_one_recording_is_not_called_the_worst():
    text = printed(validation_table(Validation(("x", "y"), (score("v.csv", 0.1),), "pass", ()), (), ["N·m"] * 2))
    assert "validation: v.csv" in text and "worst" not in text


def test_a_remedy_reads_as_english(capsys: pytest.CaptureFixture[str]):
    print_error(ArmidError("There is no robot 'pnda'.", possible="panda, ur5e", remedy="did you mean 'panda'?"))
    err = capsys.readouterr().err
    assert "possible: panda, ur5e" in err and "hint: did you mean 'panda'?" in err and "do did" not in err


@pytest.mark.parametrize("width", [80, *range(100, 150, 3), 200])
def test_bodies_keep_the_names_of_their_links_at_any_width(width: int):
    found = link_table(model(CRANE), estimate(problem(CRANE, 0), bodies=True))
    links = tuple(replace(body, link=f"right_arm_{k}_link_of_it") for k, body in enumerate(found.links))
    screen = StringIO()
    print_links(Console(file=screen, width=width, highlight=False), replace(found, links=links))
    text = screen.getvalue()
    rows = [line for line in text.splitlines() if line.startswith(("│", "┃"))]
    assert not any("…" in line for line in rows) and max(map(len, rows)) <= width
    tables = sum("┃ link " in line for line in rows)
    assert sum("│ new │" in line for line in rows) == tables * len(links)
    names = "".join(line.split("│")[1].strip() for line in text.splitlines() if line.startswith("│"))
    assert all(names.count(body.link) >= 1 for body in links)
