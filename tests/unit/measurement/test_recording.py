import numpy as np
import pytest

from armid.dataclass_files import load, save
from armid.errors import RecordingError
from armid.measurement.recording import Recording

TIME = np.arange(12) / 100
Q = np.column_stack([np.sin(TIME), np.cos(TIME)])


def test_a_recording_is_frozen_and_its_arrays_are_copies():
    q = Q.copy()
    recording = Recording(time=TIME, q=q, effort=2 * q)
    q[:] = 0
    np.testing.assert_array_equal(recording.q, Q)
    with pytest.raises(ValueError, match="read-only"):
        recording.q[0, 0] = 1
    with pytest.raises(AttributeError):
        recording.rate = 5.0  # pyright: ignore[reportAttributeAccessIssue]


def test_a_mask_for_rows_counts_for_all_channels_and_none_masks_nothing():
    rows = np.arange(12) > 3
    np.testing.assert_array_equal(Recording(time=TIME, q=Q, valid=rows).valid, np.column_stack([rows, rows]))
    assert Recording(time=TIME, q=Q).valid.shape == (12, 2)
    assert Recording(time=TIME, q=Q).valid.all()


def test_saving_and_loading_gives_the_same_recording(tmp_path):
    full = Recording(
        time=TIME,
        q=Q,
        dq=3 * Q,
        effort=-Q,
        joint_names=("a", "b"),
        rate=100.0,
        consecutive=True,
        valid=Q > 0.5,
        effort_is_current=True,
        source="run.csv",
        sha256="ab",
    )
    again = load(Recording, save(full, tmp_path / "recording.npz"))
    for name in ("time", "q", "dq", "effort", "valid"):
        np.testing.assert_array_equal(getattr(again, name), getattr(full, name))
    assert again.ddq is None
    for name in ("joint_names", "rate", "consecutive", "effort_is_current", "source", "sha256"):
        assert getattr(again, name) == getattr(full, name)
    bare = load(Recording, save(Recording(time=None, q=Q), tmp_path / "bare.npz"))
    assert bare.time is None and bare.consecutive is None and bare.joint_names == ()


def test_raw_values_may_be_nan_because_judging_comes_later():
    q = Q.copy()
    q[3, 1] = np.nan
    assert np.isnan(Recording(time=TIME, q=q).q[3, 1])


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"effort": Q[:, :1]}, r"effort has shape \(12, 1\)"),
        ({"dq": Q[:5]}, r"dq has shape \(5, 2\)"),
        ({"time": TIME[:-1]}, r"time has shape \(11,\)"),
        (
            {"q": Q.T, "time": TIME},
            r"time has shape \(12,\), but it must have shape \(2,\), because q has shape \(2, 12\)",
        ),
        ({"joint_names": ("a",)}, "has 2 channels, but `joint_names` has 1 entries"),
        ({"valid": np.ones(3, dtype=bool)}, "`valid` must have the shape"),
    ],
)
def test_shapes_that_disagree_are_refused(change, words):
    with pytest.raises(RecordingError, match=words):
        Recording(**({"time": TIME, "q": Q} | change))


def test_channels_without_names_are_called_by_their_numbers():
    assert Recording(time=TIME, q=Q).channels == ("1", "2")
    assert Recording(time=TIME, q=Q, joint_names=("a", "b")).channels == ("a", "b")
