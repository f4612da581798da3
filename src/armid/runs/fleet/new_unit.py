"""Study of a new unit with the torque terms and the processing of its fleet."""

from __future__ import annotations

from dataclasses import replace

from armid.errors import StudyError
from armid.measurement.processing.options import ProcessingOptions
from armid.runs.fleet.stored_fleet import StoredFleet
from armid.runs.run import load_run
from armid.study.config import Study, build_model, load_choice, resolve_model


def study_like_fleet(study: Study, fleet: StoredFleet) -> Study:
    """Study of a new unit with the torque terms of its fleet, and with its processing unless the study states one.

    Args:
        study: Study of the unit.
        fleet: The fleet.

    Raises:
        StudyError: The study has another arm or other torque terms than the fleet.
    """
    run = load_run(fleet.run_of(fleet.estimate.units[0]))
    robot = load_choice(study.robot, study.folder)
    if robot.joint_names != fleet.robot.joint_names:
        raise StudyError(
            f"The study is about {robot.name} with the joints {', '.join(robot.joint_names)}, but the fleet "
            f"{fleet.folder} about {fleet.robot.name} with the joints {', '.join(fleet.robot.joint_names)}.",
            remedy="give the description of the fleet, with the same locked joints.",
        )
    model = resolve_model(run.model)
    if study.model.automatic or study.model.terms or study.model.shapes:
        stated = None if study.model.automatic else resolve_model(build_model(robot, study.model))
        if stated != model:
            raise StudyError(
                f"The study has other torque terms than the fleet {fleet.folder}.",
                possible=f"the terms of the fleet: {', '.join(model.terms)}",
                remedy="leave the torque terms out; those of the fleet are then used.",
            )
    same = study.processing == ProcessingOptions()
    return replace(study, model=model, processing=run.processing if same else study.processing)
