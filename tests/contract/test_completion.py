"""Completion offers what the catalogues hold, and help is clean."""

from __future__ import annotations

import re

import pytest
import typer

from armid.cli import value_completion
from armid.cli.command_list import COMMANDS
from armid.cli.log_format_options import PRESET_NAMES
from armid.cli.main import app
from armid.cli.monitoring.monitor import OBSERVER_KINDS
from armid.excitation.design.criteria import CRITERIA
from armid.excitation.limits.joint_limits import KINDS
from armid.measurement.log_format import PRESETS
from armid.runs.monitoring.observer import OBSERVERS

NAMES = [command.__name__.replace("_", "-") for command in COMMANDS]


@pytest.mark.parametrize(
    ("said", "catalogue"),
    [
        (value_completion.CRITERIA, CRITERIA),
        (value_completion.KINDS, KINDS),
        (PRESET_NAMES, PRESETS),
        (OBSERVER_KINDS, OBSERVERS),
    ],
    ids=["criteria", "limits", "presets", "observers"],
)
def test_names_are_those_of_the_catalogue(said: tuple[str, ...], catalogue: object):
    assert len(said) == len(set(said)) and set(said) == set(catalogue)  # pyright: ignore


@pytest.mark.parametrize("name", NAMES)
def test_help_has_no_types_of_switches_and_no_braces(name: str, capsys: pytest.CaptureFixture[str]):
    command = typer.main.get_command(app)
    with pytest.raises(SystemExit):
        command([name, "--help"], prog_name="armid")
    out = capsys.readouterr().out
    usage = " ".join(re.split(r"\n\s*\n", out.partition("Usage:")[2])[0].split())
    assert usage.startswith(f"armid {name} [OPTIONS]")
    assert "<bool>" not in out and not re.search(r"[{}]|\.\.\.|\[\[", usage), usage
