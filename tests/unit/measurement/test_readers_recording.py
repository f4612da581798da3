import pickle
import pkgutil
import sys
import zlib

import numpy as np
import pytest
import scipy.io

from armid.dataclass_files import save
from armid.errors import MissingExtraError
from armid.hashes import sha256_of_file
from armid.measurement import readers
from armid.measurement.catalogue import READERS, recording_suffixes
from armid.measurement.log_format import LogFormat
from armid.measurement.readers import load_recording
from armid.measurement.recording import Recording
from recordings import DDQ, DQ, TABLE, TAU, N, Q, T, assert_same, refused, text, write_csv, write_parquet, write_v73

# The catalogue


def test_every_module_of_the_folder_is_in_the_catalogue():
    modules = {module.name for module in pkgutil.iter_modules(readers.__path__)}
    assert modules == {each.module.rsplit(".", 1)[-1] for each in READERS.values()}
    suffixes = recording_suffixes()
    assert len(set(suffixes)) == len(suffixes)
    assert all(suffix == suffix.lower() and suffix.startswith(".") for suffix in suffixes)


def test_a_missing_an_empty_and_an_unknown_file(tmp_path):
    refused("does not exist", tmp_path / "no.csv")
    error = refused("unknown format", tmp_path / "run.docx")
    assert ".csv" in error.possible and ".mcap" in error.possible
    for suffix in recording_suffixes():
        path = tmp_path / f"empty{suffix}"
        path.write_bytes(b"")
        refused("is empty", path)


@pytest.mark.parametrize("suffix", recording_suffixes())
@pytest.mark.parametrize("content", [b"junk " * 300, bytes(range(256)) * 8, b"\x00" * 700])
def test_junk_is_refused_in_words_whatever_it_calls_itself(tmp_path, suffix, content):
    path = tmp_path / f"junk{suffix}"
    path.write_bytes(content)
    refused("junk", path)


def test_source_and_sha256_say_what_was_read(tmp_path):
    path = write_csv(tmp_path / "run.CSV")
    recording = load_recording(str(path))
    assert recording.source == str(path)
    assert recording.sha256 == sha256_of_file(path)


# Tables and matrices: the same numbers back from every format


def test_csv_gives_the_same_numbers(tmp_path):
    assert_same(load_recording(write_csv(tmp_path / "run.csv")))


@pytest.mark.parametrize("delimiter", [",", ";", "\t", " "])
@pytest.mark.parametrize("suffix", [".csv", ".tsv", ".txt"])
def test_the_delimiter_is_found(tmp_path, delimiter, suffix):
    assert_same(load_recording(write_csv(tmp_path / f"run{suffix}", delimiter=delimiter)))


def test_csv_as_programs_write_it(tmp_path):
    plain = text(TABLE)
    header, rest = plain.split("\n", 1)
    variants = {
        "bom": "\ufeff" + plain,
        "crlf": plain.replace("\n", "\r\n"),
        "spaces": plain.replace(",", ", "),
        "blank-lines": plain.replace("\n", "\n\n"),
        "comment-above": "# recorded on a Monday\n" + plain,
        "numpy-header": "# " + plain,
        "quoted": ",".join(f'"{name}"' for name in header.split(",")) + "\n" + rest,
        "text-column": "mode," + header + "\n" + "".join(f'"run, fast",{row}\n' for row in rest.splitlines()),
    }
    for name, content in variants.items():
        path = tmp_path / f"{name}.csv"
        path.write_text(content, newline="")
        assert_same(load_recording(path))


def test_parquet_gives_the_same_numbers_and_reads_no_other_column(tmp_path):
    assert_same(load_recording(write_parquet(tmp_path / "run.parquet", TABLE | {"note": ["x"] * N})))


def test_npz_with_matrices_and_with_vectors(tmp_path):
    np.savez(tmp_path / "matrices.npz", t=T, q=Q, dq=DQ, ddq=DDQ, tau=TAU, joint_names=np.array(["a", "b", "c"]))
    recording = load_recording(tmp_path / "matrices.npz")
    assert_same(recording, ddq=DDQ)
    assert recording.joint_names == ("a", "b", "c")
    np.savez(tmp_path / "vectors.npz", **TABLE)
    assert_same(load_recording(tmp_path / "vectors.npz"))


def test_npz_saved_by_armid_keeps_what_it_knows(tmp_path):
    saved = Recording(time=None, q=Q, effort=TAU, rate=50.0, consecutive=True, joint_names=("a", "b", "c"))
    save(saved, tmp_path / "lab.npz")
    recording = load_recording(tmp_path / "lab.npz")
    assert (recording.rate, recording.consecutive, recording.joint_names) == (50.0, True, ("a", "b", "c"))
    np.testing.assert_array_equal(recording.effort, TAU)
    assert load_recording(tmp_path / "lab.npz", LogFormat(rate=60)).rate == 60.0


def test_matlab_version_5(tmp_path):
    names = np.array(["joint_1", "b", "c"], dtype=object)
    scipy.io.savemat(tmp_path / "run.mat", {"t": T, "q": Q, "qd": DQ, "tau": TAU, "names": names, "note": "hello"})
    recording = load_recording(tmp_path / "run.mat")
    assert_same(recording)
    assert recording.joint_names == ("joint_1", "b", "c")
    scipy.io.savemat(tmp_path / "vectors.mat", TABLE, do_compression=True)
    assert_same(load_recording(tmp_path / "vectors.mat"))


def test_matlab_version_7_3_is_transposed_on_disk(tmp_path):
    variables = {"t": T, "q": Q, "dq": DQ, "tau": TAU}
    recording = load_recording(write_v73(tmp_path / "run.mat", variables, ("joint_1", "b", "c")))
    assert_same(recording)
    assert recording.joint_names == ("joint_1", "b", "c")
    assert_same(load_recording(write_v73(tmp_path / "vectors.mat", TABLE)))


def test_a_matrix_that_lies_on_its_side_is_refused_not_turned(tmp_path):
    np.savez(tmp_path / "side.npz", t=T, q=Q.T, tau=TAU.T)
    refused(
        r"time has shape \(25,\), but it must have shape \(3,\), because q has shape \(3, 25\)", tmp_path / "side.npz"
    )


def test_variables_of_no_use_as_channels(tmp_path):
    path = tmp_path / "run.npz"
    np.savez(path, q1=Q[:, 0], q2=Q[:-1, 1])
    refused("columns differ in length: q1 25, q2 24", path)
    np.savez(path, q=np.zeros((2, 2, 2)))
    refused("'q' has 3 dimensions", path)
    np.savez(path, q=1.0)
    refused("'q' has 0 dimensions", path)
    np.savez(path, q=1j * Q)
    refused("'q' holds complex128, not numbers", path)


def test_one_joint(tmp_path):
    one = {"t": T, "q": Q[:, 0], "tau": TAU[:, 0]}
    scipy.io.savemat(tmp_path / "lying.mat", one)
    scipy.io.savemat(tmp_path / "standing.mat", one, oned_as="column")
    for path in (write_csv(tmp_path / "one.csv", one), tmp_path / "lying.mat", tmp_path / "standing.mat"):
        recording = load_recording(path)
        np.testing.assert_array_equal(recording.q, Q[:, :1])
        np.testing.assert_array_equal(recording.effort, TAU[:, :1])


# Bad tables


def test_a_broken_row_is_named_by_its_line(tmp_path):
    lines = text(TABLE).splitlines()
    path = tmp_path / "run.csv"
    path.write_text("\n".join([*lines[:9], lines[9][:40], *lines[10:]]))
    assert "remove this line" in refused(r"line 10 has \d fields, but the header has 10", path).remedy
    path.write_text("\n".join([*lines[:9], "", lines[9] + ",1", *lines[10:]]))
    refused("line 11 has 11 fields", path)
    path.write_text("\n".join([*lines[:9], lines[9][:40], *lines[10:-1], lines[-1][:40]]))
    refused("line 10 has ", path)  # a cut end does not excuse it
    path.write_text("\n".join([*lines[:9], "log restarted", *lines[9:]]))
    refused(f"line 10 has 1 field, but the header has 10, and {N - 8} rows follow it: log restarted", path)
    path.write_text("\n".join([lines[0], lines[1][:40]]))
    refused("line 2 has ", path)  # no complete row is left


@pytest.mark.parametrize("delimiter", [",", ";", " "])
def test_a_last_row_that_was_cut_off_is_left_out_and_said(tmp_path, delimiter):
    lines = text(TABLE, delimiter).splitlines()
    path = tmp_path / "run.csv"
    fields = lines[-1].split(delimiter)
    cut = [
        "0",
        delimiter.join(fields[:3]),
        delimiter.join([*fields[:-1], "-"]),
        delimiter.join([*fields[:-1], "1.2e"]),
    ]
    for end in cut if delimiter == " " else [*cut, delimiter.join([*fields[:-1], ""])]:
        path.write_text("\n".join([*lines[:-1], end]))
        recording = load_recording(path)
        np.testing.assert_array_equal(recording.q, Q[:-1])
        np.testing.assert_array_equal(recording.effort, TAU[:-1])
        (said,) = (finding for finding in recording.findings if finding.code == "row-incomplete")
        assert said.severity == "warning" and f"line {N + 1}," in said.evidence and f"{N - 1} rows" in said.evidence
    path.write_text("\n".join(lines))  # without the last end of line, but complete
    recording = load_recording(path)
    np.testing.assert_array_equal(recording.q, Q)
    assert "row-incomplete" not in {finding.code for finding in recording.findings}


def test_a_field_that_is_no_number_is_named(tmp_path):
    path = tmp_path / "run.csv"
    path.write_text(text(TABLE).replace(repr(float(TAU[4, 1])), "over"))
    refused("line 6: tau2 is 'over', not a number", path)
    path.write_text(text(TABLE, delimiter=";").replace(repr(float(TAU[4, 1])), "1.234,5"))
    assert "thousands" in refused("line 6: tau2 is '1.234,5', not a number", path).remedy


def test_an_empty_field_is_nan_and_left_to_the_checks(tmp_path):
    path = tmp_path / "run.csv"
    path.write_text(text(TABLE).replace(repr(float(TAU[4, 1])), ""))
    tau = TAU.copy()
    tau[4, 1] = np.nan
    assert_same(load_recording(path), tau=tau)


def test_a_table_without_header_or_rows(tmp_path):
    path = tmp_path / "run.csv"
    path.write_text("1.0,2.0\n3.0,4.0\n")
    refused("has no header: line 1", path)
    path.write_text("t,q1,tau1\n\n")
    refused("a header, but no rows", path)
    path.write_text("\n\n")
    refused("is empty", path)


def test_truncated_parquet_is_refused(tmp_path):
    whole = write_parquet(tmp_path / "run.parquet").read_bytes()
    for share in (0.2, 0.9, 0.999):
        (tmp_path / "cut.parquet").write_bytes(whole[: int(share * len(whole))])
        refused("cannot be read as Parquet", tmp_path / "cut.parquet")


def test_a_text_column_is_no_torque(tmp_path):
    path = write_parquet(tmp_path / "run.parquet", TABLE | {"tau2": np.array(["x"] * N)})
    refused("'tau2' holds object, not numbers", path)


def test_whole_numbers_and_nulls_in_parquet(tmp_path):
    import pyarrow as pa
    import pyarrow.parquet as pq

    pq.write_table(pa.table({"q1": [1, 2, 3], "tau1": [1.0, None, 3.0]}), tmp_path / "run.parquet")
    recording = load_recording(tmp_path / "run.parquet")
    np.testing.assert_array_equal(recording.q[:, 0], [1.0, 2.0, 3.0])
    np.testing.assert_array_equal(recording.effort[:, 0], [1.0, np.nan, 3.0])


class Bomb:
    """Pickle of an attacker."""

    def __reduce__(self):
        return exec, ("raise SystemExit('unpickled')",)


@pytest.mark.parametrize("suffix", [".npz", ".mat"])
def test_a_pickle_by_another_name_is_never_unpickled(tmp_path, suffix):
    path = tmp_path / f"bomb{suffix}"
    path.write_bytes(pickle.dumps({"q": Bomb()}))
    refused("pickle would be needed" if suffix == ".npz" else "cannot be read as a MATLAB file", path)


def test_an_archive_with_objects_is_refused(tmp_path):
    np.savez(tmp_path / "run.npz", q=np.array([Bomb()], dtype=object))
    refused("pickle would be needed", tmp_path / "run.npz")
    np.savez(tmp_path / "side.npz", **TABLE, note=np.array([Bomb()], dtype=object))
    assert_same(load_recording(tmp_path / "side.npz"))


def test_truncated_archives_are_refused(tmp_path):
    np.savez(tmp_path / "run.npz", **TABLE)
    scipy.io.savemat(tmp_path / "run.mat", TABLE, do_compression=True)
    write_v73(tmp_path / "new.mat", TABLE)
    for name in ("run.npz", "run.mat", "new.mat"):
        whole = (tmp_path / name).read_bytes()
        for share in (0.3, 0.7):
            (tmp_path / f"cut-{name}").write_bytes(whole[: int(share * len(whole))])
            refused("cut-", tmp_path / f"cut-{name}")


def test_matlab_structs_cells_and_objects_are_refused(tmp_path):
    import h5py

    for name, value in (("struct", {"a": 1.0}), ("cell", np.array([1.0, "x"], dtype=object)), ("char", "text")):
        scipy.io.savemat(tmp_path / "run.mat", {"q": value, "tau": TAU})
        refused(f"q has the class '{name}', but it must be a matrix", tmp_path / "run.mat")
    path = write_v73(tmp_path / "new.mat", {"tau": TAU})
    with h5py.File(path, "r+") as file:
        file.create_group("q").attrs["MATLAB_class"] = np.bytes_("table")
    refused("q has the class 'table'", path)


def test_a_single_array_is_no_archive(tmp_path):
    with (tmp_path / "run.npz").open("wb") as stream:
        np.save(stream, Q)
    refused("single array", tmp_path / "run.npz")


def test_a_damaged_archive_member_is_refused(tmp_path):
    np.savez_compressed(tmp_path / "run.npz", **TABLE)
    content = bytearray((tmp_path / "run.npz").read_bytes())
    where = content.index(b"q1.npy") + 60
    content[where : where + 40] = zlib.compress(b"x" * 40)[:10] * 4
    (tmp_path / "run.npz").write_bytes(bytes(content))
    refused("cannot be read as a NumPy archive", tmp_path / "run.npz")


@pytest.mark.parametrize(
    ("suffix", "package"), [(".parquet", "pyarrow"), (".bag", "rosbags.highlevel"), (".mcap", "rosbags.highlevel")]
)
def test_a_missing_package_is_named_with_its_extra(tmp_path, monkeypatch, suffix, package):
    (tmp_path / f"run{suffix}").write_bytes(b"x")
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(MissingExtraError, match=r"armid\[io\]"):
        load_recording(tmp_path / f"run{suffix}")


def test_a_missing_h5py_is_named_with_its_extra(tmp_path, monkeypatch):
    path = write_v73(tmp_path / "run.mat", TABLE)
    monkeypatch.setitem(sys.modules, "h5py", None)
    with pytest.raises(MissingExtraError, match=r"armid\[io\]"):
        load_recording(path)
