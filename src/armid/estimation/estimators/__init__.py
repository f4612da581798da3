"""Estimators. Each module contains one estimator; `armid.estimation.catalogue` lists them.

This package also exports the classes, for code that uses one of them by name. A new estimator needs no line here.
"""

from armid.estimation.estimators.essential import EssentialParameters
from armid.estimation.estimators.log_cholesky import LogCholesky
from armid.estimation.estimators.ols import OrdinaryLeastSquares
from armid.estimation.estimators.physical import PhysicallyConsistent
from armid.estimation.estimators.ridge import Ridge
from armid.estimation.estimators.robust import RobustLeastSquares
from armid.estimation.estimators.thesis_nlp import ThesisNLP
from armid.estimation.estimators.wls import WeightedLeastSquares

__all__ = [
    "EssentialParameters",
    "LogCholesky",
    "OrdinaryLeastSquares",
    "PhysicallyConsistent",
    "Ridge",
    "RobustLeastSquares",
    "ThesisNLP",
    "WeightedLeastSquares",
]
