"""Masses that neither torque nor the description tells: not in a file unless asked for."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from armid.errors import OutputError
from armid.export.fixed_body_inertias import is_possible
from armid.export.standard_values import distance_to_description, values_to_write
from armid.export.write import export_run
from armid.robot import InertialParameters
from exports import run_of

ROW = '[[joint]]\nname = "J{}"\nalpha = "{}"\na = 0.3\nposition = [-2, 2]\nvelocity = 3\neffort = 40\n'
BODY = """[joint.inertial]
mass = {}
com = [0.1, 0.02, 0]
inertia = {{ xx = 0.01, xy = 0, xz = 0, yy = 0.02, yz = 0, zz = 0.02 }}
"""


def table(tmp_path, *masses):
    path = tmp_path / "arm.toml"
    rows = [
        ROW.format(k, "pi/2" if k == 2 else "0*pi") + (BODY.format(m) if m else "") for k, m in enumerate(masses, 1)
    ]
    path.write_text('name = "arm"\nconvention = "modified"\n' + "".join(rows))
    return path


def unseen(run, *links):
    """The run, the masses of some links not identified."""
    kept = run.estimate.fit.standard
    status = ["not identifiable" if name in {f"M_{k}" for k in links} else "identified" for name in kept.names]
    fit = dataclasses.replace(run.estimate.fit, standard=dataclasses.replace(kept, status=tuple(status)))
    return dataclasses.replace(run, estimate=dataclasses.replace(run.estimate, fit=fit))


@pytest.mark.parametrize("to", ["urdf", "mjcf", "sdf"])
def test_links_that_nothing_tells_are_refused_and_named(tmp_path, to):
    run = unseen(run_of(tmp_path / "run", table(tmp_path, 0, 0)), 1)
    with pytest.raises(
        OutputError, match=r"Torques do not determine the mass of link_1 \(.* kg\), and the description"
    ) as caught:
        export_run(run, to, tmp_path / "out")
    assert "--allow-unidentified" in caught.value.possible and "approximate masses" in caught.value.remedy
    assert not (tmp_path / "out").exists()
    exported = export_run(run, to, tmp_path / "out", allow_unidentified=True)
    assert [f.severity for f in exported.findings if f.code == "unidentified"] == ["warning"]
    assert all(check.ok for check in exported.checks)


def test_where_only_base_parameters_are_known_the_geometry_says_which(tmp_path):
    """The mass of no link that turns about a vertical axis shows; nor does any mass alone, of two links that turn."""
    run = run_of(tmp_path / "run", table(tmp_path, 0, 0), standard=False)
    with pytest.raises(OutputError, match=r"link_1 \(.*link_2 \("):
        export_run(run, "urdf")


def test_where_the_description_gives_masses_nothing_is_said(tmp_path):
    run = unseen(run_of(tmp_path / "run", table(tmp_path, 3, 2)), 1, 2)
    assert "unidentified" not in {f.code for f in export_run(run, "urdf").findings}
    some = unseen(run_of(tmp_path / "some", table(tmp_path, 0, 2)), 1, 2)
    with pytest.raises(OutputError, match=r"mass of link_1 \([^,]*\), and the description"):
        export_run(some, "urdf")


# Nearest to what


def said(run, **options):
    _, kind, findings = values_to_write(run, **options)
    return kind, " ".join(f.evidence for f in findings)


def test_nearest_says_to_what_and_which_distance_is_least(tmp_path):
    described = run_of(tmp_path / "a", table(tmp_path, 3, 2))
    kind, text = said(described, nearest=True)
    assert kind == "nearest" and "nearest to the description" in text and "pseudo-inertia" in text
    bare = table(tmp_path, 0, 0)
    _, text = said(run_of(tmp_path / "b", bare), nearest=True)
    assert "description" not in text.replace("the description contains no masses", "") and "estimate" in text
    _, text = said(run_of(tmp_path / "c", bare, standard=False))
    assert "nearest to the description" not in text and "smallest mass" in text


def test_the_distance_that_is_said_is_least(tmp_path):
    """Mass may move away from the description's where first moments and inertias come nearer: no other body with the
    same torque has a smaller distance."""
    run = run_of(tmp_path / "run", table(tmp_path, 3, 2), seed=3)
    theta, kind, _ = values_to_write(run, nearest=True)
    assert kind == "nearest"
    base = run.estimate.base
    least = distance_to_description(run, theta)
    estimated = run.estimate.fit.standard.values
    assert least < distance_to_description(run, estimated)
    null = np.linalg.svd(base.regrouping)[2][base.count :]
    assert base.values_of(theta) == pytest.approx(base.values_of(estimated), abs=1e-9)
    rng, compared = np.random.default_rng(0), 0
    for size in (1e-3, 1e-2):
        for step in rng.normal(size=(20, len(null))) * size:
            other = theta + step @ null
            if all(
                is_possible(InertialParameters.from_vector(each))
                for each in other[run.model.inertial_columns].reshape(-1, 10)
            ):
                compared += 1
                assert distance_to_description(run, other) > least - 1e-6
    assert compared > 10
    assert distance_to_description(run, run.model.nominal_parameters()) == 0.0
