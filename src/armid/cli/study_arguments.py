"""Studies that the arguments of a command describe: a study file with changes, or an arm and its recordings."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from armid.cli.options import model_choice, robot_choice

if TYPE_CHECKING:
    from armid.measurement.log_format import LogFormat
    from armid.study.config import Study


def study_of(
    inputs: list[str],
    validate: list[str],
    reading: dict[str, Any],
    arm: tuple[Any, ...],
    terms: str | None,
) -> Study:
    """Study in the file that the arguments name, or a new study of the arm and the recordings that they name."""
    from armid.measurement.log_format import LogFormat
    from armid.study.config import RecordingChoice, Study, default_estimation

    if len(inputs) == 1:
        return _changed_study(inputs[0], validate, reading, arm, terms)
    log_format = LogFormat(**reading)
    recordings = tuple(RecordingChoice(path, reading=log_format) for path in inputs[1:])
    recordings += tuple(RecordingChoice(path, "validate", _shared(log_format)) for path in validate)
    model = model_choice(terms)
    robot = robot_choice(inputs[0], *arm)
    return Study(robot, model, recordings, estimation=default_estimation(model))


OF_ONE = ("exclude", "period", "start")
"""Keys of a log format whose values are valid for one recording only."""


def _shared(log_format: LogFormat) -> LogFormat:
    """Log format for further recordings: the given one without exclusions, start and period.

    The period `none` (no repetition) is retained.
    """
    period = "none" if log_format.period == "none" else None
    return replace(log_format, exclude=(), start=None, period=period)


ARM = ("gravity", "lock", "tip", "only")
"""Properties of an arm that the command line may change in a study."""


def _changed_study(
    path: str,
    validate: list[str],
    reading: dict[str, Any],
    arm: tuple[Any, ...],
    terms: str | None,
) -> Study:
    """Study in a file, with the changes that the command line requests.

    Recordings of --validate get the log format of the first training recording of the study.
    """
    from armid.errors import StudyError
    from armid.study.config import RecordingChoice, default_estimation, load_study

    if not path.endswith(".toml"):
        raise StudyError(
            f"{path} is an arm and not a study, but no recordings are given.",
            remedy="give a study.toml, or an arm followed by its recordings.",
        )
    if reading:
        options = ", ".join("--" + name.replace("_", "-") for name in reading)
        raise StudyError(
            f"{path} defines the log format of its recordings, but {options} was given, too.",
            remedy="write these options into the [[recording]] tables of the study.",
        )
    study = load_study(path)
    overrides = robot_choice(study.robot.description, *arm)
    changes = {key: value for key in ARM if (value := getattr(overrides, key))}
    robot = replace(study.robot, **changes)
    first = next(choice.reading for choice in study.recordings if choice.role == "train")
    same_format = _shared(first)
    extra = tuple(RecordingChoice(str(Path(path).absolute()), "validate", same_format) for path in validate)
    model = study.model if terms is None else model_choice(terms)
    estimation = default_estimation(model) if model.automatic and not study.model.automatic else study.estimation
    return replace(study, robot=robot, model=model, recordings=(*study.recordings, *extra), estimation=estimation)
