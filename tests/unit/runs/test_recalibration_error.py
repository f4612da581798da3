"""Torque error of several recordings, by which a recalibration is compared with the earlier run."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from armid.runs.recalibration import _error


def test_a_joint_without_rows_in_one_recording_counts_by_the_others():
    scores: Any = [SimpleNamespace(rms=np.array([3.0, np.nan])), SimpleNamespace(rms=np.array([3.0, 4.0]))]
    assert _error(scores) == pytest.approx(5.0)
    assert _error(scores[:1]) == pytest.approx(3.0)
