"""Catalogue `ESTIMATORS` of the methods of estimation: a new method is a new file and one line here."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar, Protocol, runtime_checkable

from armid.catalogue import Catalogue

if TYPE_CHECKING:
    from armid.estimation.fit_result import Fit
    from armid.estimation.problem import EstimationProblem


class Estimator(Protocol):
    """A frozen dataclass whose fields are its options.

    An option `weight` is the weight of a prior in independent samples; where friction is selected and the option is
    `auto`, it is that of the selection.

    Attributes:
        name: Name of the method in a study.
        quick: Whether it takes well under a second, so that it can be repeated with parts of the data left out.
    """

    name: ClassVar[str]
    quick: ClassVar[bool]

    def solve(self, problem: EstimationProblem) -> Fit:
        """Solve for the base parameters, with deviations under white residuals."""
        ...


@runtime_checkable
class EstimatorWithPrior(Protocol):
    """Estimator that finds the weight of a prior from the data."""

    def with_prior_of(self, problem: EstimationProblem, fit: Fit) -> Estimator:
        """The method with the prior fixed to the one that it found.

        Args:
            problem: All of the data.
            fit: The method's estimate from them.
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
