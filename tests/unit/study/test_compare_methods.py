"""The comparison of methods: each row is what the method gives by itself, and failures are rows too."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest

from armid.errors import EstimationError
from armid.estimation.catalogue import ESTIMATORS
from armid.estimation.crossvalidation import folds, training_information
from armid.estimation.estimators import WeightedLeastSquares
from armid.estimation.fit_result import Fit
from armid.estimation.friction.selection import FrictionSelection, SelectionEvidence
from armid.estimation.problem import EstimationProblem
from armid.information.accumulate import accumulate_information
from armid.information.information import select
from armid.runs.run import save_run
from armid.study import compare_methods as module
from armid.study.compare_methods import compare_methods, compare_record
from armid.study.config import parse_study
from armid.study.identify import conclude
from armid.study.prepare import Prepared, prepare
from armid.study.recordings import left_out
from armid.study.storage.records import to_json
from labs import STUDY, small_recording, write_arm

GIVEN = {"run1.csv": small_recording(1), "run2.csv": small_recording(2)}

QUICK = ("ols", "wls", "robust", "essential", "ridge")


@cache
def folder() -> str:
    import tempfile

    path = Path(tempfile.mkdtemp())
    write_arm(path)
    return str(path)


@cache
def prepared(validated: bool = True, apart: bool = False) -> Prepared:
    """The small arm's study; with all recordings to train, friction for each of them on request."""
    import tomllib

    table: dict[str, Any] = tomllib.loads(STUDY)
    if not validated:
        del table["recording"][1]["role"]
    if apart:
        table["estimation"] = {"friction_per_recording": True}
    return prepare(parse_study(table, folder()), given=GIVEN)


def with_options(options: Mapping[str, Mapping[str, Any]]) -> Prepared:
    study = prepared().study
    return replace(prepared(), study=replace(study, estimation=replace(study.estimation, options=options)))


def test_every_method_has_a_row_with_numbers():
    table = compare_methods(prepared())
    assert tuple(score.method for score in table.scores) == tuple(ESTIMATORS)
    assert table.joints == ("joint_1", "joint_2", "joint_3") and table.unseen == "validation"
    for score in table.scores:
        assert not score.failure, score.failure
        assert score.training.shape == score.unseen.shape == (3,)
        assert np.isfinite([*score.training, *score.unseen, score.seconds]).all()
        assert score.consistent is not None and score.distance >= 0.0


def test_a_row_is_what_the_run_says():
    result = conclude(prepared())
    (row,) = compare_methods(prepared(), ("wls",)).scores
    np.testing.assert_array_equal(row.training, result.estimate.fit.residual_rms)
    # There the torque is filtered at full rate, here it is decimated together with the columns.
    np.testing.assert_allclose(row.unseen, result.validation.recordings[0].rms, rtol=0.005)


def test_the_values_of_each_method_are_kept():
    given = prepared()
    table = compare_methods(given, ("wls", "physical", "thesis-nlp"))
    assert table.names == given.base.names and [each.method for each in table.estimates] == [
        "wls", "physical", "thesis-nlp",
    ]  # fmt: skip
    wls, physical, _ = table.estimates
    np.testing.assert_array_equal(wls.base, conclude(given).estimate.fit.values)
    assert wls.bodies is None and physical.bodies is not None and physical.bodies.shape == (3, 10)
    assert (physical.bodies[:, 0] > 0.0).all()
    # The bodies and the base parameters are one estimate: masses and moments of the links give the base parameters.
    error = np.linalg.norm(physical.base - wls.base) / np.linalg.norm(wls.base)
    assert 0.0 < error < 0.05  # both are near the truth, and the constraints and the prior move the values


def test_without_validation_every_fold_is_left_out_once():
    given = prepared(validated=False)
    table = compare_methods(given, ("wls", "robust"))
    assert table.unseen == "cross-validation"
    information = given.problem.information
    fold = folds(information)
    squares = np.zeros(3)
    for k in np.unique(fold):
        trains = (fold != k) & ~training_information(information, fold == k)
        values = WeightedLeastSquares().solve(EstimationProblem(select(information, trains))).values
        for j, joint in enumerate(information.joints):
            R = joint.R[fold == k]
            squares[j] += np.sum((R[:, :, -1] - R[:, :, :-1] @ values[joint.parameters]) ** 2)
    expected = np.sqrt(squares / information.rows.sum(axis=0))
    np.testing.assert_allclose(table.scores[0].unseen, expected, rtol=1e-9)
    np.testing.assert_allclose(table.scores[1].unseen, expected, rtol=0.05)  # the noise is normal


def test_what_is_repeated_does_not_hang_on_the_clock(monkeypatch: pytest.MonkeyPatch):
    seconds = iter(np.arange(100.0) * 1000.0)
    monkeypatch.setattr(module.time, "perf_counter", lambda: next(seconds))
    table = compare_methods(prepared(validated=False), ("wls", "ridge", "thesis-nlp"))
    assert [bool(np.isfinite(each.unseen).all()) for each in table.scores] == [True, True, False]
    assert "would take too long" in table.scores[-1].failure


@pytest.mark.parametrize(
    ("method", "option"), [("ridge", {"towards": "nominal"}), ("physical", {"prior": "log-det"})]
)
def test_folds_use_the_weight_of_the_prior_found_on_all(
    monkeypatch: pytest.MonkeyPatch, method: str, option: dict[str, Any]
):
    given = prepared(validated=False)
    study = replace(given.study, estimation=replace(given.study.estimation, options={method: option}))
    kind, weights = ESTIMATORS[method], []
    estimate = kind.solve

    def told(self: Any, problem: EstimationProblem) -> Fit:
        weights.append(self.weight)
        return estimate(self, problem)

    monkeypatch.setattr(kind, "solve", told)
    (row,) = compare_methods(replace(given, study=study), (method,)).scores
    assert np.isfinite(row.unseen).all()
    assert weights[0] == "auto" and len(weights) > 2 and len(set(weights[1:])) == 1 and weights[1] > 0.0


def test_friction_chosen_on_all_training_data_leaves_nothing_unseen():
    given = prepared(validated=False)
    ones = np.ones(3)
    trial = SelectionEvidence("joint_1", "ripple", "ripple 2", 1.0, 0.1, False)
    ladder = FrictionSelection(given.model, (), (trial,), ones, 0.0 * ones, 1.0)
    table = compare_methods(replace(given, friction_selection=ladder), ("wls",))
    assert table.unseen == "none" and "use one recording for validation only" in table.note
    assert np.isnan(table.scores[0].unseen).all() and not table.scores[0].failure
    unjudged = compare_methods(replace(given, friction_selection=replace(ladder, evidence=())), ("wls",))
    assert unjudged.unseen == "cross-validation"
    seen = compare_methods(replace(prepared(), friction_selection=ladder), ("wls",))
    assert seen.unseen == "validation" and np.isfinite(seen.scores[0].unseen).all()


def test_samples_of_a_fold_left_out_stay_out():
    problem = prepared(validated=False).problem
    assert problem.observations is not None and problem.model is not None and problem.base is not None
    out = folds(problem.information) == 0
    rest = left_out._without(problem, out)  # pyright: ignore[reportPrivateUsage]
    assert rest.observations is not None
    again = accumulate_information(problem.model, problem.base, rest.observations)
    np.testing.assert_array_equal(again.rows.sum(axis=0), problem.information.rows[~out].sum(axis=0))
    np.testing.assert_array_equal(again.rows[~out], rest.information.rows)


def test_friction_of_each_recording_is_compared_too():
    table = compare_methods(prepared(validated=False, apart=True), QUICK)
    assert all(np.isfinite(score.training).all() for score in table.scores)


def test_options_of_the_study_count():
    plain, strict = (
        compare_methods(each, ("essential",)).scores[0]
        for each in (prepared(), with_options({"essential": {"ratio": 2.0, "price": 0.5}}))
    )
    assert strict.dropped > plain.dropped and strict.training.sum() > plain.training.sum()


@dataclass(frozen=True, slots=True)
class Broken:
    """A method that has no answer."""

    kind: str = "refuses"
    name: ClassVar[str] = "broken"
    quick: ClassVar[bool] = True

    def solve(self, problem: EstimationProblem) -> Fit:
        """Never an estimate of parts of the data, and of all of it only on request."""
        if self.kind == "breaks":
            raise np.linalg.LinAlgError("Singular matrix")
        if self.kind == "needs all" and problem.information.blocks == prepared(False).problem.information.blocks:
            return WeightedLeastSquares().solve(problem)
        raise EstimationError("There is no answer.")


@pytest.mark.parametrize(("kind", "reason"), [("refuses", "There is no answer."), ("breaks", "Singular matrix")])
def test_a_method_that_fails_is_a_row_with_its_reason(kind: str, reason: str):
    with ESTIMATORS.extended({"broken": Broken}):
        table = compare_methods(with_options({"broken": {"kind": kind}}), ("broken", "ols"))
    broken, ols = table.scores
    assert broken.failure == reason and not np.isfinite(broken.training).any() and broken.consistent is None
    assert not ols.failure and np.isfinite(ols.unseen).all()
    record = json.loads(to_json(compare_record(table)))
    assert record["methods"][0]["training_rms"] == [None] * 3 and record["methods"][0]["failure"] == reason
    assert record["methods"][1]["failure"] is None


def test_a_method_that_fails_without_a_fold_keeps_its_row():
    given = prepared(validated=False)
    estimation = replace(given.study.estimation, options={"broken": {"kind": "needs all"}})
    study = replace(given.study, estimation=estimation)
    with ESTIMATORS.extended({"broken": Broken}):
        (row,) = compare_methods(replace(given, study=study), ("broken",)).scores
    assert row.failure == "There is no answer." and row.consistent is not None
    assert np.isfinite(row.training).all() and not np.isfinite(row.unseen).any()


def test_the_record_stands_beside_the_run(tmp_path: Path):
    given = prepared()
    record = compare_record(compare_methods(given, QUICK))
    saved = save_run(conclude(given), tmp_path / "run", further_records={"compare.json": record})
    found = json.loads((saved / "compare.json").read_text(encoding="utf-8"))
    assert [each["name"] for each in found["methods"]] == list(QUICK)
    for each in found["methods"]:
        assert each["training_total"] == pytest.approx(np.linalg.norm(each["training_rms"]))
        assert each["unseen_total"] == pytest.approx(np.linalg.norm(each["unseen_rms"]))
        assert isinstance(each["consistent"], bool)
