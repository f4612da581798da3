"""Catalogue `ESTIMATORS` of the estimators: a new estimator is a new file and one line here."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar, Protocol, runtime_checkable

from armid.lazy_catalogue import Catalogue

if TYPE_CHECKING:
    from armid.estimation.fit_result import Fit
    from armid.estimation.problem import EstimationProblem


class Estimator(Protocol):
    """Interface of an estimator: a frozen dataclass whose fields are the options of the estimator.

    An option with the name `weight` is the weight of a prior in independent samples. If `weight` is `auto` and
    friction is selected automatically, the estimator uses the weight that the selection of friction has found.

    Attributes:
        name: Name of the estimator in a study: the value of the key `method`.
        quick: True if the estimator takes well under a second, so that it can be repeated with parts of the data left
            out.
    """

    name: ClassVar[str]
    quick: ClassVar[bool]

    def solve(self, problem: EstimationProblem) -> Fit:
        """Estimates the base parameters, with standard deviations that are valid for white residuals."""
        ...


@runtime_checkable
class EstimatorWithPrior(Protocol):
    """Estimator that finds the weight of a prior from the data."""

    def with_prior_of(self, problem: EstimationProblem, fit: Fit) -> Estimator:
        """Copy of this estimator, with the weight of the prior fixed to the weight that a fit has used.

        Args:
            problem: Estimation problem with all data.
            fit: Fit of this estimator to these data.
        """
        ...


@runtime_checkable
class MultiStartEstimator(Protocol):
    """Estimator that minimises a non-convex cost from several start values."""

    def with_one_start(self) -> Estimator:
        """Copy of this estimator with a single start value, which saves time when estimators are compared."""
        ...


ESTIMATORS: Catalogue[type[Estimator]] = Catalogue(
    {
        "ols": "armid.estimation.estimators.ols:OrdinaryLeastSquares",
        "wls": "armid.estimation.estimators.wls:WeightedLeastSquares",
        "robust": "armid.estimation.estimators.robust:RobustLeastSquares",
        "essential": "armid.estimation.estimators.essential:EssentialParameters",
        "ridge": "armid.estimation.estimators.ridge:Ridge",
        "physical": "armid.estimation.estimators.physical:PhysicallyConsistent",
        "log-cholesky": "armid.estimation.estimators.log_cholesky:LogCholesky",
        "thesis-nlp": "armid.estimation.estimators.thesis_nlp:ThesisNLP",
    }
)
"""Estimators; the keys are the values that the key `method` of a study accepts."""
