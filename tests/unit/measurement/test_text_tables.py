"""Text tables and workbooks as programs and people write them."""

import bz2
import gzip
import lzma

import numpy as np
import pytest

from armid.errors import RecordingError
from armid.measurement.catalogue import recording_endings
from armid.measurement.log_format import LogFormat
from armid.measurement.readers import load_recording
from recordings import DQ, TABLE, TAU, N, Q, T, assert_same, refused, text, write_csv, write_workbook

CLOCK = 1e-6
"""Of a double that counts seconds of a day in microseconds, relative to the first."""


@pytest.mark.parametrize("delimiter", [";", "\t", " "])
def test_decimal_commas(tmp_path, delimiter):
    path = tmp_path / "run.csv"
    path.write_text(text(TABLE, delimiter=delimiter).replace(".", ","))
    assert_same(load_recording(path))


def test_decimal_commas_in_quotes_and_whole_numbers_first(tmp_path):
    rows = [
        '"{}"'.format('","'.join(repr(float(x)).replace(".", ",") for x in row))
        for row in zip(*TABLE.values(), strict=True)
    ]
    path = tmp_path / "run.csv"
    path.write_text("\n".join([",".join(TABLE), *rows]))
    assert_same(load_recording(path))
    whole = text(TABLE, delimiter=";").replace(".", ",").splitlines()
    whole[1] = ";".join("0" for _ in TABLE)
    path.write_text("\n".join(whole))
    np.testing.assert_array_equal(load_recording(path).q[1:], Q[1:])


@pytest.mark.parametrize(
    ("form", "first"),
    [
        ("2026-05-01T12:00:{:09.6f}", ""),
        ("2026-05-01 12:00:{:09.6f}", ""),
        ("2026-05-01T12:00:{:09.6f}Z", ""),
        ("2026-05-01T12:00:{:09.6f}+02:00", ""),
        ('"2026-05-01 12:00:{:012.9f}"', ""),
        ("12:00:{:06.3f}", ""),
    ],
)
def test_times_as_dates(tmp_path, form, first):
    rows = text(TABLE).splitlines()
    written = [form.format(0.01 * k + 12.3) + row[row.index(",") :] for k, row in enumerate(rows[1:])]
    path = tmp_path / "run.csv"
    path.write_text("\n".join([rows[0].replace("t,", "timestamp,", 1), *written]))
    recording = load_recording(path)
    assert first == ""
    np.testing.assert_allclose(recording.time - recording.time[0], T - T[0], rtol=0, atol=CLOCK)
    np.testing.assert_array_equal(recording.q, Q)
    refused("`time_unit` is given, but the time column .* contains dates", path, time_unit=0.001)
    path.write_text(path.read_text().replace(written[3].split(",")[0], "soon"))
    refused("line 5: timestamp is 'soon', which is neither a number nor a time", path)


def test_a_day_that_ends_and_summer_time(tmp_path):
    lines = ["time,q1,q2", "2026-10-24T23:59:59.5+02:00,1,2", "2026-10-24T22:00:00.25Z,1,2"]
    path = tmp_path / "run.csv"
    path.write_text("\n".join(lines))
    np.testing.assert_allclose(np.diff(load_recording(path).time), [0.75], atol=CLOCK)


PACKERS = {".gz": gzip.compress, ".xz": lzma.compress, ".bz2": bz2.compress}


@pytest.mark.parametrize("packed", PACKERS)
def test_packed_tables(tmp_path, packed):
    path = tmp_path / f"run.csv{packed}"
    path.write_bytes(PACKERS[packed](text(TABLE).encode()))
    assert_same(load_recording(path))
    path.write_bytes(path.read_bytes()[:60])
    refused("cannot be unpacked", path)
    assert f".csv{packed}" in recording_endings()


def test_tables_packed_by_zstd(tmp_path):
    pa = pytest.importorskip("pyarrow")
    path = tmp_path / "run.tsv.zst"
    path.write_bytes(pa.compress(text(TABLE, delimiter="\t").encode(), codec="zstd", asbytes=True))
    assert_same(load_recording(path))
    path.write_bytes(b"no such thing" * 5)
    refused("cannot be unpacked", path)
    (tmp_path / "run.npz.gz").write_bytes(b"x")
    refused("unknown format", tmp_path / "run.npz.gz")


@pytest.mark.parametrize("encoding", ["utf-16", "utf-8-sig", "cp1252"])
def test_encodings(tmp_path, encoding):
    path = tmp_path / "run.csv"
    table = {("Größe" if name == "none" else name): x for name, x in (TABLE | {"none": T}).items()}
    path.write_bytes(text(table, delimiter=";").encode(encoding))
    assert_same(load_recording(path))


def plain():
    return text(TABLE).splitlines()


SPOILT = {
    "blank lines first": lambda: ["", "  ", *plain()],
    "comments with notes": lambda: ["# robot: 3 joints, 10 kg", "# date, 2026", *plain()],
    "a header that is a comment": lambda: ["# notes", "# " + plain()[0], *plain()[1:]],
    "a header behind a per cent": lambda: ["%" + plain()[0], *plain()[1:]],
    "a delimiter at the end of rows": lambda: [plain()[0], *(row + "," for row in plain()[1:])],
    "a delimiter at the end of all": lambda: [row + "," for row in plain()],
    "a delimiter at the end of the header": lambda: [plain()[0] + ",", *plain()[1:]],
    "quotes": lambda: [",".join(f'"{name}"' for name in TABLE), *plain()[1:]],
    "the separator as Excel says it": lambda: ["sep=,", *plain()],
    "units below": lambda: [plain()[0], ",".join(["s", *["rad"] * 3, *["rad/s"] * 3, *["Nm"] * 3]), *plain()[1:]],
    "units below in brackets": lambda: [plain()[0], ",".join(["[s]"] + ["[rad]"] * 3 + [""] * 6), *plain()[1:]],
    "notes without a mark": lambda: ["Recorder 2.1", "Operator: me", *plain()],
    "comments among the rows": lambda: [*plain()[:5], "# a pause", *plain()[5:]],
    "a column of texts": lambda: ["note," + plain()[0], *("ok," + row for row in plain()[1:])],
}


@pytest.mark.parametrize("kind", SPOILT)
def test_what_stands_around_the_numbers(tmp_path, kind):
    path = tmp_path / "run.csv"
    path.write_text("\n".join(SPOILT[kind]()) + "\n")
    assert_same(load_recording(path))


def test_units_below_the_header_are_followed(tmp_path):
    table = {name: np.degrees(x) if name[0] in "qd" else x for name, x in TABLE.items()} | {"t": 1e3 * T}
    lines = text(table).splitlines()
    lines.insert(1, ",".join(["ms", *["deg"] * 3, *["deg/s"] * 3, *["Nm"] * 3]))
    path = tmp_path / "run.csv"
    path.write_text("\n".join(lines))
    recording = load_recording(path)
    np.testing.assert_allclose(recording.time, T, rtol=1e-14)
    np.testing.assert_allclose(np.radians(recording.q), Q, rtol=1e-13)
    assert recording.guessed["units"] == "deg"
    np.testing.assert_allclose(np.radians(recording.dq), DQ, rtol=1e-13)


def test_a_name_that_stands_twice_is_refused(tmp_path):
    lines = ["t,q1,q1,tau1", *("0,1,2,3" for _ in range(N))]
    path = tmp_path / "run.csv"
    path.write_text("\n".join(lines))
    refused("2 columns have the same name 'q1'", path)
    path.write_text("\n".join(["t,q1,note,note", *lines[1:]]))
    assert load_recording(path).n == 1


def test_many_columns_cost_their_reading_alone(tmp_path):
    table = TABLE | {f"other_{k}": T for k in range(2000)}
    assert_same(load_recording(write_csv(tmp_path / "wide.csv", table)))


def test_a_workbook(tmp_path):
    pytest.importorskip("python_calamine")
    assert_same(load_recording(write_workbook(tmp_path / "run.xlsx", notes=("Recorder 2.1",))))
    degrees = {f"q{k + 1} [deg]": np.degrees(Q[:, k]) for k in range(3)} | {"tau1": TAU[:, 0], "t": T}
    with pytest.raises(RecordingError, match="3 columns of q"):
        load_recording(write_workbook(tmp_path / "few.xlsx", degrees))
    spoilt = {"t": T, "q1": [*Q[:-1, 0], "off"], "q2": Q[:, 1]}
    refused("row 26: q1 is 'off', not a number", write_workbook(tmp_path / "off.xlsx", spoilt))
    # A row of a message is the row of the sheet, also below empty rows at its top and between the notes.
    refused("row 29: q1 is 'off'", write_workbook(tmp_path / "low.xlsx", spoilt, notes=("", "Recorder 2.1", "")))
    refused("has no sheet with a table", write_workbook(tmp_path / "none.xlsx", {"t": []}))
    assert load_recording(tmp_path / "run.xlsx", LogFormat(columns={"dq": ""})).dq is None
