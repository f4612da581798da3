"""Catalogue `ESTIMATORS` of the methods of estimation: a new method is a new file and one line here."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar, Protocol, runtime_checkable

from armid.lazy_catalogue import Catalogue

if TYPE_CHECKING:
    from armid.estimation.fit_result import Fit
    from armid.estimation.problem import EstimationProblem


class Estimator(Protocol):
    """Method of estimation: a frozen dataclass whose fields are the options of the method.

    An option `weight` is the weight of a prior in independent samples. If friction is selected and the option is
    `auto`, the weight of the selection is used.

    Attributes:
        name: Name of the method in a study.
        quick: True if the method takes well under a second, so that it can be repeated without parts of the data.
    """

    name: ClassVar[str]
    quick: ClassVar[bool]

    def solve(self, problem: EstimationProblem) -> Fit:
        """Estimates the base parameters, with standard deviations for white residuals."""
        ...


@runtime_checkable
class EstimatorWithPrior(Protocol):
    """Estimator that finds the weight of a prior from the data."""

    def with_prior_of(self, problem: EstimationProblem, fit: Fit) -> Estimator:
        """The method with its prior fixed to the prior of a fit.

        Args:
            problem: Estimation problem with all data.
            fit: Fit of the method to these data.
        """
        ...


@runtime_checkable
class MultiStartEstimator(Protocol):
    """Estimator that searches from several starts."""

    def with_one_start(self) -> Estimator:
        """The method with a single start, for a comparison of methods."""
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
"""Estimators by the name of their method."""
