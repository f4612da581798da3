import numpy as np
import pytest

from armid.dataclass_files import load, save
from armid.errors import RecordingError
from armid.measurement.log_format import PRESETS, QUANTITIES, LogFormat


def test_the_keys_are_those_of_a_study():
    table = {
        "rate": 50,
        "consecutive": True,
        "torque_sign": -1,
        "drive_gain": [14.87, 13.26],
        "drive_gain_deviation": 0.1,
        "transmission": [[32.0, 0.0], [0.0, 32.0]],
        "joint_offset": [0.0, 1.5],
        "columns": {"q": "q{}", "dq": "", "effort": ["a", "b"]},
        "units": "deg",
        "joints": ["shoulder", ""],
        "topic": "/joint_states",
        "preset": "ur-rtde",
        "exclude": [[0, 1], [5.5, 6]],
        "period": 10,
        "start": 2,
    }
    reading = LogFormat(**table)
    assert reading.rate == 50.0 and reading.period == 10.0 and reading.start == 2.0
    np.testing.assert_array_equal(reading.torque_sign, [-1.0])
    np.testing.assert_array_equal(reading.drive_gain_deviation, [0.1])
    assert reading.columns == {"q": ("q{}",), "dq": (), "effort": ("a", "b")}
    assert reading.joint_map == {"1": "shoulder", "2": ""}
    assert reading.exclude == ((0.0, 1.0), (5.5, 6.0))


def test_saving_and_loading_gives_the_same_reading(tmp_path):
    reading = LogFormat(
        torque_sign=[1, -1], drive_gain=[2.0, 3.0], columns={"q": "qm{}"}, joints={"x": "y"}, exclude=[(0, 1)]
    )
    again = load(LogFormat, save(reading, tmp_path / "reading.npz"))
    np.testing.assert_array_equal(again.torque_sign, [1, -1])
    np.testing.assert_array_equal(again.drive_gain, [2, 3])
    assert (again.columns, again.joints, again.exclude) == (reading.columns, reading.joints, reading.exclude)
    assert again.transmission is None and again.rate is None


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"rate": 0}, "rate = 0"),
        ({"rate": True}, "rate = True"),
        ({"rate": "fast"}, "`rate` must be a number"),
        ({"rate": float("nan")}, "rate must be finite"),
        ({"period": -1.0}, "period = -1.0"),
        ({"start": 1.0}, "without the key `period`"),
        ({"consecutive": "yes"}, "consecutive = 'yes'"),
        ({"torque_sign": 0.5}, "torque_sign = 0.5"),
        ({"torque_sign": [1, 0]}, "torque_sign"),
        ({"drive_gain": [[5.0]]}, r"drive_gain = \[\[5"),
        ({"drive_gain": [5.0, 0.0]}, "drive_gain"),
        ({"drive_gain_deviation": 0.1}, "without `drive_gain`"),
        ({"drive_gain": [1.0], "drive_gain_deviation": -0.1}, "drive_gain_deviation"),
        ({"position_zero_deviation": -0.001}, "position_zero_deviation"),
        ({"transmission": [[1.0, 2.0]]}, "must be a square matrix"),
        ({"transmission": [[1.0, 2.0], [2.0, 4.0]]}, "singular"),
        ({"drive_gain": [1.0, 2.0], "torque_sign": [1, 1, 1]}, "torque_sign has 3, drive_gain has 2"),
        ({"transmission": np.eye(2), "joint_offset": [0.0]}, "joint_offset has 1, transmission has 2"),
        ({"columns": {"position": "q{}"}}, "`columns` cannot have the key 'position'"),
        ({"columns": {"q": ""}}, "key `q` of the table `columns` is empty"),
        ({"columns": {"q": 3}}, r"columns\.q = 3"),
        ({"columns": "q{}"}, "columns = 'q{}'"),
        ({"units": "degrees"}, "units = 'degrees'"),
        ({"joints": "a1"}, "joints = 'a1'"),
        ({"joints": {"a": "x", "b": "x"}}, "assigns x to more than one channel"),
        ({"preset": "ur"}, "preset = 'ur'"),
        ({"exclude": [[2, 1]]}, "exclude"),
        ({"exclude": [1, 2]}, r"exclude must have shape"),
    ],
)
def test_nonsense_is_refused_when_it_is_said(wrong, words):
    with pytest.raises(RecordingError, match=words):
        LogFormat(**wrong)


def test_a_wrong_word_is_answered_with_the_known_ones():
    with pytest.raises(RecordingError) as caught:
        LogFormat(preset="ur")
    assert all(name in caught.value.possible for name in PRESETS)
    with pytest.raises(RecordingError) as caught:
        LogFormat(columns={"torque": "tau{}"})
    assert all(name in caught.value.possible for name in QUANTITIES)


def test_a_one_joint_arm_needs_no_special_case():
    reading = LogFormat(torque_sign=-1, drive_gain=[2.0], transmission=[[50.0]], joint_offset=[0.1])
    assert np.shape(reading.transmission) == (1, 1)
