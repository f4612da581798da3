"""Estimators, one a file. `ESTIMATORS` is the catalogue: a new estimator is a new file and one line here."""

from typing import ClassVar, Protocol

from armid.estimation.estimators.ols import OrdinaryLeastSquares
from armid.estimation.estimators.wls import WeightedLeastSquares
from armid.estimation.fit import Fit
from armid.estimation.problem import Problem

__all__ = ["ESTIMATORS", "Estimator", "OrdinaryLeastSquares", "WeightedLeastSquares"]


class Estimator(Protocol):
    """A frozen dataclass whose fields are its options.

    Attributes:
        name: Name of the method in a study.
    """

    name: ClassVar[str]

    def estimate(self, problem: Problem) -> Fit:
        """Estimate the base parameters."""
        ...


ESTIMATORS: dict[str, type[Estimator]] = {
    estimator.name: estimator for estimator in (OrdinaryLeastSquares, WeightedLeastSquares)
}
"""Estimators by the name of their method."""
