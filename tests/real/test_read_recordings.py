"""Every published recording reads, and means what its description says."""

import json

import numpy as np
import pytest

from armid.errors import RecordingError
from armid.measurement.convention_conversion import to_robot_convention
from armid.measurement.log_format import LogFormat
from armid.measurement.readers import load_recording
from armid.robot import load_robot

pytestmark = pytest.mark.real

GEAR = np.diag([32.0, 32.0, 45.0, -48.0, 45.0, 32.0])
GEAR[5, 4] = 32.0
GAINS = np.array([14.87, 13.26, 11.13, 10.62, 11.03, 11.47])
FINGERS = ["panda_finger_joint1", "panda_finger_joint2"]
CURRENT = LogFormat(drive_gain=GAINS, drive_gain_deviation=0.1)
OPPOSITE = LogFormat(torque_sign=-1)
TX40 = LogFormat(
    columns={"q": "qm{}", "effort": "taum{}"},
    transmission=GEAR,
    joint_offset=np.array([0.0, -np.pi / 2, np.pi / 2, 0.0, 0.0, 0.0]),
)

LOOSE = 0.15
"""Joint 6 of the Gen3 goes 0.11 rad beyond the limit that its URDF states; nothing else leaves its limits."""

RUNS = {
    "franka_panda_gaz/exciting_first70": ("panda.urdf", LogFormat()),
    "kinova_gen3_raptor/traj_1": ("kinova.urdf", OPPOSITE),
    "kinova_gen3_raptor/traj_3": ("kinova.urdf", OPPOSITE),
    "kinova_gen3_raptor/traj_5": ("kinova.urdf", OPPOSITE),
    "kuka_iiwa14_lasa/samples_2000": ("iiwa14.urdf", LogFormat(torque_sign=-1, rate=50.0)),
    "kuka_lbr_med7/measurements": ("med7dock.urdf", OPPOSITE),
    "kuka_lbr_med7/measurements_with_ext_tau_1_dgr": ("med7dock.urdf", OPPOSITE),
    "kuka_lwr4plus/measurements_1": ("kuka_lwr4.urdf", LogFormat()),
    "kuka_lwr4plus/measurements_3": ("kuka_lwr4.urdf", LogFormat()),
    "staubli_tx40/first70": ("tx40_mdh_modified.urdf", TX40),
    "ur10_unisa/ur10_exciting_trajectory": ("ur10_robot.urdf", LogFormat()),
    "ur10e_innopolis/ur-20_02_06-20sec_5harm": ("ur10e.urdf", CURRENT),
    "ur10e_innopolis/ur-20_02_10-30sec_12harm": ("ur10e.urdf", CURRENT),
    "ur10e_innopolis/ur-20_02_12-40sec_12harm": ("ur10e.urdf", CURRENT),
    "ur10e_innopolis/ur-20_02_12-50sec_12harm": ("ur10e.urdf", CURRENT),
    "ur10e_innopolis/ur-20_02_19_14harm50sec": ("ur10e.urdf", CURRENT),
    "ur10e_innopolis/ur-20_02_19_14harm50secLoad": ("ur10e.urdf", CURRENT),
}

WITHOUT_TORQUE = {"go2_stand", "so101_sage"}
"""Robots of which command and position were recorded and no torque."""


def read(shared_data, run, reading=None):
    urdf, usual = RUNS[run]
    path = shared_data / f"{run}.parquet"
    robot = load_robot(path.parent / urdf, locked=FINGERS if "panda" in urdf else [])
    reading = reading or usual
    return to_robot_convention(load_recording(path, reading), reading, robot), robot


ENDS = 14
"""Rows at both ends together that the filter of a reduction needs, for each step: thirteen taps, and a row."""


def test_no_recording_is_left_out(shared_data):
    found = {path for path in shared_data.glob("*/*.parquet") if path.parent.name not in WITHOUT_TORQUE}
    assert {str(path.relative_to(shared_data).with_suffix("")) for path in found} == set(RUNS)


@pytest.mark.parametrize("run", RUNS)
def test_a_recording_reads_and_fits_its_robot(shared_data, run):
    result, robot = read(shared_data, run)
    recording = result.recording
    about = json.loads((shared_data / f"{run}.json").read_text())
    limits = np.array([joint.position_limits for joint in robot.joints])
    assert recording.joint_names == robot.joint_names
    assert recording.consecutive is True and not recording.effort_is_current
    assert (recording.q > limits[:, 0] - LOOSE).all() and (recording.q < limits[:, 1] + LOOSE).all()
    # The TX40 is logged at 5 kHz, which is reduced to 1 kHz; the filter needs some rows at both ends.
    fast = recording.logged_rate is not None and recording.time is not None
    step = round(recording.logged_rate * float(np.median(np.diff(recording.time)))) if fast else 1
    assert fast == ("tx40" in run)
    lost = about["rows"] - step * recording.samples
    assert lost == (780 if "panda" in run else 0) if step == 1 else 0 <= lost <= ENDS * step
    assert not {"position-offset", "channel-dead", "rows-not-consecutive"} & {f.code for f in result.findings}


@pytest.mark.witness
@pytest.mark.parametrize("run", [run for run in RUNS if "tx40" not in run])
def test_the_effort_has_the_sign_of_the_description(shared_data, run):
    """Joint 2 of every arm mostly carries weight, so its effort follows the description's gravity torque."""
    import pinocchio

    recording, robot = read(shared_data, run)[0].recording, read(shared_data, run)[1]
    model = pinocchio.buildModelFromUrdf(robot.source)
    data = model.createData()
    q = np.zeros((recording.samples, model.nv))
    q[:, : robot.n] = recording.q
    rows = np.linspace(0, recording.samples - 1, 200).astype(int)
    # Continuous joints have two coordinates in Pinocchio; integrating from the neutral pose serves all kinds.
    neutral = pinocchio.neutral(model)
    weight = [
        pinocchio.computeGeneralizedGravity(model, data, pinocchio.integrate(model, neutral, q[i]))[1] for i in rows
    ]
    assert np.corrcoef(weight, recording.effort[rows, 1])[0, 1] > 0.5


def test_the_panda_stutters(shared_data):
    (finding,) = read(shared_data, "franka_panda_gaz/exciting_first70")[0].findings
    assert finding.code == "rows-repeated"
    assert finding.evidence.startswith("791 of 14380 rows repeat the row before; 780 of them were dropped, 11 masked")


@pytest.mark.parametrize("run", [run for run in RUNS if "kinova" in run])
def test_the_gen3_turns_without_jumps(shared_data, run):
    result, _ = read(shared_data, run)
    assert {f.channel for f in result.findings if f.code == "position-wrapped"} == {
        f"joint_{i}" for i in (1, 3, 5, 7)
    }
    recording = result.recording
    step = np.diff(recording.time)[:, None]
    # Nothing turns faster than its recorded velocity allows; a jump would be 6 rad.
    assert np.abs(np.diff(recording.q, axis=0) - step * recording.dq[1:]).max() < 0.1


def test_the_iiwa_has_no_clock_and_its_rate_is_told(shared_data):
    with pytest.raises(RecordingError, match="clock-missing") as caught:
        read(shared_data, "kuka_iiwa14_lasa/samples_2000", OPPOSITE)
    assert "imply 50 Hz" in caught.value.remedy
    with pytest.raises(RecordingError, match="imply 50 Hz, but the key `rate` gives 100 Hz"):
        read(shared_data, "kuka_iiwa14_lasa/samples_2000", LogFormat(rate=100.0))


def test_currents_without_gains_and_motors_taken_for_joints_are_refused(shared_data):
    with pytest.raises(RecordingError, match="current-without-gain"):
        read(shared_data, "ur10e_innopolis/ur-20_02_06-20sec_5harm", LogFormat())
    with pytest.raises(RecordingError, match="far outside its limits") as caught:
        read(shared_data, "staubli_tx40/first70", LogFormat(columns=TX40.columns))
    assert "transmission" in caught.value.remedy


def test_the_motor_side_keeps_the_power(shared_data):
    """A transmission without loss: motor torque times motor step is joint torque times joint step."""
    motor = load_recording(shared_data / "staubli_tx40/first70.parquet", TX40)
    joint = read(shared_data, "staubli_tx40/first70")[0].recording
    at_motor = (motor.effort[1:] * np.diff(motor.q, axis=0)).sum(axis=1)
    at_joint = (joint.effort[1:] * np.diff(joint.q, axis=0)).sum(axis=1)
    np.testing.assert_allclose(at_joint, at_motor, rtol=0, atol=1e-9 * np.abs(at_motor).max())


def test_the_loaded_run_weighs_more(shared_data):
    free = read(shared_data, "ur10e_innopolis/ur-20_02_19_14harm50sec")[0].recording
    loaded = read(shared_data, "ur10e_innopolis/ur-20_02_19_14harm50secLoad")[0].recording
    assert loaded.effort[:, 1].std() > 1.2 * free.effort[:, 1].std()
