"""Warnings that are named beside a verdict: each is printed below, or the line says where it is explained."""

from __future__ import annotations

from dataclasses import replace

import pytest

from armid.cli.commands.report import PAGE
from armid.cli.console import SHAPE_FINDINGS, print_findings
from armid.cli.identification_result import print_result
from armid.errors import Finding
from armid.lab.inverse_dynamics_recording import Sensors
from armid.study.demo import demo_study, run_demo

DYNAMICS = ("speed-beyond", "intervals-guessed")


@pytest.fixture(scope="module")
def demonstrated():
    """The demo with a sampling rate of 400 Hz instead of 8 kHz."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("armid.study.demo.Sensors", lambda: Sensors(rate=400.0))
        return run_demo(demo_study(), seed=1).result


@pytest.mark.parametrize("verbose", [False, True])
@pytest.mark.parametrize("code", [*DYNAMICS, *SHAPE_FINDINGS])
def test_every_named_warning_is_explained_where_it_is_said_to_be(demonstrated, code: str, verbose: bool, capsys):
    findings = (Finding(code, "warning", "", "Something was found."),)
    result = replace(demonstrated, estimate=replace(demonstrated.estimate, findings=findings))
    print_result(result, verbose=verbose)
    print_findings(findings, shapes=verbose, whole=verbose)
    shown = capsys.readouterr()
    named = next(line for line in shown.out.splitlines() if code in line)
    assert ("below" in named) == (f"warning {code}" in shown.err)
    assert "below" in named or ("--verbose" in named and PAGE in named)
