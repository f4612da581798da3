"""Duties of a clean environment: `python smoke.py EXTRA…`, in an empty folder, with the extras installed.

The core identifies an arm by itself. Each extra's feature works where the extra is installed, and says how to get it
where it is not. Called by `scripts/packages`.
"""

from __future__ import annotations

import contextlib
import io
import json
import sys
from collections.abc import Callable
from pathlib import Path

from armid.cli.main import main

LINK = """
  <link name="{link}"><inertial><origin xyz="0.1 0 0.05"/><mass value="2"/>
    <inertia ixx="0.02" iyy="0.03" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="{joint}" type="revolute"><parent link="{parent}"/><child link="{link}"/><origin xyz="0.3 0 0"/>
    <axis xyz="{axis}"/><limit lower="-3" upper="3" velocity="3" effort="50"/></joint>"""
LINKS = LINK.format(link="a", joint="one", parent="base", axis="0 0 1")
LINKS += LINK.format(link="b", joint="two", parent="a", axis="0 1 0")
URDF = f'<robot name="small"><link name="base"/>{LINKS}\n</robot>\n'
XACRO = URDF.replace("<robot ", '<robot xmlns:xacro="http://www.ros.org/wiki/xacro" ')

SIMULATE = ("simulate", "small.urdf", "plan/plan.json", "--rate", "100")


def armid(*arguments: str, code: int = 0) -> str:
    """Run the command line; what it wrote on standard output, or on standard error where it was to fail."""
    out, err = io.StringIO(), io.StringIO()
    ended: object = 0
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            main(list(arguments))
        except SystemExit as stop:
            ended = stop.code or 0
    if ended != code:
        sys.exit(f"armid {' '.join(arguments)} ended with {ended}, not {code}\n{out.getvalue()}{err.getvalue()}")
    return err.getvalue() if code else out.getvalue()


def symbolic() -> None:
    """Gravity torque as an expression."""
    from armid import load_run
    from armid.codegen.sympy_functions import make_symbolic

    run = load_run("run")
    make_symbolic(run.model, run.estimate.base, "gravity_torque")


def by_command(*arguments: str) -> Callable[[int], str]:
    """A feature that is a command."""
    return lambda code: armid(*arguments, code=code)


def by_call(feature: Callable[[], None]) -> Callable[[int], str]:
    """A feature that is a function; its error as the command line would print it."""

    def run(code: int) -> str:
        from armid import ArmidError

        try:
            feature()
        except ArmidError as error:
            return str(error)
        if code:
            sys.exit("worked without its extra")
        return ""

    return run


def cluster() -> None:
    """Runs a task on a local cluster."""
    from armid.cluster import cluster_executor

    with cluster_executor("local", 1) as executor:
        assert executor.submit(abs, -1).result() == 1


FEATURES: dict[str, list[Callable[[int], str]]] = {
    "io": [
        by_command(*SIMULATE, "--mode", "inverse-dynamics", "--format", "parquet", "--out", "parquet"),
        by_command(*SIMULATE, "--mode", "inverse-dynamics", "--format", "mcap", "--out", "mcap"),
    ],
    "xacro": [by_command("base", "small.xacro")],
    "lab": [by_command(*SIMULATE, "--out", "closed")],
    "report": [by_command("report", "run")],
    "nlp": [by_command("identify", "small.urdf", "log/recording.csv", "--method", "thesis-nlp", "--out", "nlp")],
    "symbolic": [by_call(symbolic)],
    "dask": [by_call(cluster)],
}


def core() -> None:
    """Everything that needs no extra."""
    Path("small.urdf").write_text(URDF)
    Path("small.xacro").write_text(XACRO)
    assert json.loads(armid("base", "iiwa14-r820", "--gravity", "0", "0", "9.81", "--json"))["count"] == 57
    armid(
        "excite",
        "small.urdf",
        "--duration",
        "5",
        "--harmonics",
        "3",
        "--budget",
        "1",
        "--workers",
        "0",
        "--out",
        "plan",
    )
    for name, seed in (("log", "1"), ("check", "2")):
        armid(*SIMULATE, "--mode", "inverse-dynamics", "--repetitions", "3", "--seed", seed, "--out", name)
    identify = ("identify", "small.urdf", "log/recording.csv", "--method", "physical", "--out", "run", "--json")
    found = json.loads(armid(*identify, "--validate", "check/recording.csv", "--no-report"))
    assert found["validation"]["verdict"] == "pass", found["validation"]
    armid("export", "run", "--to", "urdf", "--out", "identified.urdf")
    armid("export", "run", "--to", "c", "--out", "code")


if __name__ == "__main__":
    core()
    for extra, features in FEATURES.items():
        there = extra in sys.argv[1:]
        for feature in features:
            said = feature(0 if there else 2)
            if not there and f"armid[{extra}]" not in said:
                sys.exit(f"without {extra} the error does not say how to get it:\n{said}")
    sys.stdout.write(f"works {' '.join(sys.argv[1:])}\n")
