"""Limit of BLAS to one thread, since an arm's matrices are small and threads would wait for each other."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from functools import cache, wraps
from threading import local
from typing import TYPE_CHECKING, Any, ParamSpec, TypeVar

if TYPE_CHECKING:
    from threadpoolctl import ThreadpoolController

__all__ = ["ONE_THREAD", "one_blas_thread", "prefer_one_thread"]

ONE_THREAD: dict[str, str] = dict.fromkeys(
    ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS"), "1"
)
"""Environment variables that limit the threads of BLAS; read when NumPy is loaded."""

P = ParamSpec("P")
R = TypeVar("R")

_inside = local()


def prefer_one_thread() -> None:
    """Sets the variables for this process before NumPy is loaded; existing values stay."""
    for name, count in ONE_THREAD.items():
        os.environ.setdefault(name, count)


def one_blas_thread(stage: Callable[P, R]) -> Callable[P, R]:
    """Decorator that runs a function with one BLAS thread and restores the caller's number afterwards."""

    @wraps(stage)
    def run(*args: P.args, **kwargs: P.kwargs) -> R:
        if getattr(_inside, "stage", False):  # a stage within a stage has nothing to limit
            return stage(*args, **kwargs)
        _inside.stage = True
        try:
            with _controller("scipy.linalg" in sys.modules).limit(limits=1, user_api="blas"):
                return stage(*args, **kwargs)
        finally:
            _inside.stage = False

    return run


@cache
def _controller(scipy: bool) -> ThreadpoolController:
    """The BLAS libraries of this process; SciPy brings its own when it is loaded, hence the argument."""
    del scipy
    from threadpoolctl import ThreadpoolController

    controller: Any = ThreadpoolController()
    return controller
