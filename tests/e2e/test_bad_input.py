"""Bad input of every kind through the whole command: one message, or a result that is right."""

from __future__ import annotations

import json
import pickle
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from armid.checked_array import Array
from armid.cli.main import main
from labs import URDF, small_recording, write_arm, write_recording

Table = dict[str, Array]


def good() -> Table:
    """A recording of the small arm as columns."""
    recording = small_recording(1)
    assert recording.time is not None and recording.effort is not None
    table = {"t": recording.time.copy()}
    for name, values in (("q", recording.q), ("tau", recording.effort)):
        table |= {f"{name}{j + 1}": values[:, j].copy() for j in range(3)}
    return table


def write(table: Table, path: Path) -> Path:
    """As CSV, with NaN as an empty field."""
    rows = np.column_stack(list(table.values()))
    lines = [",".join("" if np.isnan(x) else repr(float(x)) for x in row) for row in rows]
    path.write_text("\n".join([",".join(table), *lines]) + "\n")
    return path


@pytest.fixture
def identify(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]):
    """Identifies the small arm from a file of the empty folder it works in; exit code, output, messages."""
    monkeypatch.chdir(tmp_path)
    write_arm(tmp_path)

    def run(log: str, *more: str, arm: str = "small.urdf") -> tuple[int, str, str]:
        with pytest.raises(SystemExit) as ended:
            main(["identify", arm, log, "--json", *more])
        out, err = capfd.readouterr()
        return int(ended.value.code or 0), out, " ".join(err.split())

    return run


def refused(done: tuple[int, str, str], *words: str) -> None:
    code, out, err = done
    assert code == 2 and err.startswith("error ") and err.count("error ") == 1
    told = json.loads(out)
    assert told["exit_code"] == 2 and " ".join(told["error"].split()) in err and told.keys() >= {"possible", "remedy"}
    assert all(word in err for word in words), err
    assert " hint: " in err or " possible " in err  # what to do about it
    assert not Path("runs").exists()


def with_nan(table: Table) -> None:
    table["q2"][17] = np.nan


def with_dead_channel(table: Table) -> None:
    table["tau2"][:] = 0.0


def with_constant_effort(table: Table) -> None:
    table["tau3"][:] = 4.2


def without_motion(table: Table) -> None:
    for name in ("q1", "q2", "q3"):
        table[name][:] = 0.3


def without_clock(table: Table) -> None:
    del table["t"]


def backwards(table: Table) -> None:
    table["t"][500:600] = table["t"][500:600][::-1].copy()


def in_milliseconds(table: Table) -> None:
    table["t"] *= 1000.0


def in_degrees(table: Table) -> None:
    for name in ("q1", "q2", "q3"):
        table[name][:] = np.degrees(table[name])


def without_a_joint(table: Table) -> None:
    del table["q3"], table["tau3"]


def with_a_joint_too_many(table: Table) -> None:
    table |= {"q4": table["q1"], "tau4": table["tau1"]}


def without_effort(table: Table) -> None:
    for j in (1, 2, 3):
        del table[f"tau{j}"]


def with_one_effort_missing(table: Table) -> None:
    del table["tau3"]


def with_one_sample(table: Table) -> None:
    for name in table:
        table[name] = table[name][:1]


def of_a_moment(table: Table) -> None:
    for name in table:
        table[name] = table[name][:30]


def with_one_joint_still(table: Table) -> None:
    table["q3"][:] = 0.5


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (with_nan, ["q", "joint_2", "17"]),
        (with_dead_channel, ["effort of joint_2 is 0 in all 1600 rows", "channel-dead"]),
        (with_constant_effort, ["effort of joint_3 is 4.2 in all 1600 rows", "channel-dead"]),
        (without_motion, ["the arm stands still", "standstill"]),
        (without_clock, ["neither a time column nor a sample rate", "rate = "]),
        (backwards, ["backwards"]),
        (in_milliseconds, ["run.csv", "seconds"]),
        (
            in_degrees,
            [
                "far outside its limits",
                "if the angles were in degrees, all joints would be inside the limits",
                'units = "deg"',
            ],
        ),
        (without_a_joint, ["2 channels; small has 3 joints: joint_1, joint_2, joint_3"]),
        (with_a_joint_too_many, ["4 channels; small has 3 joints", "empty name for each channel"]),
        (without_effort, ["effort"]),
        (
            with_one_effort_missing,
            ["3 columns of q (q1 … q3), but 2 columns of effort", "missing columns of effort: tau3 (joint_3)"],
        ),
        (with_one_sample, ["usable samples is too small: 1"]),
        (of_a_moment, ["no row is left"]),
        (with_one_joint_still, ["do not determine FV_3, FS_3", "moves the joints"]),
    ],
)
def test_a_spoiled_recording_is_refused(identify, spoil: Callable[[Table], None], words: list[str]):
    table = good()
    spoil(table)
    write(table, Path("run.csv"))
    refused(identify("run.csv"), *words)


def test_a_csv_with_a_broken_row_is_refused(identify):
    lines = write(good(), Path("run.csv")).read_text().splitlines()
    Path("run.csv").write_text("\n".join([*lines[:400], lines[400][:30], *lines[401:]]) + "\n")
    refused(identify("run.csv"), "line 401", "3 fields, but the header has 7")


def test_a_truncated_parquet_is_refused(identify):
    path = write_recording(small_recording(1), Path("run.parquet"))
    path.write_bytes(path.read_bytes()[:-100])
    refused(identify("run.parquet"), "cannot be read as Parquet")


class Bomb:
    """Pickle of an attacker."""

    def __reduce__(self):
        return exec, ("open('exploded', 'w').close()",)


@pytest.mark.parametrize("suffix", [".npz", ".mat"])
def test_what_would_be_unpickled_is_refused(identify, suffix: str):
    table = good() | {"q1": np.array([Bomb()], dtype=object)}
    if suffix == ".npz":
        np.savez("run.npz", **table)  # pyright: ignore[reportArgumentType]
    else:
        Path("run.mat").write_bytes(pickle.dumps(Bomb()))
    refused(identify(f"run{suffix}"), f"run{suffix}")
    assert not Path("exploded").exists()


@pytest.mark.parametrize("content", [b"", b"\x00\x01\x02" * 50, b"t,q1\n"])
@pytest.mark.parametrize("suffix", [".csv", ".npz", ".mat", ".parquet", ".mcap", ".db3", ".bag"])
def test_junk_is_refused(identify, suffix: str, content: bytes):
    Path(f"run{suffix}").write_bytes(content)
    refused(identify(f"run{suffix}"), f"run{suffix}")


def test_a_folder_and_an_unknown_format_are_refused(identify):
    Path("log.csv").mkdir()
    Path("log.pdf").write_text("x")
    refused(identify("log.csv"), "log.csv")
    refused(identify("log.pdf"), "unknown format", ".parquet")


def test_external_entities_are_refused(identify):
    write(good(), Path("run.csv"))
    Path("secret").write_text("password")
    entity = '<!DOCTYPE robot [<!ENTITY secret SYSTEM "secret">]>\n' + URDF.replace("base", "&secret;")
    Path("arm.urdf").write_text(entity)
    done = identify("run.csv", arm="arm.urdf")
    refused(done, "a document type or of entities")
    assert "password" not in done[2]


@pytest.mark.parametrize("text", ["", "<robot>", "not xml at all", "<html/>"])
def test_a_robot_that_is_none_is_refused(identify, text: str):
    write(good(), Path("run.csv"))
    Path("arm.urdf").write_text(text)
    refused(identify("run.csv", arm="arm.urdf"), "arm.urdf")


# What only looks bad ---------------------------------------------------------------------------------------------


def values_of(done: tuple[int, str, str]) -> dict[str, float]:
    code, out, err = done
    assert code == 0, err
    return {each["name"]: each["value"] for each in json.loads(out)["base_parameters"]}


def test_missing_meshes_do_not_matter(identify):
    write(good(), Path("run.csv"))
    mesh = '<visual><geometry><mesh filename="package://nowhere/arm.stl"/></geometry></visual></link>\n  <joint'
    Path("arm.urdf").write_text(URDF.replace("</link>\n  <joint", mesh))
    assert "arm.stl" in Path("arm.urdf").read_text()
    assert values_of(identify("run.csv", arm="arm.urdf")) == values_of(identify("run.csv"))


def test_without_masses_there_is_only_no_rival(identify):
    """A description that knows no masses is what identification is for."""
    write(good(), Path("run.csv"))
    write_recording(small_recording(2), Path("unseen.csv"))
    text = URDF
    for mass in ("3", "2", "1"):
        text = text.replace(f'<mass value="{mass}"/>', '<mass value="0"/>')
    text = text.replace(
        'ixx="0.05" iyy="0.04" izz="0.03" ixy="0.001" ixz="0" iyz="0.002"',
        'ixx="0" iyy="0" izz="0" ixy="0" ixz="0" iyz="0"',
    )
    Path("arm.urdf").write_text(text)
    done = identify("run.csv", "--validate", "unseen.csv", arm="arm.urdf")
    assert json.loads(done[1])["validation"]["recordings"][0]["prior_rms"] is None
    assert json.loads(done[1])["validation"]["verdict"] == "pass"
    assert values_of(done) == values_of(identify("run.csv"))


def test_wrapped_angles_are_the_same_motion(identify):
    table = good()
    write(table, Path("turned.csv"))
    for name in ("q1", "q2", "q3"):
        table[name] = table[name] % (2 * np.pi)
    assert any(np.abs(np.diff(table[name])).max() > 6.0 for name in ("q1", "q2", "q3"))
    write(table, Path("wrapped.csv"))
    wrapped, turned = identify("wrapped.csv"), identify("turned.csv")
    assert "position-wrapped" in wrapped[2] and "position-wrapped" not in turned[2]
    expected = values_of(turned)
    assert values_of(wrapped) == pytest.approx(expected, rel=1e-6, abs=1e-9)


def test_rows_that_are_masked_may_hold_anything(identify):
    """NaN where a study says that nothing counts."""
    table = good()
    table["q2"][100:140] = np.nan
    write(table, Path("run.csv"))
    text = '[robot]\ndescription = "small.urdf"\n[[recording]]\npath = "run.csv"\nexclude = [[0.9, 1.5]]\n'
    Path("study.toml").write_text(text)
    with pytest.raises(SystemExit) as ended:
        main(["identify", "study.toml"])
    assert not ended.value.code


def test_the_good_recording_is_good(identify):
    write(good(), Path("run.csv"))
    assert values_of(identify("run.csv"))["FV_2"] == pytest.approx(2.0, rel=0.05)
