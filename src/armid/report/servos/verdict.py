"""Section of the verdict on a servo result: reliable and doubtful results, and next steps."""

from __future__ import annotations

import shlex
from collections.abc import Sequence

import numpy as np

from armid.report.data.findings import evidence_words, remedy_words, serious
from armid.report.data.joint_names import label_of
from armid.report.data.number_format import share, short
from armid.report.data.trust import TrustJudgement
from armid.report.section import Section
from armid.report.sections.verdict import FIRST
from armid.report.servos.page_data import ServoPageData
from armid.report.servos.tables import counts
from armid.servo.quantities import POSITION_ERROR, quantity_of

BADGES = {
    "pass": ("✓ pass", "The identified arm predicts validation motion better than command = position does."),
    "fail": ("✗ fail", "The identified arm predicts validation motion worse than command = position does."),
    "not judged": ("– not judged", "There is no validation recording, so the model is not judged."),
}
"""Badge and sentence of each verdict."""

CONTRADICTED = "The findings contain an error, so the model may be wrong as a whole."

POOR_COVERAGE = 0.85
"""Share of the rows of a joint below which its band is called too narrow."""

MAX_ERROR_RATIO = 2.0
"""Ratio of the validation error to the error on left-out parts above which the motions are called unlike."""

NEXT_COMMANDS = (
    ("validate {run} RECORDING", "position error of the closed loop on another recording"),
    ("report {run}", "this page again, with recordings from --data FOLDER"),
)
"""Next commands for a result, each with its outcome."""

Sentences = tuple[list[str], list[str], list[str]]


def verdict_section(page_data: ServoPageData) -> Section:
    """Section of the verdict with the main numbers."""
    stored = page_data.stored
    verdict = stored.errors.verdict
    badge, sentence = BADGES[verdict]
    if verdict != "fail" and serious(stored.findings, "error"):
        verdict, badge, sentence = "fail", "✗ error found", CONTRADICTED
    run = shlex.quote(stored.folder)
    content = {
        "colour": verdict.replace(" ", "-"),
        "badge": badge,
        "sentence": sentence,
        "judgement": judge_servo(page_data),
        "first": FIRST,
        "figures": _figures(page_data),
        "commands": [(f"armid {command.format(run=run)}", purpose) for command, purpose in NEXT_COMMANDS],
    }
    return Section("Verdict", content, template="verdict")


def judge_servo(page_data: ServoPageData) -> TrustJudgement:
    """Assesses a servo result; the most important sentences come first."""
    trusted: list[str] = []
    doubted: list[str] = []
    wanted: list[str] = []
    for assess in (_errors, _joints_worse, _band, _values, _findings):
        good, bad, next_ = assess(page_data)
        trusted += good
        doubted += bad
        wanted += next_
    return TrustJudgement(tuple(trusted), tuple(doubted), tuple(dict.fromkeys(wanted)))


def _errors(page_data: ServoPageData) -> Sentences:
    """Sentences about the error of all joints together, beside those of the commands and of the description."""
    score, unit = page_data.stored.errors.score, POSITION_ERROR.units(page_data.joints)
    left_out = page_data.stored.errors.left_out.total
    if score is None:
        words = (
            f"The model was checked on left-out parts of the training recordings only, with an error of "
            f"{_milli(left_out)} {unit} RMS."
        )
        return [], [words], ["Use another motion for validation: --validate RECORDING."]
    model, command = score.model.total, score.command.total
    words = (
        f"Position error on validation motion: {_milli(model)} {unit} RMS over joints and recordings, "
        f"{share(model / command)} of that of command = position ({_milli(command)} {unit})"
    )
    good, bad, next_ = [], [], []
    if score.described is not None and np.isfinite(score.described.total):
        described = score.described.total
        words += f" and {share(model / described)} of that of the description ({_milli(described)} {unit})"
        if described < model:
            bad.append("The description as it stands predicts the validation motion better than the identified arm.")
            next_.append("Compare the training motion with that of validation; train with motion like that of use.")
    (good if model < command else bad).append(f"{words}.")
    if model > MAX_ERROR_RATIO * left_out:
        bad.append(f"The validation error is {short(model / left_out, 2)} times that on left-out parts of training.")
        next_.append("Record more and different training motions: the validation motion is unlike those of training.")
    return good, bad, next_


def _joints_worse(page_data: ServoPageData) -> Sentences:
    """Sentences about joints that are predicted worse than by their commands or by the description."""
    score = page_data.stored.errors.score
    if score is None:
        return [], [], []
    joints = range(len(page_data.joints))
    worse = [j for j in joints if not score.model.joints[j] < score.command.joints[j]]
    good = [] if worse else ["Every joint is predicted better than by its command."]
    bad: list[str] = []
    if worse:
        names = _listed(page_data, worse)
        bad.append(f"Predicted worse than by the command: {names}; compare these errors with the encoder's step.")
    if score.described is not None:
        behind = [j for j in joints if score.model.joints[j] > score.described.joints[j]]
        bad += [f"Predicted worse than by the description: {_listed(page_data, behind)}."] if behind else []
    return good, bad, []


def _band(page_data: ServoPageData) -> Sentences:
    """Sentences about the share of the validation rows inside the 95 % band."""
    score = page_data.stored.errors.score
    if score is None or not np.isfinite(score.coverage).any():
        return [], [], []
    poor = [j for j, each in enumerate(score.coverage) if each < POOR_COVERAGE]
    mean = share(float(np.mean(score.coverage)))
    words = f"The 95 % band of the position contains {mean} of the rows of validation, over all joints."
    if not poor:
        return [words], [], []
    listed = ", ".join(f"{label_of(page_data.joints, j)} ({share(float(score.coverage[j]))})" for j in poor)
    bad = f"The 95 % band of the position is too narrow for the validation motion on {listed}."
    return [words], [bad], ["Train with poses and speeds like those of validation, so that the band contains them."]


def _values(page_data: ServoPageData) -> Sentences:
    """Sentences about what the recordings show of the parameters."""
    values = page_data.stored.values
    known = dict(counts(values))
    estimated = sum(known.values()) - known.get("given", 0)
    good = [f"{known.get('identified', 0)} of {estimated} estimated parameters are identified."]
    bad: list[str] = []
    next_: list[str] = []
    unseen = _by_kind(page_data, "not identifiable")
    if unseen:
        bad.append(f"The recordings do not show: {'; '.join(unseen)}.")
    held = [quantity_of(each.kind).title for each in values if each.origin == "prior-dominated"]
    if held:
        kinds = ", ".join(dict.fromkeys(held))
        bad.append(f"The prior dominates {len(held)} values ({kinds}); the table of parameters names them.")
    if any(each.kind == "stiffness" and each.origin == "not identifiable" for each in values):
        next_.append(
            "State the stiffness of servos that no load turns (`--stiffness`), or mount the arm so that gravity "
            "turns these joints. Their closed loop may be predicted well all the same."
        )
    bad.append("Intervals of parameters are lower limits: residuals of a simulation are not independent.")
    return good, bad, next_


def _by_kind(page_data: ServoPageData, origin: str) -> list[str]:
    """Parameters with an origin as text, such as `delay of 1 · pan, 2 · lift`, one for each kind."""
    found = [each for each in page_data.stored.values if each.origin == origin]
    return [
        f"{quantity_of(kind).title} of {_listed(page_data, [each.joint for each in found if each.kind == kind])}"
        for kind in dict.fromkeys(each.kind for each in found)
    ]


def _findings(page_data: ServoPageData) -> Sentences:
    """Sentences about findings that are errors or warnings."""
    found = serious(page_data.stored.findings, "error", "warning")
    return [], list(dict.fromkeys(map(evidence_words, found))), [remedy_words(each) for each in found if each.remedy]


def _figures(page_data: ServoPageData) -> list[tuple[str, str, str]]:
    """Main numbers of a result, each with its unit and its meaning."""
    errors, unit = page_data.stored.errors, POSITION_ERROR.units(page_data.joints)
    figures: list[tuple[str, str, str]] = []
    if errors.score is not None:
        score = errors.score
        figures.append((_milli(score.model.total), unit, "validation RMS error of the position"))
        figures.append((_milli(score.command.total), unit, "that of command = position"))
        if score.described is not None:
            figures.append((_milli(score.described.total), unit, "that of the description"))
        figures.append((share(float(np.mean(score.coverage))), "", "of the rows of validation inside the 95 % band"))
    figures.append((_milli(errors.left_out.total), unit, "RMS error on left-out parts of training"))
    return figures


def _milli(value: float) -> str:
    return short(POSITION_ERROR.scale * value)


def _listed(page_data: ServoPageData, joints: Sequence[int]) -> str:
    if len(joints) == len(page_data.joints) > 1:
        return "every joint"
    return ", ".join(label_of(page_data.joints, j) for j in joints)
