"""Inputs that once ended in a traceback, a hang or a demand for terabytes; each is read or refused by one error."""

from __future__ import annotations

import json
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from armid.cli.main import main
from armid.dataclass_files import save
from armid.excitation.formats import FORMATS
from armid.excitation.formats.sampled_motion import SampledMotion
from armid.excitation.fourier import Excitation
from labs import small_recording, write_arm, write_recording

ARMS = Path(__file__).parents[1] / "contract" / "arms"

PLAN = {"robot": "small", "base_frequency": 1.0, "a": [[0.1]] * 3, "b": [[0.1]] * 3, "offset": [0.0] * 3}

Write = Callable[[Path], tuple[str, ...]]
"""Function that writes an input to a folder and returns the command that reads it."""


def examined(name: str) -> tuple[str, ...]:
    return "doctor", "small.urdf", name


def saved_with(change: Callable[[dict[str, object]], object]) -> Write:
    """A saved recording whose JSON header is changed."""

    def write(folder: Path) -> tuple[str, ...]:
        path = save(small_recording(1), folder / "saved.npz")
        with np.load(path) as archive:
            arrays = {name: archive[name] for name in archive.files}
        header = json.loads(bytes(arrays["value.json"]))
        text = json.dumps({**header, "value": change(header["value"])})
        arrays["value.json"] = np.frombuffer(text.encode(), np.uint8)
        np.savez(path, **arrays)
        return examined("saved.npz")

    return write


def array_with_header(old: bytes, new: bytes) -> Write:
    """An archive in which the header of an array is changed."""

    def write(folder: Path) -> tuple[str, ...]:
        path = write_recording(small_recording(1), folder / "log.npz")
        with zipfile.ZipFile(path) as archive:
            members = {name: archive.read(name) for name in archive.namelist()}
        with zipfile.ZipFile(path, "w") as archive:
            for name, data in members.items():
                archive.writestr(name, data.replace(old, new, 1) if name == "q1.npy" else data)
        return examined("log.npz")

    return write


def with_effort(value: float) -> Write:
    """A recording with one channel of effort multiplied by a number."""

    def write(folder: Path) -> tuple[str, ...]:
        path = write_recording(small_recording(1), folder / "log.npz")
        with np.load(path) as archive:
            arrays = {name: archive[name] for name in archive.files}
        np.savez(path, **{**arrays, "tau2": arrays["tau2"] * value})
        return examined("log.npz")

    return write


def plan_with(**changes: object) -> Write:
    """A plan with other values, which is simulated."""

    def write(folder: Path) -> tuple[str, ...]:
        (folder / "plan.json").write_text(json.dumps({**PLAN, **changes}))
        return "simulate", "small.urdf", "plan.json", "--mode", "inverse-dynamics", "--out", "sim"

    return write


def deep_plan(folder: Path) -> tuple[str, ...]:
    (folder / "plan.json").write_text("[" * 100_000)
    return "preview", "small.urdf", "plan.json"


def torn_motion(folder: Path) -> tuple[str, ...]:
    plan = Excitation(1.0, np.ones((3, 1)), np.ones((3, 1)), np.zeros(3), "small")
    names = ("joint_1", "joint_2", "joint_3")
    data = bytearray(FORMATS["mat"].write(SampledMotion("small", names, (False,) * 3, plan.sample(20.0))))
    data[len(data) // 2] ^= 255
    (folder / "plan.mat").write_bytes(bytes(data))
    return "preview", "small.urdf", "plan.mat"


def deep_xacro(folder: Path) -> tuple[str, ...]:
    text = "<link name='a'>" * 3000 + "</link>" * 3000
    (folder / "arm.xacro").write_text(f'<robot name="a" xmlns:xacro="http://www.ros.org/wiki/xacro">{text}</robot>')
    return "base", "arm.xacro"


def mat_without_a_target(folder: Path) -> tuple[str, ...]:
    h5py = pytest.importorskip("h5py")
    path = folder / "log.mat"
    with h5py.File(path, "w", userblock_size=512) as file:
        file["t"] = h5py.SoftLink("/nowhere")
    path.write_bytes(b"MATLAB 7.3 MAT-file".ljust(512) + path.read_bytes()[512:])
    return examined("log.mat")


def clock_of_nanoseconds(folder: Path) -> tuple[str, ...]:
    path = write_recording(small_recording(1), folder / "log.npz")
    with np.load(path) as archive:
        arrays = {name: archive[name] for name in archive.files}
    time = arrays["t"].copy()
    time[1:] = time[0] + 1e-9 * np.arange(1, len(time)) + np.where(np.arange(1, len(time)) > 800, 20.0, 0.0)
    np.savez(path, **{**arrays, "t": time})
    return "identify", "small.urdf", "log.npz"


def long_column_name(folder: Path) -> tuple[str, ...]:
    path = write_recording(small_recording(1), folder / "log.csv")
    path.write_text(path.read_text().replace("q1", f"q{'1' * 200_000}", 1))
    return examined("log.csv")


def motion_of_other_joints(folder: Path) -> tuple[str, ...]:
    plan = Excitation(1.0, np.ones((3, 1)), np.ones((3, 1)), np.zeros(3), "small")
    names = ("joint_1", "joint_2", "joint_3")
    text = FORMATS["ros2"].write(SampledMotion("small", names, (False,) * 3, plan.sample(20.0))).decode()
    (folder / "plan.trajectory.yaml").write_text(text.replace('- "joint_2"', '- "joint_1"\n- "joint_2"'))
    return "preview", "small.urdf", "plan.trajectory.yaml"


def inertia_of_1e308(folder: Path) -> tuple[str, ...]:
    text = (ARMS / "arm.mjcf").read_text().replace("0.03 0.04 0.02", "0.03 0.04 -1e308")
    (folder / "arm.mjcf").write_text(text)
    return "preview", "arm.mjcf", "--out", "page.html"


def column_of_a_huge_number(folder: Path) -> tuple[str, ...]:
    path = write_recording(small_recording(1), folder / "log.csv")
    path.write_text(path.read_text().replace("tau2", f"tau{'1' * 400}", 1))
    return examined("log.csv")


CORPUS: dict[str, Write] = {
    "a list in place of fields": saved_with(lambda value: [value]),
    "a list in place of a mapping": saved_with(lambda value: {**value, "columns": [1]}),
    "a text in place of an array": saved_with(lambda value: {**value, "q": "x"}),
    "an unknown field": saved_with(lambda value: {**value, "q_": 1.0}),
    "an unknown key of the log format": saved_with(lambda value: {**value, "guessed": {"a": {}}}),
    "a wrong value of the log format": saved_with(lambda value: {**value, "guessed": {"units": 3}}),
    "a deep field": saved_with(lambda value: {**value, "q": json.loads("[" * 900 + "]" * 900)}),
    "an array of terabytes": array_with_header(b"(1600,), } ", b"(800000000000,), }"[:11].ljust(11)),
    "a torn header of an array": array_with_header(b"(1600,)", b"(((((((((("[:7]),
    "effort of 1e300": with_effort(1e300),
    "effort of 1e200": with_effort(1e200),
    "effort of 1e-300": with_effort(1e-300),
    "a period of a century": plan_with(base_frequency=1e-9),
    "a period of an attosecond": plan_with(base_frequency=9e18),
    "a negative frequency": plan_with(base_frequency=-1.0),
    "coefficients of 1e308": plan_with(a=[[1e308]] * 3),
    "repetitions without end": plan_with(repetitions=10**12, lead_in=1e12),
    "a deep record": deep_plan,
    "a torn motion": torn_motion,
    "a motion with a joint twice": motion_of_other_joints,
    "an inertia of 1e308": inertia_of_1e308,
    "a deep description": deep_xacro,
    "a matrix that is nowhere": mat_without_a_target,
    "a long name of a column": long_column_name,
    "a column of a huge number": column_of_a_huge_number,
    "a clock of nanoseconds": clock_of_nanoseconds,
}
"""Inputs by what is wrong with them."""


@pytest.mark.filterwarnings("ignore::RuntimeWarning")  # overflow of what is too large or too small
@pytest.mark.parametrize("fault", CORPUS)
def test_what_once_broke_is_read_or_refused(
    fault: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    monkeypatch.chdir(tmp_path)
    write_arm(tmp_path)
    command = CORPUS[fault](tmp_path)
    with pytest.raises(SystemExit) as ended:
        main(list(command))
    err = capsys.readouterr().err
    assert ended.value.code in (0, 1, 2, None), err
    if ended.value.code == 2:
        assert err.count("error ") >= 1 and ("hint:" in err or "possible" in err), err
