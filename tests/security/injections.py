"""Attempts to make armid run a program, or read a file that the user did not name, by the content of an input."""

from __future__ import annotations

import os
import pickle
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

from labs import STUDY, URDF, small_recording, write_recording

SECRET = "secret-7f3a"
"""Text of the files outside, which may appear nowhere."""

MESH = "solid a\nfacet normal 0 0 1\nouter loop\n"
MESH += "vertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\nendsolid a\n"

Attempt = Callable[[Path, Path], tuple[str, ...]]
"""Function that writes an input to a folder, given the folder outside, and returns the command that reads it."""


def write_outside(folder: Path) -> None:
    """Writes the files that no input may reach."""
    folder.mkdir(parents=True)
    for name in ("secret.txt", "secret.csv", "secret.bin"):
        (folder / name).write_text(SECRET * 1000)
    (folder / "secret.stl").write_text(MESH)
    (folder / "secret.yaml").write_text(f"mass: {SECRET}\n")
    (folder / "secret.xml").write_text(f'<mujoco><asset><material name="{SECRET}"/></asset></mujoco>')
    (folder / "secret.xacro").write_text(
        f'<robot xmlns:xacro="http://www.ros.org/wiki/xacro"><link name="{SECRET}"/></robot>'
    )


class Payload:
    """Object whose unpickling makes a file."""

    def __reduce__(self) -> tuple[Callable[[str], int], tuple[str]]:
        return os.system, ("touch pwned",)


# Descriptions -------------------------------------------------------------------------------------------------------


def mesh(reference: str) -> Attempt:
    """URDF with a visual mesh of a given name; OUT stands for the folder outside."""

    def write(folder: Path, outside: Path) -> tuple[str, ...]:
        shape = f'<visual><geometry><mesh filename="{reference.replace("OUT", str(outside))}"/></geometry></visual>'
        (folder / "arm.urdf").write_text(URDF.replace('<link name="base"/>', f'<link name="base">{shape}</link>'))
        return "preview", "arm.urdf", "--out", "page.html"

    return write


def head(text: str, use: str) -> Attempt:
    """URDF with a document type, whose entity is used as a name."""

    def write(folder: Path, outside: Path) -> tuple[str, ...]:
        body = URDF.replace('name="small"', f'name="{use}"')
        (folder / "arm.urdf").write_text(f'<?xml version="1.0"?>{text.replace("OUT", str(outside))}{body}')
        return "base", "arm.urdf"

    return write


def mjcf(inside: str, compiler: str = "") -> Attempt:
    """MJCF with given text at its beginning."""

    def write(folder: Path, outside: Path) -> tuple[str, ...]:
        text = inside.replace("OUT", str(outside))
        own = '<geom size="0.1" mass="1"/>' if "mesh" not in inside else '<geom type="mesh" mesh="m"/>'
        (folder / "arm.xml").write_text(
            f"<mujoco><compiler {compiler.replace('OUT', str(outside))}/>{text}<worldbody><body>"
            f'<joint name="j" axis="0 1 0"/><geom size="0.1" mass="1"/>{own}</body></worldbody></mujoco>'
        )
        return "preview", "arm.xml", "--out", "page.html"

    return write


def xacro(content: str, part: str = "") -> Attempt:
    """Xacro file with given content, and with another file that it includes."""

    def write(folder: Path, outside: Path) -> tuple[str, ...]:
        space = 'xmlns:xacro="http://www.ros.org/wiki/xacro"'
        inside = URDF.partition(">")[2].replace("OUT", str(outside))
        text = content.replace("OUT", str(outside))
        (folder / "arm.xacro").write_text(f'<robot name="small" {space}>{text}{inside}')
        if part:
            (folder / "part.xacro").write_text(part.replace("OUT", str(outside)))
        return "base", "arm.xacro"

    return write


def valued(expression: str) -> Attempt:
    """Xacro file with a property that is an expression."""
    return xacro(f'<xacro:property name="p" value="{expression}"/><link name="${{p}}"/>')


def robot_named(name: str) -> Attempt:
    """Table of DH parameters whose arm has a given name; it is simulated into the folder that the name chooses."""

    def write(folder: Path, outside: Path) -> tuple[str, ...]:
        text = (Path(__file__).parents[1] / "contract" / "arms" / "arm.toml").read_text()
        given = name.replace("OUT", str(outside)).replace("\\", "\\\\")
        lines = [f'name = "{given}"' if line.startswith("name") else line for line in text.splitlines()]
        (folder / "arm.toml").write_text("\n".join(lines))
        plan = '{"robot": "x", "base_frequency": 3.0, "a": [[0.01]], "b": [[0.01]], "offset": [0.0]}'
        joints = text.count("[[joint]]")
        (folder / "plan.json").write_text(
            plan.replace("[[0.01]]", str([[0.01]] * joints)).replace("[0.0]", str([0.0] * joints))
        )
        return "simulate", "arm.toml", "plan.json", "--mode", "inverse-dynamics"

    return write


# Recordings and runs ------------------------------------------------------------------------------------------------


def pickled(name: str) -> Attempt:
    """Archive of arrays, or another file, that contains a pickled object."""

    def write(folder: Path, outside: Path) -> tuple[str, ...]:
        (folder / "small.urdf").write_text(URDF)
        path = folder / name
        if name.endswith(".npz"):
            np.savez(path, t=np.array([Payload()] * 9, dtype=object), q1=np.zeros(9))  # pyright: ignore
        else:
            path.write_bytes(pickle.dumps(Payload()))
        return "doctor", "small.urdf", name

    return write


def hdf5(kind: str, suffix: str) -> Attempt:
    """HDF5 file whose numbers are in another file."""

    def write(folder: Path, outside: Path) -> tuple[str, ...]:
        import h5py

        (folder / "small.urdf").write_text(URDF)
        path, rows, raw = folder / f"log{suffix}", 100, outside / "secret.bin"
        if not (outside / "secret.h5").exists():
            with h5py.File(outside / "secret.h5", "w") as file:
                file["q"] = np.zeros((rows, 3))
        with h5py.File(path, "w", userblock_size=512 if suffix == ".mat" else 0) as file:
            file["t"], file["tau"] = np.arange(rows) * 0.01, np.ones((rows, 3))
            if kind == "link":
                file["q"] = h5py.ExternalLink(str(outside / "secret.h5"), "/q")
            elif kind == "storage":
                file.create_dataset("q", (rows, 3), "f8", external=[(str(raw), 0, 8 * 3 * rows)])
            else:
                layout = h5py.VirtualLayout((rows, 3), "f8")
                layout[:] = h5py.VirtualSource(str(outside / "secret.h5"), "q", shape=(rows, 3))
                file.create_virtual_dataset("q", layout)
        if suffix == ".mat":
            path.write_bytes(b"MATLAB 7.3 MAT-file".ljust(512) + path.read_bytes()[512:])
        return "doctor", "small.urdf", path.name

    return write


def bag_of(reference: str) -> Attempt:
    """Folder of a bag whose metadata name a file elsewhere, or an object of Python."""

    def write(folder: Path, outside: Path) -> tuple[str, ...]:
        (folder / "small.urdf").write_text(URDF)
        (folder / "bag").mkdir()
        (folder / "bag" / "metadata.yaml").write_text(
            "rosbag2_bagfile_information:\n  version: 9\n  storage_identifier: sqlite3\n"
            f"  relative_file_paths:\n    - {reference.replace('OUT', str(outside))}\n"
            "  duration: {nanoseconds: 1}\n  starting_time: {nanoseconds_since_epoch: 1}\n  message_count: 0\n"
            "  topics_with_message_count: []\n  compression_format: ''\n  compression_mode: ''\n"
        )
        return "doctor", "small.urdf", "bag"

    return write


def sheet(folder: Path, outside: Path) -> tuple[str, ...]:
    """Workbook whose XML has an entity of a file outside."""
    from recordings import write_workbook

    (folder / "small.urdf").write_text(URDF)
    path = write_workbook(folder / "log.xlsx", {"t": [0.0, 1.0], "q1": [0.0, 1.0]})
    with zipfile.ZipFile(path) as archive:
        members = {name: archive.read(name).decode() for name in archive.namelist()}
    entity = f'<!DOCTYPE worksheet [<!ENTITY x SYSTEM "file://{outside}/secret.txt">]>'
    name = "xl/worksheets/sheet1.xml"
    members[name] = entity + members[name].replace("<t>q1</t>", "<t>&x;</t>")
    with zipfile.ZipFile(path, "w") as archive:
        for member, text in members.items():
            archive.writestr(member, text)
        archive.writestr("../../pwned", "x")
    return "doctor", "small.urdf", "log.xlsx"


def study(line: str) -> Attempt:
    """Study with a line that is meant to run something."""

    def write(folder: Path, outside: Path) -> tuple[str, ...]:
        (folder / "small.urdf").write_text(URDF)
        for k in (1, 2):
            write_recording(small_recording(k, repetitions=1), folder / f"run{k}.csv")
        key, _, value = line.partition(" = ")
        text = "\n".join(f"{key} = {value}" if each.startswith(key) else each for each in STUDY.splitlines())
        (folder / "study.toml").write_text(text if text != STUDY else f"{STUDY}\n{line}\n")
        return "doctor", "study.toml"

    return write


ENTITY = '<!DOCTYPE robot [<!ENTITY x SYSTEM "file://OUT/secret.txt">]>'
LAUGH = '<!DOCTYPE robot [<!ENTITY a "ha">' + "".join(
    f'<!ENTITY {chr(98 + k)} "{f"&{chr(97 + k)};" * 10}">' for k in range(9)
)

ATTEMPTS: dict[str, Attempt] = {
    "mesh: absolute": mesh("OUT/secret.stl"),
    "mesh: file://": mesh("file://OUT/secret.stl"),
    "mesh: upwards": mesh("../../outside/secret.stl"),
    "mesh: package upwards": mesh("package://small/../../outside/secret.stl"),
    "mesh: package is upwards": mesh("package://../../outside/secret.stl"),
    "mesh: package, then absolute": mesh("package://small/OUT/secret.stl"),
    "mesh: model upwards": mesh("model://../outside/secret.stl"),
    "URDF: external entity": head(ENTITY, "&x;"),
    "URDF: parameter entity": head('<!DOCTYPE robot [<!ENTITY % x SYSTEM "file://OUT/secret.txt"> %x;]>', "a"),
    "URDF: entities without end": head(f"{LAUGH}]>", "&j;"),
    "URDF: style sheet": head('<?xml-stylesheet href="file://OUT/secret.txt"?>', "a"),
    "MJCF: include, absolute": mjcf('<include file="OUT/secret.xml"/>'),
    "MJCF: include, upwards": mjcf('<include file="../../outside/secret.xml"/>'),
    "MJCF: mesh, absolute": mjcf('<asset><mesh name="m" file="OUT/secret.stl"/></asset>'),
    "MJCF: mesh, upwards": mjcf('<asset><mesh name="m" file="../../outside/secret.stl"/></asset>'),
    "MJCF: folder of meshes": mjcf('<asset><mesh name="m" file="secret.stl"/></asset>', 'meshdir="OUT"'),
    "MJCF: plugin": mjcf('<extension><plugin plugin="OUT/secret.bin"/></extension>'),
    "MJCF: texture": mjcf('<asset><texture name="t" type="2d" file="OUT/secret.bin"/></asset>'),
    "xacro: import": valued("${__import__('os').system('touch pwned')}"),
    "xacro: classes": valued("${().__class__.__base__.__subclasses__()}"),
    "xacro: eval": xacro("<link name=\"$(eval __import__('os').system('touch pwned'))\"/>"),
    "xacro: open": valued("${open('OUT/secret.txt').read()}"),
    "xacro: format": valued("${'{0.__class__.__mro__}'.format(1)}"),
    "xacro: lambda": valued("${(lambda: 1)()}"),
    "xacro: builtins": valued("${__builtins__['eval']('1')}"),
    "xacro: YAML, absolute": valued("${load_yaml('OUT/secret.yaml')['mass']}"),
    "xacro: YAML, upwards": valued("${load_yaml('../../outside/secret.yaml')['mass']}"),
    "xacro: YAML with an object": xacro(
        '<xacro:property name="p" value="${load_yaml(\'part.xacro\')}"/>',
        "!!python/object/apply:os.system ['touch pwned']\n",
    ),
    "xacro: include, absolute": xacro('<xacro:include filename="OUT/secret.xacro"/>'),
    "xacro: include, upwards": xacro('<xacro:include filename="../../outside/secret.xacro"/>'),
    "xacro: include, a package upwards": xacro('<xacro:include filename="$(find ..)/../outside/secret.xacro"/>'),
    "xacro: include, by a pattern": xacro('<xacro:include filename="../../outs*/secret.xacro"/>'),
    "xacro: entity in an included file": xacro(
        '<xacro:include filename="part.xacro"/>', f'{ENTITY}<robot><link name="&x;"/></robot>'
    ),
    "name: upwards": robot_named("../../../outside/pwned"),
    "name: absolute": robot_named("OUT/pwned"),
    "name: a command": robot_named("$(touch pwned); touch pwned"),
    "NPZ: a pickled object": pickled("log.npz"),
    "NPY in place of NPZ": pickled("saved.npz"),
    "MATLAB: a pickled object": pickled("log.mat"),
    "Parquet: a pickled object": pickled("log.parquet"),
    "HDF5: a link": hdf5("link", ".h5"),
    "HDF5: storage": hdf5("storage", ".h5"),
    "HDF5: a virtual data set": hdf5("virtual", ".h5"),
    "MATLAB 7.3: a link": hdf5("link", ".mat"),
    "MATLAB 7.3: storage": hdf5("storage", ".mat"),
    "MATLAB 7.3: a virtual data set": hdf5("virtual", ".mat"),
    "bag: file, absolute": bag_of("OUT/secret.db3"),
    "bag: file, upwards": bag_of("../../outside/secret.db3"),
    "bag: an object": bag_of("!!python/object/apply:os.system ['touch pwned']"),
    "workbook: entity and member": sheet,
    "study: a command as file": study('path = "| touch pwned"'),
    "study: a command as description": study('description = "$(touch pwned)"'),
    "study: an address as description": study('description = "http://localhost:9/arm.urdf"'),
    "study: an unknown key": study('[run]\ncommand = "touch pwned"'),
}
"""Attempts by name."""
