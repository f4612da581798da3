"""Estimators, one a file. `ESTIMATORS` is the catalogue: a new estimator is a new file and one line here."""

from typing import ClassVar, Protocol

from armid.estimation.estimators.essential import EssentialParameters
from armid.estimation.estimators.log_cholesky import LogCholesky
from armid.estimation.estimators.ols import OrdinaryLeastSquares
from armid.estimation.estimators.physical import PhysicallyConsistent
from armid.estimation.estimators.ridge import Ridge
from armid.estimation.estimators.robust import RobustLeastSquares
from armid.estimation.estimators.thesis_nlp import ThesisNLP
from armid.estimation.estimators.wls import WeightedLeastSquares
from armid.estimation.fit import Fit
from armid.estimation.problem import EstimationProblem

__all__ = [
    "ESTIMATORS",
    "EssentialParameters",
    "Estimator",
    "LogCholesky",
    "OrdinaryLeastSquares",
    "PhysicallyConsistent",
    "Ridge",
    "RobustLeastSquares",
    "ThesisNLP",
    "WeightedLeastSquares",
]


class Estimator(Protocol):
    """A frozen dataclass whose fields are its options.

    Attributes:
        name: Name of the method in a study.
        quick: Whether it takes well under a second, so that it can be repeated with parts of the data left out.
    """

    name: ClassVar[str]
    quick: ClassVar[bool]

    def solve(self, problem: EstimationProblem) -> Fit:
        """Solve for the base parameters, with deviations under white residuals."""
        ...


ESTIMATORS: dict[str, type[Estimator]] = {
    estimator.name: estimator
    for estimator in (
        OrdinaryLeastSquares,
        WeightedLeastSquares,
        RobustLeastSquares,
        EssentialParameters,
        Ridge,
        PhysicallyConsistent,
        LogCholesky,
        ThesisNLP,
    )
}
"""Estimators by the name of their method."""
