"""Write docs/results.md and the table in the README: real arms, identified on a part of their recordings.

Run as `uv run --all-extras scripts/results.py` where the recordings stand in ../shared/data.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

from armid import Study, identify, load_study
from armid.study.config import AUTOMATIC_METHOD, EstimationChoice
from armid.study.identify import Result

ROOT = Path(__file__).parents[1]
STUDIES = ROOT / "tests" / "real" / "studies"

BEGIN, END = "<!-- real arms -->", "<!-- end of real arms -->"

HEAD = """# Eight real arms

Errors of plain weighted least squares on published recordings. The model has rigid links, rotor inertia, viscous and
Coulomb friction (tanh of the velocity divided by 0.02 rad/s) and offset. The studies are in `tests/real/studies`;
`scripts/results.py` writes this page. Numbers are RMS torque errors of each joint in N·m, in the band of the study.

- *validation* is motion that was held out from the estimate: another run of the same arm if there is one, otherwise
  the last 30 % of the recording.
- *CAD model* is the error of the prediction with the inertial parameters of the description and without friction, on
  the same motion.
- *relative RMS* is the RMS error divided by the standard deviation of the measured torque.
- *coverage* is the share of validation rows inside the 95 % prediction interval.
- *rows used* is the share of validation rows that count. Where selected friction has hysteresis, its state is unknown
  at the beginning and after rests; these rows count for no model, so all errors of a joint are of the same rows.
- *friction chosen* is the error on the same motion with `terms = "auto"` and no method named: friction is selected
  for each joint, and the bodies have a prior towards the description. *Consistent bodies* adds `method = "physical"`
  with `prior = "log-det"`: the links are physically consistent.

Where the motion excites the arm, the error on validation motion is close to the training error. The recordings of the
Med 7 (12 s of training) and of the LWR4+ (one run each for training and validation) do not excite the arm enough for
an estimate without a prior; their verdict fails. Prediction intervals that follow from training residuals are too
narrow where the model lacks an effect that only the other motion shows. The motion of the iiwa 14 is slow. On its
joints 1 and 2, the error with consistent bodies is much larger than that of plain least squares: the inertias of
plain least squares are far below zero there, so they represent another effect than inertia.
"""


def chosen(study: Study) -> Study:
    """The study with friction chosen joint by joint; a coupling between joints is the arm's, so it stays."""
    own = study.model.terms if "coupling" in study.model.terms else ()
    suitable = EstimationChoice(AUTOMATIC_METHOD, study.estimation.friction_per_recording)
    return replace(study, model=replace(study.model, terms=own, automatic=True), estimation=suitable)


def possible(study: Study) -> Study:
    """The same over bodies that can exist, near those of the description where the data say nothing."""
    bodies = EstimationChoice("physical", study.estimation.friction_per_recording, {"physical": {"prior": "log-det"}})
    return replace(chosen(study), estimation=bodies)


def on_common_rows(results: list[Result]) -> tuple[list[np.ndarray], np.ndarray]:
    """RMS error of each result on the validation rows that count for all of them, and the share of these rows."""
    parts = [
        [part for choice, each in zip(result.study.recordings, result.predictions, strict=True) for part in each.runs
         if choice.role == "validate"]
        for result in results
    ]  # fmt: skip
    masks = [np.concatenate([part.mask for part in own]) for own in parts]
    common = np.logical_and.reduce(masks)
    squares = [np.sum(np.concatenate([part.residual for part in own]) ** 2 * common, axis=0) for own in parts]
    return [np.sqrt(each / common.sum(axis=0)) for each in squares], common.sum(axis=0) / masks[0].sum(axis=0)


def table(result: Result, others: dict[str, Result]) -> list[str]:
    """Lines of one arm's section."""
    (score,) = result.validation.recordings
    fit = result.estimate.fit
    (own, *errors), used = on_common_rows([result, *others.values()])
    rows: list[tuple[str, np.ndarray, str]] = [
        ("train", fit.residual_rms, "{:.3f}"),
        ("**validation**", own, "**{:.3f}**"),
        *((f"validation, {name}", error, "{:.3f}") for name, error in zip(others, errors, strict=True)),
        ("validation, rows used", 100 * used, "{:.0f} %"),
        ("validation, raw torque", score.rms_raw, "{:.3f}"),
        ("validation, relative RMS", 100 * score.relative, "{:.0f} %"),
        ("validation, coverage", 100 * score.coverage95, "{:.0f} %"),
    ]
    if score.prior_rms is not None:
        rows.insert(2, ("CAD model", score.prior_rms, "{:.3f}"))
    joints = range(1, len(score.rms) + 1)
    lines = [
        f"| | {' | '.join(f'joint {j}' for j in joints)} |",
        f"|---|{'---|' * len(score.rms)}",
        *(f"| {name} | {' | '.join(form.format(x) for x in values)} |" for name, values, form in rows),
        "",
        f"{len(fit.names)} base parameters from {int(fit.rows.max())} rows; condition number {fit.condition:.0f}, "
        f"{fit.scaled_condition:.1f} with columns of unit length. Verdict: {result.validation.verdict}"
        + "".join(f"; {check.name}: no" for check in result.validation.checks if not check.ok)
        + ".",
    ]
    return lines


def short_row(name: str, result: Result, others: dict[str, Result]) -> str:
    """One arm's row of the README's table: root of the sum of squares over joints; † where the verdict fails."""
    (score,) = result.validation.recordings
    prior = "-" if score.prior_rms is None else f"{np.linalg.norm(score.prior_rms):.2f}"
    results = [result, *others.values()]
    errors = [
        f"{np.linalg.norm(error):.2f}{'' if each.validation.verdict == 'pass' else ' †'}"
        for each, error in zip(results, on_common_rows(results)[0], strict=True)
    ]
    return f"| {name} | {np.linalg.norm(result.estimate.fit.residual_rms):.2f} | {' | '.join(errors)} | {prior} |"


def main() -> None:
    """Write the page and the table."""
    sections: list[str] = [HEAD]
    short = [
        "| arm | training | validation | friction chosen | consistent bodies | CAD model |",
        "|---|---|---|---|---|---|",
    ]
    for path in sorted(STUDIES.glob("*.toml")):
        study = load_study(path)
        result = identify(study)
        others = {"friction chosen": identify(chosen(study)), "consistent bodies": identify(possible(study))}
        title = path.read_text(encoding="utf-8").splitlines()[0].removeprefix("# ")
        name, _, rest = title.partition(": ")
        sections += [f"## {name}", "", f"{rest[:1].upper()}{rest[1:]}", "", *table(result, others), ""]
        short.append(short_row(name, result, others))
        sys.stdout.write(f"{path.stem}\n")
    (ROOT / "docs" / "results.md").write_text("\n".join(sections), encoding="utf-8")
    readme = ROOT / "README.md"
    before, rest = readme.read_text(encoding="utf-8").split(BEGIN)
    after = rest.split(END)[1]
    readme.write_text("\n".join([before + BEGIN, *short, END]) + after, encoding="utf-8")


if __name__ == "__main__":
    main()
