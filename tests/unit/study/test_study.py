"""Content of a study and what it refuses, and what is resolved in its result."""

from __future__ import annotations

import json
import shutil
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest

from armid.errors import ArmidError, ModelError, RecordingError, StudyError
from armid.estimation.estimate_record import Estimate, standard_parameters
from armid.estimation.estimators import PhysicallyConsistent, Ridge, WeightedLeastSquares
from armid.estimation.friction.forward_selection import SHRINKAGE
from armid.estimation.friction.selection import FrictionSelection
from armid.measurement.processing.options import ProcessingOptions
from armid.model.dynamics_model import DynamicsModel
from armid.model.terms import DEFAULT_TERMS, TERMS, Coulomb, RigidBody, Stribeck, Viscous
from armid.robot import load_robot
from armid.study.compare_methods import compare_methods
from armid.study.config import (
    EstimationChoice,
    ModelChoice,
    RecordingChoice,
    RobotChoice,
    Study,
    build_estimator,
    build_model,
    load_choice,
    load_study,
    parse_study,
    resolve_model,
)
from armid.study.identify import Result, identify
from armid.study.prepare import prepare
from armid.study.recordings.data_split import cut_recording
from armid.study.selection_prior_options import as_chosen
from armid.study.servos.choice import ServoChoice
from labs import (
    STUDY,
    small_folder,
    small_model,
    small_plan,
    small_recording,
    small_truth,
    write_arm,
    write_recording,
    write_recordings,
    write_study,
)

EVERY_KEY = """
[robot]
description = "iiwa14.urdf"
gravity = [0.0, 0.0, -9.81]
lock = ["panda_finger_joint1"]
tip = "flange"
only = ["A*"]
[model]
terms = ["rigid-body", "viscous", "coulomb", "offset", "rotor-inertia"]
coulomb = { width = 0.02 }
[[recording]]
path = "samples_2000.parquet"
role = "train"
part = [0.0, 0.7]
rate = 50.0
consecutive = true
torque_sign = -1
position_sign = [1, -1]
time_unit = 0.001
drive_gain = [14.87, 13.26]
drive_gain_deviation = 0.1
position_zero_deviation = 0.002
transmission = [[32.0, 0.0], [0.0, 32.0]]
joint_offset = [0.0, 1.5]
delay = [0.004, 0.0]
columns = { q = "q{}", dq = "dq{}", ddq = "ddq{}", effort = "tau{}", time = "t" }
units = "deg"
joints = { a = "joint_1", b = "joint_2" }
topic = "/joint_states"
calibration = "follower.json"
preset = "ur-rtde"
exclude = [[1.0, 2.0], [5, 6]]
period = 20.0
start = 1.5
spikes = "keep"
highest_rate = 500.0
[processing]
cutoff = 3.0
order = 2
family = "fir"
columns = false
decimate = 20.0
derivatives = "filter"
edges = "pad"
trim = 0.25
slow = 0.1
motion_cutoff = 4.0
average = false
standstill = "keep"
saturation = 0.9
[estimation]
method = "ols"
friction_per_recording = true
offset_per_recording = true
wls = { iterations = 7 }
[servo]
stiffness = [20.0, 15.0]
stiffness_deviation = 0.2
damping = 1.5
limit = 3.35
delay = 0.01
link_deviation = 0.05
terms = ["viscous", "coulomb", "stribeck"]
"""
"""Every key that a study knows, the example of the design among them."""

WITHOUT_MEMORY = 0.1
"""Largest torque error on separate rows, as a share of the torque's standard deviation: hysteresis is wrong near
reversals only (0.03 measured). With states of zero, the term would resemble a spring (0.23 to 0.60)."""


def every_key() -> Study:
    import tomllib

    return parse_study(tomllib.loads(EVERY_KEY))


def parse(text: str) -> Study:
    import tomllib

    return parse_study(tomllib.loads(text))


def plain(**tables: object) -> Study:
    """A study with the least that one needs, and what is given."""
    least = {"robot": {"description": "iiwa14-r820"}, "recording": [{"path": "a.csv"}]}
    return parse_study({**least, **tables})


# Keys ----------------------------------------------------------------------------------------------------------


def test_every_key_arrives():
    study = every_key()
    assert asdict(study.robot) == {
        "description": "iiwa14.urdf",
        "gravity": (0.0, 0.0, -9.81),
        "lock": ("panda_finger_joint1",),
        "tip": "flange",
        "only": ("A*",),
    }
    assert study.model.terms == ("rigid-body", "viscous", "coulomb", "offset", "rotor-inertia")
    assert study.model.shapes == {"coulomb": {"width": 0.02}}
    (recording,) = study.recordings
    assert (recording.path, recording.role, recording.part) == ("samples_2000.parquet", "train", (0.0, 0.7))
    reading = recording.reading
    assert (reading.rate, reading.consecutive, reading.units) == (50.0, True, "deg")
    assert reading.calibration == "follower.json"
    assert (reading.topic, reading.preset, reading.period, reading.start) == ("/joint_states", "ur-rtde", 20.0, 1.5)
    assert np.array_equal(reading.torque_sign, [-1.0])
    assert np.array_equal(reading.drive_gain, [14.87, 13.26])  # pyright: ignore[reportArgumentType]
    assert np.array_equal(reading.drive_gain_deviation, [0.1])  # pyright: ignore[reportArgumentType]
    assert np.array_equal(reading.transmission, 32.0 * np.eye(2))  # pyright: ignore[reportArgumentType]
    assert np.array_equal(reading.delay, [0.004, 0.0])
    assert np.array_equal(reading.joint_offset, [0.0, 1.5])  # pyright: ignore[reportArgumentType]
    assert reading.columns == {
        "q": ("q{}",),
        "dq": ("dq{}",),
        "ddq": ("ddq{}",),
        "effort": ("tau{}",),
        "time": ("t",),
    }
    assert (reading.joint_map, reading.exclude) == ({"a": "joint_1", "b": "joint_2"}, ((1.0, 2.0), (5.0, 6.0)))
    assert study.processing == ProcessingOptions(
        3.0, 2, "fir", False, 20.0, "filter", "pad", 0.25, 0.1, 4.0, False, 0.9, "keep"
    )  # in the order of its fields
    assert study.estimation == EstimationChoice(
        "ols", friction_per_recording=True, offset_per_recording=True, options={"wls": {"iterations": 7}}
    )
    assert study.servo == ServoChoice((20.0, 15.0), 0.2, 1.5, 3.35, 0.01, 0.05, ("viscous", "coulomb", "stribeck"))


def test_no_key_is_missing_above():
    """Each field of the dataclasses stands in the text, so that a new one is thought of here."""
    study = every_key()
    for value in (study.robot, study.recordings[0].reading, study.processing, study.estimation, study.servo):
        for name in asdict(value).keys() - {"options"}:  # these stand under the names of estimators
            assert f"\n{name} = " in EVERY_KEY, name


def test_options_of_an_estimator_stand_under_its_name():
    study = plain(estimation={"wls": {"iterations": 7}})
    assert build_estimator(study.estimation) == WeightedLeastSquares(iterations=7)
    with pytest.raises(StudyError, match=r"\[estimation.wls\].*'iteration'") as caught:
        plain(estimation={"method": "ols", "wls": {"iteration": 7}})
    assert caught.value.remedy == "did you mean 'iterations'?"


def test_defaults():
    study = plain()
    assert study.processing == ProcessingOptions() and study.estimation == EstimationChoice("wls")
    assert study.recordings == (study.recordings[0],) and study.recordings[0].role == "train"
    assert study.recordings[0].part == (0.0, 1.0) and study.recordings[0].reading.rate is None
    assert study.robot == RobotChoice("iiwa14-r820") and study.model == ModelChoice()


@pytest.mark.parametrize(
    ("tables", "where", "wrong", "known"),
    [
        ({"recordings": []}, "The study", "recordings", "did you mean 'recording'?"),
        ({"robot": {"descripton": "x"}}, "[robot]", "descripton", "did you mean 'description'?"),
        ({"model": {"term": []}}, "[model]", "term", "did you mean 'terms'?"),
        ({"model": {"coulomb": {"with": 1}, "terms": ["coulomb"]}}, "[model.coulomb]", "with", "mean 'width'?"),
        ({"recording": [{"path": "a", "torque_sing": -1}]}, "[[recording]]", "torque_sing", "mean 'torque_sign'?"),
        ({"recording": [{"path": "a", "zzz": -1}]}, "[[recording]]", "zzz", ""),
        ({"processing": {"cut_off": 3}}, "[processing]", "cut_off", "did you mean 'cutoff'?"),
        ({"estimation": {"methd": "wls"}}, "[estimation]", "methd", "did you mean 'method'?"),
    ],
)
def test_an_unknown_key_is_answered_with_the_known_ones(tables: dict, where: str, wrong: str, known: str):
    with pytest.raises(StudyError) as caught:
        study = plain(**tables)
        build_model(load_choice(study.robot), study.model)
    assert caught.value.problem == f"{where} has no key {wrong!r}."
    assert known in caught.value.remedy
    fields = {"The study": "robot", "[robot]": "gravity", "[model]": "rotor-inertia", "[model.coulomb]": "joints"}
    fields |= {"[[recording]]": "transmission", "[processing]": "derivatives", "[estimation]": "method"}
    assert fields[where] in caught.value.possible


@pytest.mark.parametrize(
    ("tables", "message"),
    [
        ({"robot": "iiwa"}, "[robot] must be a table; found 'iiwa'"),
        ({"robot": {}}, "[robot] has no value for description"),
        ({"robot": {"description": 5}}, "[robot] `description` must be text; found 5"),
        ({"robot": {"description": "x", "gravity": [1, 2]}}, "[robot] `gravity` must be three numbers"),
        ({"robot": {"description": "x", "gravity": "down"}}, "[robot] `gravity` must be three numbers"),
        ({"robot": {"description": "x", "locked": "finger"}}, "[robot] `lock` must be a list of names"),
        ({"robot": {"description": "x", "locked": {"finger": "in"}}}, "[robot] `lock` must be a list of names"),
        ({"robot": {"description": "x", "tip": 3}}, "[robot] `tip` must be text"),
        ({"model": 3}, "[model] must be a table"),
        ({"model": {"terms": "viscous"}}, "[model] `terms` must be a list of names; found 'viscous'"),
        ({"model": {"terms": [1]}}, "[model] `terms` must be a list of names"),
        ({"model": {"coulomb": 0.02}}, "[model] `coulomb` must be a table of options"),
        ({"recording": {"path": "a"}}, "The key `recording` of the study must be a list of tables"),
        ({"recording": ["a.csv"]}, "The key `recording` of the study must be a list of tables"),
        ({"recording": [{"role": "train"}]}, "A recording has no key `path`"),
        ({"recording": [{"path": 3}]}, "[[recording]] `path` must be text"),
        ({"recording": [{"path": "a", "part": 0.5}]}, "[[recording]] `part` must be two numbers"),
        ({"recording": [{"path": "a", "part": [0.5]}]}, "[[recording]] `part` must be two numbers"),
        (
            {"recording": [{"path": "a", "part": [0.7, 0.3]}]},
            "`part` must be two increasing shares",
        ),
        (
            {"recording": [{"path": "a", "part": [0.7, 1.3]}]},
            "`part` must be two increasing shares",
        ),
        ({"recording": [{"path": "a", "role": "test"}]}, "unknown role 'test'"),
        ({"recording": [{"path": "a", "rate": "fast"}]}, "[[recording]] a: `rate` must be a number"),
        ({"processing": {"cutoff": "low"}}, '[processing] cutoff must be a number above 0 or "auto"'),
        ({"processing": {"edges": "cut"}}, "[processing] edges = 'cut' is not known"),
        ({"estimation": {"method": "magic"}}, "Unknown estimation method 'magic'"),
        ({"estimation": {"method": ["wls"]}}, "Unknown estimation method"),
        ({"estimation": {"friction_per_recording": "yes"}}, "`friction_per_recording` must be true or false"),
        ({"estimation": {"offset_per_recording": 1.5}}, "`offset_per_recording` must be true or false"),
    ],
)
def test_values_of_the_wrong_kind_are_refused(tables: dict, message: str):
    with pytest.raises(StudyError) as caught:
        plain(**tables)
    assert message in caught.value.problem


@pytest.mark.parametrize("recordings", [[], [{"path": "a", "role": "validate"}]])
def test_nothing_to_train_on_is_refused(recordings: list):
    with pytest.raises(StudyError, match="No recording has the role"):
        plain(recording=recordings)


def test_roles_and_methods_list_what_there_is():
    with pytest.raises(StudyError, match="unknown role") as caught:
        RecordingChoice("a.csv", "tarin")  # pyright: ignore[reportArgumentType]
    assert caught.value.possible == "train, validate"
    with pytest.raises(StudyError) as caught:
        EstimationChoice("lms")
    assert caught.value.possible.split(", ")[:2] == ["ols", "wls"]


def test_a_study_without_robot_is_refused():
    with pytest.raises(StudyError, match=r"no table \[robot\]"):
        parse_study({"recording": [{"path": "a.csv"}]})


def test_a_missing_or_broken_file_is_refused(tmp_path: Path):
    with pytest.raises(StudyError, match=r"nowhere\.toml cannot be read"):
        load_study(tmp_path / "nowhere.toml")
    with pytest.raises(StudyError, match=r"not valid TOML: .*line 2"):
        load_study(write_study(tmp_path, "[robot]\ndescription = iiwa\n"))
    (tmp_path / "study.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(StudyError, match="cannot be read"):
        load_study(tmp_path / "study.toml")


# Terms ---------------------------------------------------------------------------------------------------------


def names_and_width(choice: ModelChoice, *, motor_side: bool = False) -> tuple[tuple[str, ...], float]:
    model = build_model(small_model().robot, choice, motor_side=motor_side)
    width = next((term.width for term in model.terms if isinstance(term, Coulomb)), -1.0)
    return tuple(term.name for term in model.terms), width


def test_default_terms_follow_the_side_of_the_effort():
    common = ("rigid-body", "viscous", "coulomb", "offset")
    assert names_and_width(ModelChoice()) == (common, 0.02)
    assert names_and_width(ModelChoice(), motor_side=True) == ((*common, "rotor-inertia"), 0.02)
    assert names_and_width(ModelChoice(shapes={"coulomb": {"width": 0.1}})) == (common, 0.1)


def test_named_terms_have_the_shapes_of_their_own_defaults():
    assert names_and_width(ModelChoice(("rigid-body", "coulomb"))) == (("rigid-body", "coulomb"), 0.0)


def test_terms_can_be_added_to_the_default_ones():
    """The shapes of the default terms stay: a bare `coulomb` in a list has another width."""
    added = build_model(small_model().robot, ModelChoice(("default", "rotor-inertia"))).terms
    assert added == (*DEFAULT_TERMS, TERMS["rotor-inertia"]())
    wider = ModelChoice(("default", "coulomb"), {"coulomb": {"width": 0.1}})
    assert set(build_model(small_model().robot, wider).terms) == {*DEFAULT_TERMS, Coulomb(0.1)} - {Coulomb(0.02)}


def test_terms_that_are_not_there_are_refused():
    with pytest.raises(StudyError, match="Unknown torque term 'viscouss'") as caught:
        names_and_width(ModelChoice(("rigid-body", "viscouss")))
    assert caught.value.possible == ", ".join((*TERMS, "default")) and "'viscous'" in caught.value.remedy
    with pytest.raises(StudyError, match="options of 'coulomb', but this is not one of the terms"):
        names_and_width(ModelChoice(("rigid-body",), {"coulomb": {"width": 0.1}}))


@pytest.mark.parametrize(
    ("table", "owner"),
    [({"method": "physical", "prior": "log-det"}, "physical"), ({"method": "ridge", "weight": 2.0}, "ridge")],
)
def test_an_option_outside_its_method_is_told_where_it_belongs(table: dict[str, object], owner: str):
    with pytest.raises(StudyError, match="has no key") as caught:
        plain(estimation=table)
    assert f"[estimation.{owner}]" in caught.value.remedy


def test_friction_may_be_chosen_and_is_then_estimated_with_a_prior():
    study = plain(model={"terms": "auto", "coulomb": {"width": 0.05}})
    assert study.model == ModelChoice(shapes={"coulomb": {"width": 0.05}}, automatic=True)
    assert study.estimation.method == "auto"
    assert plain(model={"terms": "auto"}, estimation={"method": "wls"}).estimation.method == "wls"


def selection(prior_weight: float | None = 2.5, method: str = "ridge") -> FrictionSelection:
    model = DynamicsModel(load_robot("iiwa14-r820"), (RigidBody(),))
    noise = () if prior_weight is None else (0.5,) * 7
    return FrictionSelection(model, (), (), np.ones(7), np.zeros(7), prior_weight, noise=noise, method=method)


def test_selected_friction_is_estimated_as_it_was_judged():
    """Method, weight of the prior, noise and shrinkage of the estimate are those of the selection."""
    open_, judged = EstimationChoice("auto"), {"noise": (0.5,) * 7, "shrinkage": SHRINKAGE}
    assert build_estimator(as_chosen(open_, selection(), described=True)) == Ridge(weight=2.5, **judged)
    consistent = PhysicallyConsistent(prior="log-det", weight=1.0, **judged)
    assert build_estimator(as_chosen(open_, selection(method="physical"), described=True)) == consistent
    assert build_estimator(as_chosen(open_, selection(None), described=True)) == Ridge()
    physical = as_chosen(EstimationChoice("physical"), selection(), described=False)
    assert build_estimator(physical) == PhysicallyConsistent(prior="mass", weight=1.0, **judged)
    assert as_chosen(physical, selection(7.0), described=True) == physical  # what is given stays
    assert build_estimator(as_chosen(EstimationChoice("wls"), selection(), described=True)) == WeightedLeastSquares()


def test_the_automatic_method_needs_automatic_terms():
    with pytest.raises(StudyError, match="needs terms"):
        plain(estimation={"method": "auto"})


def test_a_shape_without_a_meaning_names_its_term():
    with pytest.raises(StudyError, match=r"\[model.coulomb\] The width .* found -1"):
        names_and_width(ModelChoice(shapes={"coulomb": {"width": -1}}))


@pytest.mark.parametrize("motor_side", [False, True])
def test_a_resolved_choice_makes_the_same_model(motor_side: bool):
    robot = small_model().robot
    coupling = {"joints": {"joint_2": 1.0, "joint_3": -0.5}, "width": 0.1}
    chosen = ModelChoice(
        ("rigid-body", "viscous", "coupling"), {"coupling": coupling, "viscous": {"joints": ["joint_1"]}}
    )
    shaped = ModelChoice(
        ("rigid-body", "coulomb", "hysteresis", "coulomb", "ripple"),
        {
            "coulomb": [{"width": 0.1, "joints": ["joint_1"]}, {"joints": ("joint_2", "joint_3")}],
            "hysteresis": {"widths": [0.01, 0.1], "joints": ["joint_2"]},
            "ripple": {"harmonics": [], "motor_harmonics": [1, 2], "gear_ratio": 100},
        },
    )
    for choice in (ModelChoice(), chosen, shaped):
        model = build_model(robot, choice, motor_side=motor_side)
        resolved = resolve_model(model)
        assert build_model(robot, resolved).terms == model.terms
        assert build_model(robot, ModelChoice(**json.loads(json.dumps(asdict(resolved))))).terms == model.terms


def test_a_term_with_other_shapes_on_other_joints(tmp_path: Path):
    """Tables of one name make a term each; a name that stands several times takes them one by one."""
    write_arm(tmp_path)
    text = (
        STUDY
        + """
[model]
terms = ["rigid-body", "stribeck", "viscous"]
stribeck = [{ velocity = 0.1, joints = ["joint_1"] }, { velocity = 0.3, joints = ["joint_2", "joint_3"] }]
"""
    )
    study = load_study(write_study(tmp_path, text))
    model = build_model(load_choice(study.robot, tmp_path), study.model)
    assert model.terms[1:] == (
        Stribeck(0.1, joints=("joint_1",)),
        Stribeck(0.3, joints=("joint_2", "joint_3")),
        Viscous(),
    )
    again = ModelChoice(("stribeck", "viscous", "stribeck"), study.model.shapes)
    assert [term.name for term in build_model(model.robot, again).terms] == list(again.terms)
    with pytest.raises(ModelError, match="belong to two torque terms: FT_1"):
        build_model(model.robot, ModelChoice(("stribeck", "stribeck"), {"stribeck": {"velocity": 0.1}}))
    with pytest.raises(StudyError, match=r"\[model\] `stribeck` must be a table of options, or a list of such"):
        plain(model={"terms": ["rigid-body"], "stribeck": [0.1]})


# Recordings ----------------------------------------------------------------------------------------------------


def test_paths_are_relative_to_the_study(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    folder = tmp_path / "studies"
    folder.mkdir()
    write_recordings(folder)
    write_study(folder)
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    monkeypatch.chdir(elsewhere)
    result = identify(load_study(Path("..") / "studies" / "study.toml"))
    assert result.validation.verdict == "pass"


def test_a_missing_recording_is_named(tmp_path: Path):
    write_arm(tmp_path)
    study = load_study(write_study(tmp_path))
    with pytest.raises(RecordingError, match=r"run1\.csv does not exist") as caught:
        identify(study)
    assert "relative to the folder of the study" in caught.value.remedy


def test_a_missing_robot_is_named(tmp_path: Path):
    study = load_study(write_study(tmp_path))
    with pytest.raises(ArmidError, match=r"small\.urdf"):
        identify(study)


def test_a_copy_of_a_training_file_does_not_validate(tmp_path: Path):
    """By content: another name and another place do not help."""
    train, _ = write_recordings(tmp_path)
    shutil.copy(train, tmp_path / "run2.csv")
    with pytest.raises(StudyError, match=r"run1\.csv and run2\.csv contain the same data .* the other to validate"):
        identify(load_study(write_study(tmp_path)))


PARTS = """
[robot]
description = "small.urdf"
[[recording]]
path = "run1.csv"
part = [0.0, {end}]
[[recording]]
path = "run1.csv"
role = "validate"
part = [0.5, 1.0]
"""


def test_parts_of_one_recording_may_train_and_validate_unless_they_overlap(tmp_path: Path):
    write_recordings(tmp_path)
    with pytest.raises(StudyError, match="contain the same data") as caught:
        identify(load_study(write_study(tmp_path, PARTS.format(end=0.51))))
    assert "part = " in caught.value.remedy
    result = identify(load_study(write_study(tmp_path, PARTS.format(end=0.5))))
    assert result.validation.verdict == "pass"
    assert len(result.validation.recordings) == 1


def test_a_part_keeps_its_rows_and_what_belongs_to_them():
    whole = small_recording(1)
    part = cut_recording(whole, (0.25, 0.5))
    rows = slice(400, 800)
    np.testing.assert_array_equal(part.q, whole.q[rows])
    np.testing.assert_array_equal(part.time, whole.time[rows])  # pyright: ignore[reportOptionalSubscript]
    np.testing.assert_array_equal(part.effort, whole.effort[rows])  # pyright: ignore[reportOptionalSubscript]
    assert part.valid.shape == (400, 3) and part.dq is None and part.sha256 == whole.sha256
    with pytest.raises(StudyError, match=r"part from 0 to 0\.001 of 1600 rows contains only 2"):
        cut_recording(whole, (0.0, 0.001))


def with_own(folder: Path, key: str) -> Estimate:
    """The estimate of two recordings with parameters of their own, which one recording by itself is refused."""
    write_recordings(folder)
    own = STUDY + f"[estimation]\n{key} = true\n"
    with pytest.raises(StudyError, match=f"{key.split()[-1]}` needs at least two training recordings"):
        identify(load_study(write_study(folder, own)))
    return identify(load_study(write_study(folder, own.replace('role = "validate"\n', "")))).estimate


def test_friction_for_each_recording_needs_two(tmp_path: Path):
    estimate = with_own(tmp_path, "friction_per_recording")
    assert {"FV_1[1]", "FV_1[2]", "FO_3[2]", "ZZR_1"} <= set(estimate.fit.names)
    assert not any("[" in name for name in estimate.fit.names if not name.startswith(("FV", "FS", "FO")))
    alone = {each["name"]: each for each in standard_parameters(estimate)}
    values = dict(zip(estimate.fit.names, estimate.fit.values, strict=True))
    assert alone["FV_1"]["status"] == "identified"
    assert alone["FV_1"]["value"] == pytest.approx((values["FV_1[1]"] + values["FV_1[2]"]) / 2)


def test_offsets_for_each_recording_leave_friction_shared(tmp_path: Path):
    names = with_own(tmp_path, "offset_per_recording").fit.names
    assert {"FO_1[1]", "FO_3[2]", "FV_1", "FS_2"} <= set(names)
    assert not any("[" in name for name in names if not name.startswith("FO"))
    every = with_own(tmp_path, "offset_per_recording = true\nfriction_per_recording")  # which has offsets in it
    assert "FV_1[1]" in every.fit.names


def test_friction_that_is_chosen_gives_each_recording_its_offset(tmp_path: Path):
    """And the study that the run keeps says so, so that it can be made again."""
    write_recordings(tmp_path)
    text = STUDY.replace('role = "validate"\n', "")
    result = identify(load_study(write_study(tmp_path, text + '[model]\nterms = "auto"\n')))
    assert result.friction_selection is not None and result.friction_selection.offset_per_recording
    assert result.study.estimation.offset_per_recording and "FO_1[2]" in result.estimate.fit.names


def test_hysteresis_is_judged_on_separate_rows_without_memory(tmp_path: Path):
    """A validation recording that shows no memory costs no identification; a finding says how it is judged."""
    write_recordings(tmp_path)
    motion = small_plan(3).sample(50.0)
    torque = small_model().torque(motion, small_truth())
    order = np.random.default_rng(2).permutation(motion.samples)
    states = {"q": motion.q, "dq": motion.dq, "ddq": motion.ddq, "tau": torque}
    columns = {f"{name}{j + 1}": x[order, j] for name, x in states.items() for j in range(3)}
    np.savez(tmp_path / "mixed.npz", **columns)  # pyright: ignore[reportArgumentType]
    terms = '[model]\nterms = ["rigid-body", "viscous", "coulomb", "hysteresis"]\nhysteresis = { widths = [0.01] }\n'
    mixed = '[[recording]]\npath = "mixed.npz"\nrole = "validate"\nconsecutive = false\n'
    study = load_study(write_study(tmp_path, STUDY + mixed + terms))
    result = identify(study)
    assert (result.validation.recordings[1].relative < WITHOUT_MEMORY).all()
    (finding,) = [each for each in result.estimate.findings if each.code == "judged-without-memory"]
    assert "mixed.npz" in finding.evidence and f"{motion.samples} rows" in finding.evidence
    table = compare_methods(prepare(study), ["ols"])
    assert np.isfinite(table.scores[0].unseen).all()


# The result ----------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The small arm, its recordings and its study."""
    return small_folder(tmp_path_factory)


@pytest.fixture(scope="module")
def result(folder: Path) -> Result:
    return identify(load_study(folder / "study.toml"))


def test_automatic_choices_are_made_in_the_result(folder: Path):
    study = load_study(folder / "study.toml")
    study = replace(study, processing=ProcessingOptions(cutoff="auto"))
    found = identify(study).study
    assert isinstance(found.processing.cutoff, float) and found.processing.cutoff > 0
    assert found.model.terms == ("rigid-body", "viscous", "coulomb", "offset")
    assert found.model.shapes == {"coulomb": {"width": 0.02}}


def test_progress_is_told_in_the_order_of_the_work(folder: Path):
    told: list[tuple[str, float]] = []
    identify(load_study(folder / "study.toml"), progress=lambda stage, share: told.append((stage, share)))
    stages = list(dict.fromkeys(stage for stage, _ in told))
    assert stages == ["robot", "recordings", "processing", "doctor", "information", "estimation", "validation"]
    assert all(0.0 <= share <= 1.0 for _, share in told) and told[-1] == ("validation", 1.0)


def test_findings_on_unseen_recordings_are_kept(tmp_path: Path):
    """A gap in the recording that judges is said, not only one in those that train."""
    write_recordings(tmp_path)
    broken = small_recording(2)
    keep = np.ones(broken.samples, dtype=bool)
    keep[700:800] = False
    assert broken.time is not None and broken.effort is not None
    broken = replace(
        broken, time=broken.time[keep], q=broken.q[keep], effort=broken.effort[keep], valid=broken.valid[keep]
    )
    write_recording(broken, tmp_path / "run2.csv")
    found = identify(load_study(write_study(tmp_path))).estimate.findings
    assert any(finding.code == "clock-gap" for finding in found)
