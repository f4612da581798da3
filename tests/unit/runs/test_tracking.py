"""A run followed through the lab: friction that drifts, a load that is picked up, and nothing that is not there."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from armid.errors import ArmidError, EstimationError
from armid.lab.friction import Warmth
from armid.lab.known_arms import KnownArm
from armid.lab.options import LabOptions
from armid.lab.sensors import Sensing, SensorChannel
from armid.lab.simulation import Simulated, simulate
from armid.maths.inertia import com_inertia_to_vector
from armid.measurement.recording import Recording
from armid.runs import tracking
from armid.runs.run import Run, load_run, save_run
from armid.runs.tracking import THRESHOLD, track, track_record, track_table
from armid.study.config import ModelChoice, RecordingChoice, RobotChoice, Study
from armid.study.identify import identify
from labs import write_arm, write_recording
from plants import short_plan, small_arm

SENSORS = Sensing(100.0, SensorChannel(noise=1e-6), SensorChannel(noise=0.05))
LOAD = com_inertia_to_vector(0.8, np.array([0.05, 0.02, 0.1]), np.diag([0.004, 0.005, 0.003]))
PICKED = 32.0
"""Time at which the load is picked up [s]: the end of the fourth repetition."""


def moved(truth: KnownArm, seed: int, repetitions: int, period: float = 8.0) -> Simulated:
    options = LabOptions(mode="inverse-dynamics", repetitions=repetitions, sensing=SENSORS)
    return simulate(truth, short_plan(seed, period), options, seed=seed)


def then(first: Recording, second: Recording) -> Recording:
    """Two recordings of one motion, one after the other."""
    assert first.time is not None and second.time is not None
    assert first.effort is not None and second.effort is not None
    after = second.time - second.time[0] + first.time[-1] + 0.01
    return replace(
        first,
        time=np.concatenate([first.time, after]),
        q=np.vstack([first.q, second.q]),
        effort=np.vstack([first.effort, second.effort]),
        valid=np.vstack([first.valid, second.valid]),
        sha256="",
    )


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """The small arm as it was before."""
    folder = tmp_path_factory.mktemp("earlier")
    path = write_recording(moved(small_arm(), 1, 6).recording, folder / "free.npz")
    study = Study(
        RobotChoice(str(write_arm(folder))),
        ModelChoice(("rigid-body", "viscous", "coulomb"), {"coulomb": {"width": 0.0}}),
        (RecordingChoice(str(path)),),
    )
    return load_run(save_run(identify(study), folder / "run"))


def test_friction_that_drifts_is_followed(run: Run, tmp_path: Path):
    """Viscous friction falls by a third while the gears warm up; the bodies stay."""
    warmth = Warmth(np.full(3, 0.02), np.array([0.2, 0.25, 0.4]), np.full(3, 100.0), np.zeros(3))
    plain = small_arm()
    warm = moved(replace(plain, friction=replace(plain.friction, warmth=warmth)), 2, 20)
    path = write_recording(warm.recording, tmp_path / "shift.npz")
    found = track(run, [str(path)], {}, memory=15.0)
    trace = warm.trace.from_time(0.0)
    assert trace.rise is not None
    at = np.searchsorted(trace.time, found.time)
    truth = plain.friction.viscous * np.exp(-0.02 * trace.rise[at])
    assert (truth[-1] < 0.8 * truth[0]).all()
    own = [found.names.index(f"FV_{j}") for j in (1, 2, 3)]
    error = np.abs(found.values[:, own] - truth)
    # What is known is about as old as the memory is long; at first the run makes it older.
    slope = np.abs(np.gradient(truth, found.time, axis=0)).max(axis=0)
    assert (error.max(axis=0) <= 1.5 * 15.0 * slope).all()
    assert (np.sqrt(np.mean(error**2, axis=0)) <= 0.25 * (truth[0] - truth[-1])).all()
    alone = np.abs(run.estimate.fit.values[own] - truth[-1])
    assert (error[-1] <= 0.2 * alone).all()
    bodies = [k for k, name in enumerate(found.names) if not name.startswith("F")]
    drift = np.abs(found.values[:, bodies] - run.estimate.fit.values[bodies])
    spread = np.sqrt(found.deviation[:, bodies] ** 2 + np.diag(run.estimate.fit.covariance)[bodies])
    assert np.mean(drift <= 1.96 * spread) > 0.9 and (drift <= 5.0 * spread).all()
    assert not found.events


def test_a_load_that_is_picked_up_is_found(run: Run, tmp_path: Path):
    """In the block that ends there, into which the filter carries it, or the next; 1 % of mass four seconds later."""
    plain = small_arm()
    heavy = plain.inertial.copy()
    heavy[-1] += LOAD
    carrying = replace(plain, inertial=heavy)
    both = then(moved(plain, 2, 4).recording, moved(carrying, 2, 4).recording)
    path = write_recording(both, tmp_path / "picking.npz")
    found = track(run, [str(path)], {}, memory=5.0, changed="tool")
    mass = found.names.index("M")
    before, after = found.time < PICKED - 1.0, found.time > PICKED + 4.0
    assert found.events and PICKED - 1.0 <= found.events[0].time <= PICKED + 1.0
    assert len(found.events) <= 4 and found.events[-1].time <= PICKED + 3.0
    assert (found.normalized_innovation[before] < THRESHOLD).all()
    settled = before & (found.time > 4.0)
    assert np.abs(found.values[settled, mass]).max() < 0.01
    assert np.abs(found.values[after, mass] - LOAD[0]).max() < 0.01 * LOAD[0]
    load = slice(mass, mass + 10)
    late = found.time > PICKED + 8.0
    off = np.abs(found.values[late, load] - LOAD) / found.deviation[late, load]
    assert np.mean(off < 1.96) > 0.8
    friction = [found.names.index(name) for name in ("FV_1", "FS_1", "FV_2", "FS_2", "FV_3", "FS_3")]
    apart = np.abs(found.values[late][:, friction] - run.estimate.fit.values[friction])
    assert (apart <= 5.0 * found.deviation[late][:, friction]).all()
    # What the run alone says of the torque is far off by then; what is tracked is as good as before.
    assert np.median(found.error[late]) < 1.5 * np.median(found.error[settled])
    assert np.median(found.before[late]) > 3.0 * np.median(found.error[late])


def test_nothing_changed_changes_nothing(run: Run, tmp_path: Path):
    path = write_recording(moved(small_arm(), 3, 6).recording, tmp_path / "same.npz")
    found = track(run, [str(path)], {}, memory=20.0, changed="all")
    spread = np.sqrt(found.deviation**2 + np.diag(run.estimate.fit.covariance))
    apart = np.abs(found.values - run.estimate.fit.values) / spread
    assert not found.events and np.mean(apart[5:] < 1.96) > 0.85


def test_the_table_and_the_record_hold_every_block(run: Run, tmp_path: Path):
    paths = [str(write_recording(moved(small_arm(), seed, 1).recording, tmp_path / f"{seed}.npz")) for seed in (4, 5)]
    found = track(run, paths, {}, block=2.0)
    assert (np.diff(found.time) > 0.0).all() and 14.0 < found.time[-1] < 17.0
    header, *rows = track_table(found).splitlines()
    assert len(rows) == len(found.time)
    assert header.split(",")[:3] == ["t", found.names[0], f"{found.names[0]}_deviation"]
    record = track_record(found)
    assert [each["name"] for each in record["parameters"]] == list(found.names)
    assert float(rows[-1].split(",")[1]) == pytest.approx(record["parameters"][0]["value"][-1], rel=1e-9)


def test_times_since_1970_keep_their_digits(run: Run, tmp_path: Path):
    log = moved(small_arm(), 2, 1).recording
    assert log.time is not None
    path = write_recording(replace(log, time=log.time + 1.7e9), tmp_path / "log.npz")
    found = track(run, [str(path)], {})
    times = [float(row.split(",")[0]) for row in track_table(found).splitlines()[1:]]
    np.testing.assert_allclose(
        times, found.time, rtol=0.0, atol=1e-5
    )  # a table with tenths of seconds misses by 0.05
    assert not [each.code for each in found.findings if each.severity == "error"]


@pytest.mark.parametrize(("memory", "block"), [(0.0, 1.0), (30.0, 0.0), (30.0, np.inf)])
def test_times_that_are_none_are_refused(run: Run, memory: float, block: float):
    with pytest.raises(ArmidError, match="above 0 s"):
        track(run, [], {}, memory=memory, block=block)


def test_an_estimate_that_fails_names_the_faults_of_the_recording(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    recording = moved(small_arm(), 5, 2).recording
    assert recording.effort is not None
    turned = replace(recording, effort=recording.effort * np.array([1.0, 1.0, -1.0]))
    path = write_recording(turned, tmp_path / "sign.npz")

    def failed(*_: object) -> None:
        raise EstimationError("The weights did not converge.")

    monkeypatch.setattr(tracking, "update", failed)
    with pytest.raises(EstimationError, match=r"did not converge.*\[torque-sign\]"):
        track(run, [str(path)], {})
