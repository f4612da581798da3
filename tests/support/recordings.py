"""A small recording, and writers of it in file formats, shared by the tests."""

from pathlib import Path

import numpy as np
import pytest

from armid.errors import RecordingError
from armid.measurement.log_format import LogFormat
from armid.measurement.readers import load_recording

RNG = np.random.default_rng(7)
N = 25
T = 12.3 + np.arange(N) / 100
Q, DQ, DDQ, TAU = (RNG.standard_normal((N, 3)) for _ in range(4))
TABLE = {"t": T} | {f"{name}{i + 1}": x[:, i] for name, x in (("q", Q), ("dq", DQ), ("tau", TAU)) for i in range(3)}
NAMES = ("a1", "a2", "a3")
STAMPS = 1_700_000_000_000_000_000 + 10_000_000 * np.arange(N)
SECONDS = (STAMPS - STAMPS[0]) * 1e-9


JOINT_STATE = "sensor_msgs/msg/JointState"


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


def write_workbook(path, table=TABLE, notes=()):
    """A workbook as spreadsheets write it: XML in an archive, texts and numbers in cells."""
    import zipfile

    def cell(value):
        return (
            f'<c t="inlineStr"><is><t>{value}</t></is></c>' if isinstance(value, str) else f"<c><v>{value!r}</v></c>"
        )

    def row(values):
        return f"<row>{''.join(map(cell, values))}</row>"

    numbers = zip(
        *([float(x) if not isinstance(x, str) else x for x in column] for column in table.values()), strict=True
    )
    rows = "".join(map(row, [*([note] if note else [] for note in notes), list(table), *numbers]))
    main, office = (
        "http://schemas.openxmlformats.org",
        "http://schemas.openxmlformats.org/officeDocument/2006/relationships",
    )
    sheet, kind = f"{main}/spreadsheetml/2006/main", "application/vnd.openxmlformats-officedocument.spreadsheetml"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr(
            "[Content_Types].xml",
            f'<Types xmlns="{main}/package/2006/content-types"><Default Extension="rels" '
            'ContentType="application/vnd.openxmlformats-package.relationships+xml"/>'
            f'<Override PartName="/xl/workbook.xml" ContentType="{kind}.sheet.main+xml"/>'
            f'<Override PartName="/xl/worksheets/sheet1.xml" ContentType="{kind}.worksheet+xml"/></Types>',
        )
        relation = f'<Relationships xmlns="{main}/package/2006/relationships"><Relationship Id="rId1" Type="{office}/'
        archive.writestr("_rels/.rels", relation + 'officeDocument" Target="xl/workbook.xml"/></Relationships>')
        archive.writestr(
            "xl/workbook.xml",
            f'<workbook xmlns="{sheet}" xmlns:r="{office}"><sheets>'
            '<sheet name="log" sheetId="1" r:id="rId1"/></sheets></workbook>',
        )
        archive.writestr(
            "xl/_rels/workbook.xml.rels", relation + 'worksheet" Target="worksheets/sheet1.xml"/></Relationships>'
        )
        archive.writestr(
            "xl/worksheets/sheet1.xml", f'<worksheet xmlns="{sheet}"><sheetData>{rows}</sheetData></worksheet>'
        )
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


def message(i, names=NAMES, order=(0, 1, 2), velocity=True, effort=True):
    return {
        "stamp": int(STAMPS[i]),
        "name": [names[k] for k in order],
        "position": Q[i, list(order)],
        "velocity": DQ[i, list(order)] if velocity else np.zeros(0),
        "effort": TAU[i, list(order)] if effort else np.zeros(0),
    }


def write_bag(folder, suffix, topics):
    """A bag whose topics hold the given messages; what is received long after the stamp must not matter."""
    from rosbags.rosbag1 import Writer as Writer1
    from rosbags.rosbag2 import StoragePlugin
    from rosbags.rosbag2 import Writer as Writer2
    from rosbags.typesys import Stores, get_typestore

    old = suffix == ".bag"
    store = get_typestore(Stores.ROS1_NOETIC if old else Stores.ROS2_JAZZY)
    kinds = store.types
    plugin = StoragePlugin.MCAP if suffix == ".mcap" else StoragePlugin.SQLITE3
    path = folder / "run.bag" if old else folder / f"bag{suffix[1:]}"
    serialize = store.serialize_ros1 if old else store.serialize_cdr
    with Writer1(path) if old else Writer2(path, version=9, storage_plugin=plugin) as writer:
        for topic, messages in topics.items():
            kind = "sensor_msgs/msg/JointState" if messages else "std_msgs/msg/Header"
            connection = writer.add_connection(topic, kind, typestore=store)
            for i, m in enumerate(messages):
                stamp = kinds["builtin_interfaces/msg/Time"](sec=m["stamp"] // 10**9, nanosec=m["stamp"] % 10**9)
                extra = {"seq": i} if old else {}
                header = kinds["std_msgs/msg/Header"](stamp=stamp, frame_id="", **extra)
                fields = {name: m[name] for name in ("name", "position", "velocity", "effort")}
                joint_state = kinds["sensor_msgs/msg/JointState"](header=header, **fields)
                received = int(STAMPS[0] + 10**9 + 7_000_000 * i)
                writer.write(connection, received, bytes(serialize(joint_state, joint_state.__msgtype__)))
    return path if old else next(Path(path).glob(f"*{suffix}"))


def write_bag_folder(path, messages, *, topic="/joint_states", kind=JOINT_STATE, compression=None, suffix=".mcap"):
    """A bag of ROS 2 as its recorder leaves it: a folder. Messages are objects, given with the time of reception."""
    from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer

    store = ros_types()
    plugin = StoragePlugin.MCAP if suffix == ".mcap" else StoragePlugin.SQLITE3
    writer = Writer(path, version=9, storage_plugin=plugin)
    if compression is not None:
        writer.set_compression(CompressionMode[compression], CompressionFormat.ZSTD)
    topics = messages if isinstance(messages, dict) else {topic: messages}
    with writer:
        for name, each in topics.items():
            types = {message.__msgtype__ for _, message in each}
            connections = {kind: writer.add_connection(name, kind, typestore=store) for kind in types}
            for received, message in each:
                data = bytes(store.serialize_cdr(message, message.__msgtype__))
                writer.write(connections[message.__msgtype__], received, data)
    return path


def ros_types():
    """Messages of ROS 2, those of ros2_control among them."""
    from armid.measurement.readers.bag import _store

    return _store()


def joint_state(at, names, q, dq=None, tau=None, *, stamped=True):
    """A JointState at a time [ns] with when it was received, 3 ms later and half a millisecond more or less."""
    kinds = ros_types().types if not hasattr(joint_state, "kinds") else joint_state.kinds
    joint_state.kinds = kinds
    said = int(at) if stamped else 0
    stamp = kinds["builtin_interfaces/msg/Time"](sec=said // 10**9, nanosec=said % 10**9)
    header = kinds["std_msgs/msg/Header"](stamp=stamp, frame_id="")
    none = np.zeros(0)
    values = [none if x is None else np.ascontiguousarray(x, dtype=np.float64) for x in (q, dq, tau)]
    late = 3_000_000 + 500_000 * (int(at) // 10_000_000 % 2)
    state = kinds[JOINT_STATE](
        header=header, name=list(names), position=values[0], velocity=values[1], effort=values[2]
    )
    return int(at) + late, state


def assert_same(recording, *, t=T, dq=DQ, tau=TAU, ddq=None):
    for name, truth in (("time", t), ("q", Q), ("dq", dq), ("ddq", ddq), ("effort", tau)):
        found = getattr(recording, name)
        if truth is None:
            assert found is None
        else:
            np.testing.assert_array_equal(found, truth)


def refused(words, path, **reading):
    with pytest.raises(RecordingError, match=words) as caught:
        load_recording(path, LogFormat(**reading))
    return caught.value
