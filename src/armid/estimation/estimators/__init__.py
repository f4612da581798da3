"""Estimators. Each module contains one estimator; `armid.estimation.catalogue` lists them.

The classes of the estimators can also be imported from this package; a class is loaded when it is first used.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from armid.estimation.estimators.essential import EssentialParameters
    from armid.estimation.estimators.log_cholesky import LogCholesky
    from armid.estimation.estimators.ols import OrdinaryLeastSquares
    from armid.estimation.estimators.physical import PhysicallyConsistent
    from armid.estimation.estimators.ridge import Ridge
    from armid.estimation.estimators.robust import RobustLeastSquares
    from armid.estimation.estimators.thesis_nlp import ThesisNLP
    from armid.estimation.estimators.wls import WeightedLeastSquares

_HOMES = {
    "EssentialParameters": "essential",
    "LogCholesky": "log_cholesky",
    "OrdinaryLeastSquares": "ols",
    "PhysicallyConsistent": "physical",
    "Ridge": "ridge",
    "RobustLeastSquares": "robust",
    "ThesisNLP": "thesis_nlp",
    "WeightedLeastSquares": "wls",
}

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


def __getattr__(name: str) -> Any:
    """Loads the class of an estimator from its module."""
    if name in _HOMES:
        return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
