"""Clocks of recorded arms: what `../shared/data` says about them is what processing finds."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from armid.measurement.processing.pipeline import ProcessingOptions, process_recording, resolve_options
from armid.measurement.processing.uniform_runs import cut_at_gaps, jitter
from armid.measurement.recording import Recording

pytestmark = pytest.mark.real

PANDA = "franka_panda_gaz/exciting_first70.parquet"
UR10E = "ur10e_innopolis/ur-20_02_12-50sec_12harm.parquet"
GEN3 = "kinova_gen3_raptor/traj_5.parquet"


def read(folder: Path, name: str, joints: int, effort: str) -> Recording:
    table = pytest.importorskip("pyarrow.parquet").read_table(folder / name)

    def columns(prefix: str):
        names = [f"{prefix}{k}" for k in range(1, joints + 1)]
        if names[0] not in table.column_names:
            return None
        return np.column_stack([table[name].to_numpy() for name in names])

    return Recording(
        time=table["t"].to_numpy(),
        q=np.unwrap(columns("q"), axis=0),
        dq=columns("dq"),
        ddq=columns("ddq"),
        effort=columns(effort),
        source=name,
    )


def test_the_panda_log_jitters_and_is_one_run(shared_data: Path):
    log = read(shared_data, PANDA, 7, "tau")
    steps = np.diff(log.time)
    assert (steps.min(), steps.max()) == pytest.approx((0.0007, 0.0088), abs=1e-4)
    runs, findings = process_recording(log, ProcessingOptions())
    # The longest step is shorter than a tenth of a period of 5 Hz: bridged, and said so.
    assert len(runs) == 1 and runs[0].rate == 1000.0 and runs[0].step == 40
    assert [finding.code for finding in findings] == ["clock-jitter"]
    assert "0.0007 to 0.00881 s" in findings[0].evidence
    # Without a filter the same two steps are gaps.
    runs, findings = process_recording(log, ProcessingOptions(family="none"))
    assert len(runs) == 3 and [finding.code for finding in findings].count("clock-gap") == 2


def test_velocities_from_positions_agree_with_the_arm_better_on_its_clock_than_on_an_even_one(shared_data: Path):
    for name, joints, effort in ((UR10E, 6, "i"), ("kinova_gen3_raptor/traj_1.parquet", 7, "tau")):
        log = read(shared_data, name, joints, effort)
        filtered = ProcessingOptions(derivatives="filter")
        (run,), _ = process_recording(log, filtered)
        even = Recording(
            time=None,
            rate=(log.samples - 1) / float(log.time[-1] - log.time[0]),
            q=log.q,
            effort=log.effort,
            source=name,
        )
        (other,), _ = process_recording(even, filtered)
        measured = np.column_stack([np.interp(run.motion.time, log.time, v) for v in log.dq.T])
        inner = slice(100, -100)
        on_clock = np.sqrt(np.mean((run.motion.dq - measured)[inner] ** 2))
        nearest = np.searchsorted(log.time, run.motion.time).clip(0, log.samples - 1)
        off_clock = np.sqrt(np.mean((other.motion.dq[nearest] - measured)[inner] ** 2))
        assert on_clock < 0.7 * off_clock, name


def test_the_ur10e_log_jitters_between_2_and_16_ms(shared_data: Path):
    log = read(shared_data, UR10E, 6, "i")
    steps = np.diff(log.time)
    assert (steps.min(), steps.max()) == pytest.approx((0.002, 0.016), abs=1e-4)
    assert jitter(log.time) > 0.3
    runs, findings = process_recording(log, ProcessingOptions())
    assert len(runs) == 1 and runs[0].rate == 100.0
    assert [finding.code for finding in findings] == ["clock-jitter"]


def test_the_gap_of_the_gen3_splits_its_run(shared_data: Path):
    log = read(shared_data, GEN3, 7, "tau")
    segments, findings = cut_at_gaps(log, None)
    assert [piece.samples for piece in segments] == [28, 1332]
    assert [finding.code for finding in findings] == ["clock-gap"] and "0.16 s" in findings[0].evidence
    runs, findings = process_recording(log, ProcessingOptions(family="none"))
    # The 0.28 s before the gap are shorter than what is trimmed.
    assert len(runs) == 1 and {finding.code for finding in findings} == {"clock-gap", "clock-jitter", "run-short"}
    # Recorded derivatives and no filter: the samples themselves.
    assert np.array_equal(runs[0].torque, log.effort[28:]) and np.array_equal(runs[0].motion.dq, log.dq[28:])


@pytest.mark.parametrize(
    ("name", "joints", "effort", "low", "high"),
    # Ten times the highest harmonic of the excitation, roughly: nothing but the order of magnitude is known.
    [(PANDA, 7, "tau", 3.0, 8.0), (UR10E, 6, "i", 2.0, 6.0), ("staubli_tx40/first70.parquet", 6, "taum", 15.0, 60.0)],
)
def test_the_automatic_cutoff_suits_arms_fast_and_slow(
    shared_data: Path, name: str, joints: int, effort: str, low: float, high: float
):
    if name.startswith("staubli"):
        table = pytest.importorskip("pyarrow.parquet").read_table(shared_data / name)
        q = np.column_stack([table[f"qm{k}"].to_numpy() for k in range(1, 7)])
        log = Recording(time=table["t"].to_numpy(), q=q, effort=q, source=name)
    else:
        log = read(shared_data, name, joints, effort)
    assert low < float(resolve_options(ProcessingOptions(cutoff="auto"), [log]).cutoff) < high
