"""Code of a run: what is written, and what is refused."""

from __future__ import annotations

import re
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from armid.codegen.catalogue import LANGUAGES
from armid.codegen.functions import make_programs
from armid.codegen.generation import generate
from armid.codegen.languages import python
from armid.errors import OutputError
from armid.estimation.estimate_record import InputDigest
from armid.export import code
from armid.export.code import code_record, export_code
from armid.model.base_parameters import find_base_parameters
from armid.model.dynamics_model import DynamicsModel
from armid.model.motion import Motion
from armid.model.terms import RigidBody
from armid.robot import builtin_arms, load_robot
from armid.runs.run import Run
from armid.runs.validation_and_prediction import predict
from coded import CC, STRICT, case, write_files
from reports import make_run
from trees import random_states


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    return make_run(tmp_path_factory.mktemp("small"))


@pytest.mark.parametrize("language", LANGUAGES)
def test_every_language(run: Run, language: str, tmp_path: Path):
    exported = export_code(run, language, tmp_path / "code", name="small arm")
    assert {path for path in (tmp_path / "code").rglob("*") if path.is_file()} == set(exported.files)
    assert all(path.stat().st_size for path in exported.files)
    assert any(run.trained_on[0] in path.read_text() for path in exported.files)
    record = code_record(exported)
    assert record["format"] == language and all(check["ok"] for check in record["checks"])
    assert record["operations"]["inverse_dynamics"]["mul"] > 0


@pytest.mark.parametrize("language", LANGUAGES)
def test_code_says_which_gravity_and_which_locked_joints_are_built_in(language: str):
    robot = load_robot("ur5e", gravity=[0.0, 4.9033, -8.4957])
    fifth, sixth = robot.joint_names[4:]
    locked = robot.lock({sixth: 0.5, fifth: -1.25})
    for arm, lines in ((locked, [f"{fifth} = -1.25 rad", f"{sixth} = 0.5 rad"]), (robot, [])):
        model = DynamicsModel(arm, (RigidBody(),))
        base = find_base_parameters(model)
        text = "".join(generate(model, base, np.zeros(base.count), language).values())
        assert "(0, 4.9033, -8.4957) m/s2 in the base frame" in text
        assert all(line in text for line in lines) and ("Locked joints" in text) is bool(lines)


def test_code_predicts_as_the_run_does(run: Run):
    (path,) = export_code(run, "python").files
    assert path.parent == Path(run.folder) / "code"
    module: dict[str, object] = {}
    exec(path.read_text(), module)
    motion = Motion.of_states(*random_states(np.random.default_rng(0), 20, run.robot.n))
    states = zip(motion.q.tolist(), motion.dq.tolist(), motion.ddq.tolist(), strict=True)
    found = np.array([module["inverse_dynamics"](*state) for state in states])  # pyright: ignore[reportCallIssue]
    expected = predict(run, motion)
    np.testing.assert_allclose(found, expected, atol=1e-12 * np.abs(expected).max())


def test_an_unknown_language_is_refused(run: Run, tmp_path: Path):
    with pytest.raises(OutputError, match="'fortran'"):
        export_code(run, "fortran", tmp_path / "code")
    assert not (tmp_path / "code").exists()


def test_code_that_is_not_the_model_is_not_written(run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(code, "AGREEMENT", 0.0)
    with pytest.raises(OutputError, match="The code differs"):
        export_code(run, "c", tmp_path / "code")
    assert not (tmp_path / "code").exists()


def test_all_files_or_none(run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    taken = tmp_path / "code" / "second.py"
    taken.mkdir(parents=True)  # a folder where a file should be
    monkeypatch.setattr(python, "write", lambda source: {"first.py": "1", "second.py": "2"})
    with pytest.raises(OutputError):
        export_code(run, "python", tmp_path / "code")
    assert [path.name for path in (tmp_path / "code").iterdir()] == ["second.py"]


@pytest.mark.parametrize("language", LANGUAGES)
def test_code_of_another_run_is_never_written_over(run: Run, language: str, tmp_path: Path):
    files = export_code(run, language, tmp_path / "code").files
    fit = run.estimate.fit
    changed = replace(run.estimate, fit=replace(fit, values=1.1 * fit.values))
    other = replace(run, estimate=replace(changed, made_from=(InputDigest("options", "of another run"),)))
    before = [path.read_bytes() for path in files]
    with pytest.raises(OutputError, match="would be overwritten, but it is not an earlier export of"):
        export_code(other, language, tmp_path / "code")
    assert [path.read_bytes() for path in files] == before
    assert export_code(replace(run, estimate=changed), language, tmp_path / "code").files == files  # the run anew


PAGE = (Path(__file__).parents[3] / "docs" / "code.md").read_text()


def test_the_python_of_the_page_runs(run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    blocks = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)
    assert len(blocks) == 3
    (tmp_path / "runs").mkdir()
    (tmp_path / "runs" / "today").symlink_to(run.folder)
    monkeypatch.chdir(tmp_path)
    for block in blocks:
        if "symbolic" in block:
            pytest.importorskip("sympy")
        exec(block, {})
    assert (tmp_path / "controller" / "left_arm.c").exists()


@pytest.mark.skipif(CC is None, reason="there is no gcc")
def test_the_c_of_the_page_compiles(tmp_path: Path):
    (block,) = re.findall(r"```c\n(.*?)```", PAGE, re.DOTALL)
    each = case("iiwa14-r820")
    write_files(generate(each.model, each.base, each.values, "c"), tmp_path)
    (tmp_path / "control.c").write_text(block)
    subprocess.run([str(CC), "-std=c99", *STRICT, "-c", "control.c"], cwd=tmp_path, check=True)


def test_the_operations_of_the_page_are_those_of_the_code():
    rows = re.findall(r"\| ([\w, -]+) \| (\d+)((?: \| \d+){7}) \|", PAGE)
    assert sum(len(names.split(", ")) for names, *_ in rows) == len(builtin_arms())
    for names, count, operations in rows:
        for name in names.split(", "):
            model = DynamicsModel(load_robot(name), (RigidBody(),))
            base = find_base_parameters(model)
            assert base.count == int(count)
            wanted = ["inverse_dynamics", "gravity_torque", "mass_matrix", "base_regressor"]
            wanted += ["forward_dynamics", "coriolis_matrix", "slotine_li_regressor"]
            found = [program.operations.total() for program in make_programs(model, base, wanted)]
            assert found == [int(x) for x in operations.split(" | ")[1:]], name


@pytest.mark.parametrize("language", LANGUAGES)
def test_a_matrix_bears_the_name_that_its_comment_explains(language: str):
    """Y and Y_b are two matrices: no text says that Y_b gives the torque and then returns Y."""
    each = case("iiwa14-r820")
    text = "\n".join(generate(each.model, each.base, each.values, language).values())
    base = text[text.index("Y_b: torque = Y_b times base parameters") :]
    end = re.search(r"(inverse_dynamics|func_pi|: torque = Y times)", base)
    assert not re.search(r"\bY\b", base[: end.start()] if end else base)


def test_a_file_in_the_place_of_the_folder_is_told(run: Run, tmp_path: Path):
    taken = tmp_path / "code"
    taken.write_text("mine", encoding="utf-8")
    with pytest.raises(OutputError, match="could not be written"):
        export_code(run, "c", taken)
    assert taken.read_text(encoding="utf-8") == "mine"
