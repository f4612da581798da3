"""Fleets from files: bad files are refused, executors change nothing, units differ where they were made to differ."""

from __future__ import annotations

import shutil
import tomllib
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from multiprocessing import get_context

import numpy as np
import pytest

from armid.errors import ArmidError, StudyError
from armid.runs.fleet.fleet_change import changes_since
from armid.runs.fleet.new_unit import study_like_fleet
from armid.runs.fleet.stored_fleet import load_fleet, save_fleet
from armid.runs.run import load_run
from armid.study.config import parse_study
from armid.study.fleet.fleet_file import load_fleet_file, parse_fleet
from armid.study.fleet.identify_fleet import identify_fleet
from armid.study.fleet.unit_result import identify_unit
from armid.study.identify import identify
from fleets import HEAD, made_fleet, write_fleet

UNITS = 6


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    folder = tmp_path_factory.mktemp("fleet")
    units = made_fleet(UNITS, 1)
    found = identify_fleet(load_fleet_file(write_fleet(units, folder)))
    save_fleet(found, folder / "stored")
    return folder, units, found


def test_own_parameters_are_recovered(scene):
    _, units, found = scene
    own = np.isin(found.base.names, found.estimate.prior.own)
    for unit, result in zip(units, found.results, strict=True):
        true = found.base.values_of(unit.truth)[own]
        fit = result.estimate.fit
        # The scale of torques of all units together is known to 2 % / √6, so friction is known to 3 % at three sigma.
        assert fit.values[own] == pytest.approx(true, rel=0.03, abs=0.03)
    assert found.estimate.odd == () and found.findings == ()


def test_threads_give_the_same_bytes(scene):
    folder, _, found = scene
    with ThreadPoolExecutor(3) as executor:
        again = identify_fleet(load_fleet_file(folder / "FLEET.toml"), executor=executor)
    assert np.array_equal(again.estimate.values, found.estimate.values)
    assert np.array_equal(again.estimate.prior.covariance, found.estimate.prior.covariance)
    for one, other in zip(again.results, found.results, strict=True):
        assert np.array_equal(one.estimate.fit.covariance, other.estimate.fit.covariance)


def test_processes_give_the_same_bytes(tmp_path):
    choice = load_fleet_file(write_fleet(made_fleet(2, 1, repetitions=1), tmp_path))
    one = identify_fleet(choice)
    with ProcessPoolExecutor(2, get_context("spawn")) as executor:
        other = identify_fleet(choice, executor=executor)
    assert np.array_equal(one.estimate.values, other.estimate.values)
    assert np.array_equal(one.estimate.deviation, other.estimate.deviation)


def test_stored_fleet_is_the_fleet(scene):
    folder, _, found = scene
    stored = load_fleet(folder / "stored")
    assert stored.estimate.units == found.estimate.units
    assert np.array_equal(stored.estimate.values, found.estimate.values)
    run = load_run(stored.run_of("unit-02"))
    assert np.array_equal(run.estimate.fit.values, found.results[1].estimate.fit.values)
    with pytest.raises(ArmidError, match="no unit 'unit-99'"):
        stored.run_of("unit-99")


def test_only_what_changed_is_told(scene, tmp_path):
    _, _, found = scene
    assert not any(each.beyond for each in changes_since(found.estimate, found.estimate))
    later = made_fleet(UNITS, 1, odd={(2, "FS_1"): 1.5})
    after = identify_fleet(load_fleet_file(write_fleet(later, tmp_path)))
    beyond = [each for each in changes_since(found.estimate, after.estimate) if each.beyond]
    assert [(each.unit, each.parameter) for each in beyond] == [("unit-03", "FS_1")]


def test_new_unit_is_predicted_from_a_brief_recording(scene):
    folder, _, _ = scene
    fleet = load_fleet(folder / "stored")
    new = made_fleet(UNITS + 1, 1)[-1]
    text = '[robot]\ndescription = "small.urdf"\n[[recording]]\npath = "a"\npart = [0.0, 0.2]\n'
    text += '[[recording]]\npath = "b"\nrole = "validate"\n'
    study = study_like_fleet(parse_study(tomllib.loads(text), str(folder)), fleet)
    given = {"a": new.training, "b": new.validation}
    _, brief = identify_unit(study, fleet.estimate.prior, given=given)
    assert brief.estimate.method == "fleet"
    # 3.2 s of a motion that repeats after 8 s; the noise of the torque is 0.5 to 3 % of it.
    assert (brief.validation.recordings[0].relative < 0.05).all()


def test_other_terms_than_those_of_the_fleet_are_refused(scene):
    folder, _, _ = scene
    fleet = load_fleet(folder / "stored")
    study = parse_study(tomllib.loads(HEAD.replace(', "offset"', "") + '[[recording]]\npath = "a"'), str(folder))
    with pytest.raises(StudyError, match="other torque terms"):
        study_like_fleet(study, fleet)


UNIT = '[[unit]]\nname = "a"\nrecordings = ["a.npz"]\n'

BAD = {
    "one unit": (UNIT, "at least two units"),
    "no name": ("[[unit]]\nrecordings = []\n", "needs a `name`"),
    "bad name": ('[[unit]]\nname = "../a"\n', "needs a `name`"),
    "name ends in a dot": ('[[unit]]\nname = "a."\n', "needs a `name`"),
    "same name": (UNIT + UNIT.replace('"a"', '"A"'), "Two units have the name"),
    "unknown key": (UNIT + "roll = 1\n", "no key 'roll'"),
    "unknown table": ("[estimation]\n" + UNIT, "no key 'estimation'"),
    "no recording": ('[[unit]]\nname = "a"\n', r"\[\[unit\]\] a: No recording"),
    "single bracket": ('[unit]\nname = "a"\n', "must be a list of tables"),
    "recordings no list": ('[[unit]]\nname = "a"\nrecordings = "a.npz"\n', "must be a list of paths"),
    "role for all": ('[reading]\nrole = "train"\n' + UNIT, "belongs to one recording"),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_files_are_refused(name):
    text, problem = BAD[name]
    with pytest.raises(StudyError, match=problem):
        parse_fleet(tomllib.loads(HEAD + text))


def test_automatic_terms_are_refused():
    table = tomllib.loads('[robot]\ndescription = "small.urdf"\n[model]\nterms = "auto"\n' + UNIT)
    with pytest.raises(StudyError, match="cannot select its terms"):
        parse_fleet(table)


def test_error_names_the_unit(tmp_path):
    path = write_fleet(made_fleet(2, 1), tmp_path)
    (tmp_path / "unit-02.npz").unlink()
    with pytest.raises(ArmidError, match="unit unit-02: "):
        identify_fleet(load_fleet_file(path))


def test_one_recording_of_two_units_is_refused(tmp_path):
    path = write_fleet(made_fleet(2, 1, repetitions=1), tmp_path)
    (tmp_path / "unit-02.npz").write_bytes((tmp_path / "unit-01.npz").read_bytes())
    with pytest.raises(StudyError, match="unit-01 and unit-02 have the same recording"):
        identify_fleet(load_fleet_file(path))


def test_damaged_fleet_is_refused(scene):
    folder, _, _ = scene
    shutil.copytree(folder / "stored", folder / "damaged")
    path = folder / "damaged" / "fleet.npz"
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(data)
    with pytest.raises(ArmidError, match=r"fleet\.npz"):
        load_fleet(folder / "damaged")
    with pytest.raises(ArmidError, match="is not a fleet of armid"):
        load_fleet(folder)


@pytest.mark.long
def test_odd_joint_of_one_of_twenty_units_and_a_brief_new_unit(tmp_path):
    odd = {(12, "FV_2"): 2.5, (12, "FS_2"): 2.5}
    *units, new = made_fleet(21, 7, odd=odd)
    found = identify_fleet(load_fleet_file(write_fleet(units, tmp_path)))
    assert {(each.unit, each.joint) for each in found.estimate.odd} == {("unit-13", 1)}
    assert found.estimate.odd_bodies == ()
    text = HEAD + '[[recording]]\npath = "a"\npart = [0.0, {part}]\n[[recording]]\npath = "b"\nrole = "validate"\n'
    given = {"a": new.training, "b": new.validation}
    brief = parse_study(tomllib.loads(text.replace("{part}", "0.19")), str(tmp_path))  # 3 of 16 s
    _, by_fleet = identify_unit(brief, found.estimate.prior, given=given)
    alone = identify(parse_study(tomllib.loads(text.replace("{part}", "1.0")), str(tmp_path)), given=given)
    error, usual = (np.linalg.norm(each.validation.recordings[0].rms) for each in (by_fleet, alone))
    assert error <= 1.5 * usual  # 2 s of rows for 9 parameters and 3 scales, against 15 s
