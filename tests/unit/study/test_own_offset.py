"""Offset of a recording of its own, shown apart where it is most of the torque error."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from armid.study.config import parse_study
from armid.study.identify import identify
from labs import STUDY, small_recording, write_arm


def test_a_constant_in_the_validation_recording_is_shown_apart(tmp_path):
    """A torque sensor is zeroed 3 N·m off: the rest of the error is that of the sound recording."""
    import tomllib

    write_arm(tmp_path)
    study = parse_study(tomllib.loads(STUDY), str(tmp_path))
    sound = {"run1.csv": small_recording(1), "run2.csv": small_recording(2)}
    other = replace(sound["run2.csv"], effort=sound["run2.csv"].effort + np.array([0.0, 3.0, 0.0]))
    before, after = (identify(study, given={**sound, "run2.csv": each}) for each in (sound["run2.csv"], other))
    assert not [each for each in before.estimate.findings if each.code == "own-offset"]
    (finding,) = [each for each in after.estimate.findings if each.code == "own-offset"]
    assert "joint_2: mean error 3" in finding.evidence and "joint_1" not in finding.evidence
    score, usual = after.validation.recordings[0], before.validation.recordings[0]
    np.testing.assert_allclose(score.rms_with_own_offset, usual.rms_with_own_offset, rtol=1e-6)
    np.testing.assert_allclose(score.offset - usual.offset, [0.0, 3.0, 0.0], atol=1e-6)
    np.testing.assert_allclose(score.rms**2, score.rms_with_own_offset**2 + score.offset**2)
