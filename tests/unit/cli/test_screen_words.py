"""Words on the screen: those of textbooks, and each number with what it is."""

from __future__ import annotations

import numpy as np
import pytest

from armid.cli.commands.certify_parameters import RULES
from armid.cli.parameter_tables import PRIORS, folded_line
from armid.estimation.estimators.physical import PRIORS as KINDS
from armid.runs.run import load_run
from armid.validation.thesis_constraints import thesis_constraints
from command_line import exit_code as armid
from reports import make_run

URDF = """<robot name="flat"><link name="base"/><joint name="j" type="continuous"><parent link="base"/>
<child link="plate"/><axis xyz="0 0 1"/></joint><link name="plate"><inertial><mass value="1"/>
<inertia ixx="{ixx}" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/></inertial></link></robot>"""


@pytest.mark.parametrize(("ixx", "code", "word"), [(0.01, 0, ""), (0.05, 1, "not ")])
def test_a_certificate_speaks_of_physical_consistency(ixx, code, word, tmp_path, capsys):
    path = tmp_path / "flat.urdf"
    path.write_text(URDF.format(ixx=ixx))
    assert armid("certify", path) == code
    out = " ".join(capsys.readouterr().out.split())
    assert f"standard parameters: {word}physically consistent" in out and "smallest eigenvalue" in out
    assert "positive definite" in out and "feasible" not in out and "against" not in out and "worst pose" not in out
    if ixx == 0.05:
        assert (
            "link 1: sum of the two smaller moments of inertia is 0.02 kg·m², less than its bound of 0.05 kg·m², the "
            "largest moment; equation (3.53a) of the thesis"
        ) in out and "rounded" not in out


def test_every_rule_and_every_prior_has_its_words():
    found = thesis_constraints(np.ones(5), np.tile(np.eye(3), (5, 1, 1)))
    assert {each.constraint for each in found} == set(RULES)
    assert set(KINDS) - {"auto"} == set(PRIORS)


def test_parameters_in_a_line(tmp_path):
    said = folded_line(load_run(make_run(tmp_path).folder).estimate)
    assert "σ" not in said and ("relative standard deviation" in said or ";" not in said)


def test_a_preflight_speaks_of_uncorrelated_noise_and_of_fisher_information(tmp_path, capsys):
    path = tmp_path / "flat.urdf"
    path.write_text(URDF.format(ixx=0.01).replace("</joint>", '<limit velocity="2" effort="9"/></joint>'))
    plan = ("--budget", 1, "--harmonics", 2, "--duration", 2, "--acceleration", 9, "--out", tmp_path / "plan")
    assert armid("excite", path, *plan) == 0
    capsys.readouterr()
    text = (tmp_path / "plan" / "preflight.txt").read_text()
    assert "log-determinant of the Fisher information" in text and "uncorrelated torque noise" in text
    assert "white" not in text and "log det" not in text
