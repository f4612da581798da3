"""Descriptions edited by an export: no byte changes that should not, and other programs read the torque."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from armid.export.catalogue import EXPORTERS
from armid.export.types import Content
from armid.robot import builtin_arms, load_robot
from exports import MJCF, URDF
from round_trips import formats_of, round_trip, without_edited

pytestmark = pytest.mark.witness

ARMS = Path(__file__).parents[1] / "contract" / "arms"
MESH = '<mesh name="shell" file="shell.stl"/>', '<mesh name="shell" vertex="0 0 0 1 0 0 0 1 0 0 0 1"/>'


def written(name: str, folder: Path) -> Path:
    """A description written by hand, or a built-in arm as a file of its own."""
    if name.startswith("odd."):
        text = URDF if name == "odd.urdf" else MJCF.replace(*MESH)
        (folder / name).write_text(text)
        return folder / name
    if (ARMS / name).is_file():
        return ARMS / name
    arm, to = name.split(" as ")
    path = folder / f"{arm}{EXPORTERS[to].SUFFIX}"
    path.write_bytes(EXPORTERS[to].write(Content(load_robot(arm), {})).data)
    return path


HAND = ("odd.urdf", "odd.xml", "arm.urdf", "arm.mjcf")
MADE = tuple(f"{arm} as {to}" for arm in builtin_arms() for to in ("urdf", "mjcf"))


@pytest.mark.parametrize("name", HAND + MADE)
def test_only_what_was_identified_changes(name: str, tmp_path: Path):
    path = written(name, tmp_path)
    found = round_trip(path, tmp_path, to=formats_of(path))
    assert found.holds and set(found.errors) == {"pinocchio", "mujoco"}, found


@pytest.mark.parametrize("name", HAND)
def test_a_byte_elsewhere_would_be_seen(name: str, tmp_path: Path):
    """A space, a comment, a limit, an axis, a mesh: whatever is no identified number counts."""
    data = written(name, tmp_path).read_bytes()
    form = "urdf" if name.endswith("urdf") else "mjcf"
    kept = without_edited(data, form)
    for old, new in ((b"<joint", b" <joint"), (b"\n", b"\r\n"), (b'"0 0 1"', b'"0 0 2"'), (b"</", b"<!-- --></")):
        assert without_edited(data.replace(old, new, 1), form) != kept, old
    changed = {b'mass value="2': b'mass value="3', b'mass="2': b'mass="3'}
    assert any(old in data and without_edited(data.replace(old, new), form) == kept for old, new in changed.items())


def test_what_does_not_hold_is_told(tmp_path: Path):
    found = round_trip(written("arm.urdf", tmp_path), tmp_path, to="urdf")
    assert not replace(found, kept=False).holds
    assert not replace(found, errors={**found.errors, "mujoco": 1e-8}).holds
    assert not replace(found, errors={}).holds
