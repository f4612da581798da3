"""Real arms with what was identified in them: other programs' torque, and motion unseen in training."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from armid import load_study
from armid.export.write import export_run
from armid.robot import load_robot
from armid.runs.run import load_run, save_run
from armid.study.identify import identify

STUDIES = Path(__file__).parent / "studies"

pytestmark = pytest.mark.real

ARMS = ("franka_panda_gaz", "kuka_lbr_med7", "staubli_tx40")
"""With fingers locked and a hand that is heavier than the link; with a flange carried; with a coupling."""


@pytest.mark.witness
@pytest.mark.parametrize("name", ARMS)
def test_the_file_predicts_as_the_run_did(shared_data: Path, tmp_path: Path, name: str):
    study = load_study(STUDIES / f"{name}.toml")
    study = replace(study, estimation=replace(study.estimation, method="physical"))
    result = identify(study)
    run = load_run(save_run(result, tmp_path / "run"))
    for to in ("urdf", "mjcf", "sdf"):
        exported = export_run(run, to)
        torques = [check.value for check in exported.checks if check.name.startswith("rigid-body torque")]
        assert len(torques) == (1 if to == "sdf" else 3) and max(torques) < 1e-12
        (prediction,) = exported.predictions
        np.testing.assert_allclose(prediction.file, result.validation.recordings[0].rms, rtol=1e-9)
    assert export_run(run, "urdf", nearest=True).standard == "nearest"


def test_what_does_not_change_in_the_panda_stays(shared_data: Path, tmp_path: Path):
    study = load_study(STUDIES / "franka_panda_gaz.toml")
    study = replace(study, estimation=replace(study.estimation, method="physical"))
    run = load_run(save_run(identify(study), tmp_path / "run"))
    exported = export_run(run, "urdf")
    before, after = Path(exported.edited).read_text().splitlines(), exported.path.read_text().splitlines()
    assert len(before) == len(after)
    changed = [old for old, new in zip(before, after, strict=True) if old != new]
    assert changed and all(
        any(tag in line for tag in ("<inertia", "<origin", "<mass", "<dynamics")) for line in changed
    )
    fingers = ("panda_finger_joint1", "panda_finger_joint2")
    assert load_robot(exported.path, locked=fingers).joint_names == run.robot.joint_names
