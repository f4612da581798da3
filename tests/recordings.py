"""A small recording, and writers of it in file formats, shared by the tests."""

import numpy as np
import pytest

from armid.errors import RecordingError
from armid.measurement.readers import load_recording
from armid.measurement.reading import Reading

RNG = np.random.default_rng(7)
N = 25
T = 12.3 + np.arange(N) / 100
Q, DQ, DDQ, TAU = (RNG.standard_normal((N, 3)) for _ in range(4))
TABLE = {"t": T} | {f"{name}{i + 1}": x[:, i] for name, x in (("q", Q), ("dq", DQ), ("tau", TAU)) for i in range(3)}


def text(table, delimiter=","):
    rows = [
        delimiter.join(table),
        *(delimiter.join(map(repr, map(float, row))) for row in zip(*table.values(), strict=True)),
    ]
    return "\n".join(rows) + "\n"


def write_csv(path, table=TABLE, **options):
    path.write_text(text(table, **options))
    return path


def write_parquet(path, table=TABLE):
    import pyarrow as pa
    import pyarrow.parquet as pq

    pq.write_table(pa.table({name: np.asarray(column) for name, column in table.items()}), path)
    return path


def write_v73(path, variables, names=()):
    """A MATLAB 7.3 file: HDF5 behind 512 bytes, matrices transposed, strings as UTF-16, cells as references."""
    import h5py

    with h5py.File(path, "w", userblock_size=512) as file:
        for name, values in variables.items():
            item = file.create_dataset(name, data=np.atleast_2d(values).T)
            item.attrs["MATLAB_class"] = np.bytes_("double")
        cells = []
        for i, name in enumerate(names):
            item = file.create_dataset(f"#refs#/{i}", data=np.array([list(map(ord, name))], dtype=np.uint16).T)
            item.attrs["MATLAB_class"] = np.bytes_("char")
            cells.append(item.ref)
        if cells:
            item = file.create_dataset("joint_names", data=np.array([cells], dtype=h5py.ref_dtype))
            item.attrs["MATLAB_class"] = np.bytes_("cell")
    path.write_bytes(b"MATLAB 7.3 MAT-file".ljust(512) + path.read_bytes()[512:])
    return path


def assert_same(recording, *, t=T, dq=DQ, tau=TAU, ddq=None):
    for name, truth in (("time", t), ("q", Q), ("dq", dq), ("ddq", ddq), ("effort", tau)):
        found = getattr(recording, name)
        if truth is None:
            assert found is None
        else:
            np.testing.assert_array_equal(found, truth)


def refused(words, path, **reading):
    with pytest.raises(RecordingError, match=words) as caught:
        load_recording(path, Reading(**reading))
    return caught.value
