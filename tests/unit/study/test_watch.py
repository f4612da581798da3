"""The doctor inside an identification: what it finds joins the findings, each once, and the estimate is made."""

from __future__ import annotations

import tomllib
from dataclasses import replace

import numpy as np
import pytest

from armid.doctor.checks.signals.motor_side import DESCRIBED, UNSEEN
from armid.errors import EstimationError, Finding
from armid.measurement.log_format import LogFormat
from armid.measurement.recording import Recording
from armid.study.config import EstimationChoice, ModelChoice, RecordingChoice, RobotChoice, Study
from armid.study.identify import identify
from armid.study.recordings.labels import labels
from sick import Case, sound

SEED = 0


def findings(
    case: Case,
    *more: Recording,
    reading: LogFormat | None = None,
    gravity: tuple[float, float, float] | None = None,
    train: int = 9,
    name: str = "run{}.csv",
) -> list[Finding]:
    """Errors and warnings of an identification from the case and more recordings, all read alike; so many train."""
    logs = {name.format(k): log for k, log in enumerate((case.recording, *more))}
    roles = [("train" if k < train else "validate") for k in range(len(logs))]
    choices = tuple(
        RecordingChoice(path, role, reading or LogFormat()) for path, role in zip(logs, roles, strict=True)
    )
    robot = RobotChoice(case.robot.name, gravity)
    result = identify(Study(robot, ModelChoice(), choices), given=logs)
    return [finding for finding in result.estimate.findings if finding.severity != "info"]


def described(seed: int = SEED) -> Case:
    return sound(seed, name="iiwa14-r820")


def errors(found: list[Finding]) -> list[tuple[str, str]]:
    return [(f.code, f.remedy) for f in found if f.severity == "error"]


def test_a_sound_log_has_no_error_and_no_finding_twice():
    found = findings(described())
    assert errors(found) == []
    assert len({(f.code, f.channel) for f in found}) == len(found)


def test_a_torque_of_the_other_sign_is_told():
    case = described()
    assert case.recording.effort is not None
    turned = case.logged(effort=-case.recording.effort)
    assert errors(findings(turned)) == [("torque-sign", "torque_sign = -1")]
    assert errors(findings(turned, reading=LogFormat(torque_sign=-1))) == []


def test_radians_that_are_read_as_degrees_are_told():
    assert errors(findings(described(), reading=LogFormat(units="deg"))) == [("degrees", 'units = "rad"')]


def test_what_is_wrong_is_told_even_where_no_estimate_follows():
    choice = RecordingChoice("run.csv", reading=LogFormat(units="deg"))
    never = EstimationChoice("wls", options={"wls": {"iterations": 1}})
    study = Study(RobotChoice("iiwa14-r820"), ModelChoice(), (choice,), estimation=never)
    with pytest.raises(EstimationError, match=r"not converge.*\[degrees\] Read as degrees") as stopped:
        identify(study, given={"run.csv": described().recording})
    assert stopped.value.remedy == 'units = "rad"'


@pytest.mark.parametrize(("share", "code"), [(1 / 100.0, "motor-side"), (1 / 12.0, "current-without-gain")])
def test_torque_of_motors_and_currents_are_told(share: float, code: str):
    case = described()
    assert case.recording.effort is not None
    ((found, remedy),) = errors(findings(case.logged(effort=share * case.recording.effort)))
    assert found == code and "use the maker's values" in remedy
    told = tomllib.loads(remedy)
    gain, deviation = np.array(told["drive_gain"]), np.array(told["drive_gain_deviation"])
    assert (np.abs(1.0 / share - gain) < 2.0 * deviation * gain).all()  # two deviations, as intervals have
    assert deviation.min() >= DESCRIBED and deviation.max() <= UNSEEN


@pytest.mark.parametrize(
    ("factor", "gain", "unit"),
    [(5.0, None, "no usual unit"), (37.0, None, "raw units"), (100.0, 0.01, "N·cm"), (1000.0, 0.001, "mN·m")],
)
def test_torque_in_a_larger_number_of_smaller_units_is_told(factor: float, gain: float | None, unit: str):
    case = described()
    assert case.recording.effort is not None
    found = [f for f in findings(case.logged(effort=factor * case.recording.effort)) if f.severity == "error"]
    assert [f.code for f in found] == ["torque-unit"] and unit in found[0].evidence
    keys = tomllib.loads(found[0].remedy)
    told = keys["drive_gain"]
    # Links are off the description by up to 15 % in mass.
    assert len(set(told)) == 1 and told[0] == pytest.approx(gain or 1.0 / factor, rel=1e-6 if gain else 0.15)
    deviation = keys.get("drive_gain_deviation", [])
    assert not deviation if gain else (min(deviation) >= DESCRIBED and max(deviation) <= UNSEEN)


def test_factors_that_differ_between_joints_are_told_for_each():
    """Per mille of the rated torque: drives of one arm have ratings that differ by a factor of two or three."""
    case = described()
    factor = np.linspace(20.0, 50.0, case.robot.n)
    assert case.recording.effort is not None
    (found,) = [f for f in findings(case.logged(effort=factor * case.recording.effort)) if f.severity == "error"]
    assert found.code == "torque-unit" and "different factors" in found.evidence
    told = tomllib.loads(found.remedy)
    gain, deviation = np.array(told["drive_gain"]), np.array(told["drive_gain_deviation"])
    assert (np.abs(gain * factor - 1.0) < 2.0 * deviation).all()  # two deviations, as intervals have


def test_intervals_under_a_gain_of_no_unit_hold_the_truth():
    """The estimated gain alone misses a quarter of the parameters, because the arm is heavier than described."""
    case = described()
    assert case.recording.effort is not None
    heavier, factor = 1.2, 37.0
    log = case.logged(effort=heavier * factor * case.recording.effort)
    ((_, remedy),) = errors(findings(log))
    keys = tomllib.loads(remedy)
    true = {p.name: heavier * v for p, v in zip(case.model.parameters, case.theta, strict=True)}

    def covered(**reading: list[float]) -> float:
        choice = RecordingChoice("run.csv", reading=LogFormat(**reading))  # pyright: ignore[reportArgumentType]
        study = Study(RobotChoice("iiwa14-r820"), ModelChoice(), (choice,))
        found = identify(study, given={"run.csv": log.recording})
        values = found.estimate.base.values_of(np.array([true.get(p.name, 0.0) for p in found.model.parameters]))
        low, high = found.estimate.intervals.T
        return float(np.mean((low <= values) & (values <= high)))

    assert covered(**keys) >= 0.95 > 0.75 >= covered(drive_gain=keys["drive_gain"])


@pytest.mark.parametrize("factor", [0.5, 2.0])
def test_twice_and_half_the_described_torque_are_no_error(factor: float):
    case = described()
    assert case.recording.effort is not None
    assert errors(findings(case.logged(effort=factor * case.recording.effort))) == []


def test_a_hanging_arm_that_is_described_as_upright_is_told():
    found = errors(findings(described(), gravity=(0.0, 0.0, 9.81)))
    assert [code for code, _ in found] == ["gravity-direction"] and "-9.81" in found[0][1]


def test_what_a_reading_has_wrong_is_told_once_for_all_its_recordings_and_with_the_name_of_one():
    case, other = described(), described(SEED + 1)
    assert case.recording.effort is not None and other.recording.effort is not None
    first = case.logged(effort=-case.recording.effort)
    second = replace(other.recording, effort=-other.recording.effort, dq=None, sha256="another")
    (found,) = [f for f in findings(first, second) if f.severity == "error"]
    assert found.code == "torque-sign" and found.evidence.startswith(("run0.csv: ", "run1.csv: "))


def test_what_is_wrong_with_one_log_alone_is_told_with_its_name():
    case, other = described(), described(SEED + 1)
    assert other.recording.effort is not None
    effort = other.recording.effort.copy()
    stuck = slice(len(effort) // 2, len(effort) // 2 + len(effort) // 8)
    effort[stuck, 3] = effort[stuck.start, 3]
    found = findings(case, replace(other.recording, effort=effort, dq=None, sha256="another"))
    (dead,) = (f for f in found if f.code == "channel-dead")
    assert dead.evidence.startswith("run1.csv: effort stays") and np.isfinite(len(found))


def test_a_recording_that_validates_is_examined_itself_and_told_by_its_name():
    case, other = described(), described(SEED + 1)
    assert case.recording.effort is not None and other.recording.effort is not None
    fine = replace(other.recording, dq=None, sha256="fine")
    turned = replace(other.recording, effort=-other.recording.effort, dq=None, sha256="turned")
    days = "day{}/log.csv"
    (found,) = [f for f in findings(case, fine, turned, train=1, name=days) if f.severity == "error"]
    assert found.code == "torque-sign" and found.evidence.startswith("day2/log.csv: ")
    both = replace(case, recording=replace(case.recording, effort=-case.recording.effort, dq=None))
    (found,) = [f for f in findings(both, turned, fine, train=1) if f.severity == "error"]
    assert found.evidence.startswith("run0.csv: ") and found.evidence.endswith(" The same was found in run1.csv.")


def test_names_tell_recordings_apart():
    paths = ("a/log.csv", "b/log.csv", "c.csv", "/a/log.csv")
    assert labels([RecordingChoice(path) for path in paths[:3]]) == ["a/log.csv", "b/log.csv", "c.csv"]
    assert labels([RecordingChoice(path) for path in paths[::3]]) == ["a/log.csv", "/a/log.csv"]
    assert labels([RecordingChoice("c.csv"), RecordingChoice("c.csv", "validate")]) == [
        "c.csv (train)",
        "c.csv (validate)",
    ]
    assert labels([RecordingChoice("c.csv")]) == [""]


def pushed(case: Case, share: float) -> Recording:
    """The case's recording with a push in it, at a share of its length."""
    time, log = case.motion.time, case.recording
    assert log.effort is not None
    limits = np.array([joint.effort_limit for joint in case.robot.joints])
    push = np.exp(-0.5 * ((time - share * time[-1]) / 0.25) ** 2)[:, None]
    return replace(log, effort=log.effort + 0.2 * limits * push, dq=None, sha256=f"pushed at {share}")


def test_what_happens_to_each_recording_is_told_of_each():
    case, other = described(), described(SEED + 1)
    sound_one = replace(case, recording=replace(case.recording, dq=None))
    found = findings(sound_one, pushed(case, 0.4), pushed(other, 0.6))
    told = sorted(f.evidence.split(":")[0] for f in found if f.code == "contact")
    assert told == ["run1.csv", "run2.csv"]
