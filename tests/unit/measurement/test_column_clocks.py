"""Clocks without a known name: a unit of time and growth make one, growth alone is named in the hint."""

import tomllib

import numpy as np
import pytest

from armid.errors import RecordingError
from armid.measurement.columns.clocks import ClockRequest, clock_columns
from armid.measurement.columns.column_name_parsing import time_unit
from armid.measurement.log_format import LogFormat
from armid.measurement.processing.row_checks import clean
from armid.measurement.readers import load_recording
from recordings import write_csv, write_workbook

RNG = np.random.default_rng(7)
T = np.arange(100) / 250.0
Q = np.cumsum(RNG.normal(size=(100, 2)), axis=0)
BODY = {"q1": Q[:, 0], "q2": Q[:, 1], "tau1": Q[:, 1], "tau2": Q[:, 0]}


def read(path, **said):
    how = LogFormat(**said)
    raw = load_recording(path, how)
    return raw, clean(raw, LogFormat(**(raw.guessed | said)))[0]


@pytest.mark.parametrize(
    ("name", "unit"),
    [
        ("Zeit [s]", 1.0),
        ("Zeit [ms]", 1e-3),
        ("Laufzeit (ms)", 1e-3),
        ("t(ms)", 1e-3),
        ("t/ms", 1e-3),
        ("Zeit in s", 1.0),
        ("tick_us", 1e-6),
        ("Sample time [ns]", 1e-9),
        ("czas [s]", 1.0),
        ("Zeitstempel", 1.0),
    ],
)
def test_what_has_a_unit_of_time_and_grows_is_the_clock(tmp_path, name, unit):
    path = write_csv(tmp_path / "run.csv", {**BODY, name: T / unit})
    raw, settled = read(path)
    assert raw.columns["time"] == (name,)
    np.testing.assert_allclose(settled.time, T, atol=1e-12)
    assert [finding.code for finding in raw.findings] == ["columns-guessed"]
    assert raw.findings[0].evidence.startswith("The time column was chosen by its name: time is ")
    # What is pasted reads the same.
    np.testing.assert_allclose(read(path, **tomllib.loads(raw.findings[0].remedy))[1].time, T, atol=1e-12)


@pytest.mark.parametrize("kind", ["npz", "mat", "parquet", "xlsx"])
def test_every_format_of_columns_has_the_law(tmp_path, kind):
    columns = {**BODY, "Laufzeit_ms": 1e3 * T}
    path = tmp_path / f"run.{kind}"
    if kind == "npz":
        np.savez(path, **columns)
    elif kind == "mat":
        pytest.importorskip("scipy.io").savemat(path, columns)
    elif kind == "parquet":
        pa, pq = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
        pq.write_table(pa.table(columns), path)
    else:
        write_workbook(path, columns)
    np.testing.assert_allclose(read(path)[1].time, T, atol=1e-12)


def test_a_duration_that_does_not_grow_is_no_clock():
    columns = {"cycle [ms]": np.full(100, 4.0), "delay [s]": RNG.normal(size=100), "uptime [ms]": 5e6 + 1e3 * T}
    assert clock_columns(list(columns), columns.__getitem__) == ("uptime [ms]",)
    del columns["uptime [ms]"]
    assert clock_columns(list(columns), columns.__getitem__) == ()


def test_two_clocks_of_one_time_are_one_and_of_two_a_question():
    columns = {"Zeitmarke [s]": T, "Laufzeit [ms]": 1e3 * T}
    assert clock_columns(list(columns), columns.__getitem__) == ("Zeitmarke [s]",)
    columns["Laufzeit [ms]"] = 2e3 * T
    assert isinstance(clock_columns(list(columns), columns.__getitem__), ClockRequest)


def test_a_clock_with_a_fault_is_still_the_clock():
    """The fault is then what is told, and not that there is no clock."""
    back = T.copy()
    back[50] = back[40]
    assert clock_columns(["Marke [s]"], {"Marke [s]": back}.__getitem__) == ("Marke [s]",)


@pytest.mark.parametrize("unit", [1.0, 1e-3])
def test_a_column_that_grows_without_a_unit_is_named_in_the_hint(tmp_path, unit):
    path = write_csv(tmp_path / "run.csv", {"Stempel": T / unit, **BODY, "Laune": RNG.normal(size=100)})
    with pytest.raises(
        RecordingError, match=rf"'Stempel' \(by {0.004 / unit:g} per row\) increases uniformly"
    ) as caught:
        read(path)
    said = tomllib.loads(caught.value.remedy)
    assert said["columns"] == {"time": "Stempel"} and "Laune" not in str(caught.value)
    np.testing.assert_allclose(read(path, **said)[1].time, T, atol=1e-12)
    assert read(path, rate=250.0)[1].time is None  # a rate that is given is not doubted


def test_the_unit_of_a_named_clock_is_followed(tmp_path):
    path = write_csv(tmp_path / "run.csv", {"Zyklus [ms]": 1e3 * T, **BODY})
    raw, settled = read(path, columns={"time": "Zyklus [ms]"})
    np.testing.assert_allclose(settled.time, T, atol=1e-12)
    assert "time in ms" in raw.findings[0].evidence
    with pytest.raises(RecordingError, match="milliseconds") as caught:  # what is given wins, and is wrong here
        read(path, columns={"time": "Zyklus [ms]"}, time_unit=1.0)
    assert tomllib.loads(caught.value.remedy.splitlines()[0])["time_unit"] == 1e-3


def test_one_letter_is_a_unit_of_time_behind_a_sign_alone():
    assert [time_unit(name) for name in ("t_s", "zeit in ms", "t/s", "rows", "joints", "ms")] == [
        1.0,
        1e-3,
        1.0,
        None,
        None,
        None,
    ]


def test_a_clock_that_counts_no_known_unit_is_refused_by_its_rate(tmp_path):
    path = write_csv(tmp_path / "run.csv", {"t_ns": T * 1e-5, **BODY})
    with pytest.raises(RecordingError, match=r"if it counts nanoseconds, the sample rate is 2\.5e\+16 Hz") as caught:
        read(path)
    assert caught.value.code == "clock-unit" and "time_unit" in caught.value.remedy


def test_the_unit_of_a_preset_is_that_of_its_own_time_column():
    assert [LogFormat(preset=name).clock_unit for name in (None, "libfranka", "ur-rtde")] == [1.0, 1e-3, 1.0]
    assert LogFormat(preset="libfranka", columns={"time": "t"}).clock_unit == 1.0
    assert LogFormat(preset="libfranka", time_unit=1e-6).clock_unit == 1e-6
