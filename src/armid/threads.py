"""Settings of the process: one thread for BLAS, and reuse of freed memory for the next array; work done ahead.

The matrices of an arm are small, so several threads of BLAS would mostly wait for each other.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import cache, wraps
from threading import local
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, ParamSpec, TypeVar

if TYPE_CHECKING:
    from threadpoolctl import ThreadpoolController

ONE_THREAD: dict[str, str] = dict.fromkeys(
    ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS"), "1"
)
"""Environment variables that limit the number of BLAS threads; BLAS reads them when NumPy is imported."""

MAPPED, KEPT = 32 << 20, 256 << 20
"""Size from which the system allocates the memory of an array separately, and size of freed memory that is kept
[bytes]."""

MALLOPT_TRIM, MALLOPT_MAP = -1, -3
"""Numbers of the settings `M_TRIM_THRESHOLD` and `M_MMAP_THRESHOLD` in the GNU C library."""

P = ParamSpec("P")
R = TypeVar("R")
T = TypeVar("T")

_inside = local()
_process = SimpleNamespace(limited=False)


def prefer_one_thread() -> None:
    """Sets the variables of `ONE_THREAD` for this process before NumPy is imported; keeps existing values."""
    for name, count in ONE_THREAD.items():
        os.environ.setdefault(name, count)
    _process.limited = "numpy" not in sys.modules and all(os.environ[name] == "1" for name in ONE_THREAD)


def keep_freed_memory() -> None:
    """Lets the GNU C library keep freed memory in this process; it has no effect with other libraries.

    By default the library returns the memory of large arrays at once, and the system clears each page when it is used
    again, which takes a sixth of the CPU time of an identification.
    """
    if sys.platform != "linux":
        return
    import ctypes

    with suppress(AttributeError, OSError):  # another C library
        library = ctypes.CDLL(None)
        library.mallopt(MALLOPT_TRIM, KEPT)
        library.mallopt(MALLOPT_MAP, MAPPED)


def one_blas_thread(stage: Callable[P, R]) -> Callable[P, R]:
    """Decorator that runs a function with one BLAS thread and restores the number of threads afterwards."""

    @wraps(stage)
    def run(*args: P.args, **kwargs: P.kwargs) -> R:
        if _process.limited or getattr(_inside, "stage", False):  # nothing is left to limit
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
    """Controller of the BLAS libraries of this process, cached separately for processes with and without SciPy.

    SciPy loads a BLAS library of its own, so the controller must be made again after SciPy was imported.
    """
    del scipy
    from threadpoolctl import ThreadpoolController

    controller: Any = ThreadpoolController()
    return controller


def ahead(items: Iterator[T]) -> Iterator[T]:
    """Yields the items of an iterator, each of which another thread makes while the one before it is used.

    An error of the iterator is raised where its item is asked for.
    """
    import contextvars
    from concurrent.futures import ThreadPoolExecutor

    end = object()
    with ThreadPoolExecutor(1) as pool:
        # The limits of input belong to the context of the caller.
        following = pool.submit(contextvars.copy_context().run, next, items, end)
        while (item := following.result()) is not end:
            following = pool.submit(contextvars.copy_context().run, next, items, end)
            yield item  # pyright: ignore[reportReturnType]


def meanwhile(work: Callable[[], R]) -> Callable[[], R]:
    """Begins some work in another thread, and returns a function that waits for its result.

    If nobody waits, the work does not keep the process from ending.
    """
    import contextvars
    from concurrent.futures import Future
    from threading import Thread

    future: Future[R] = Future()
    context = contextvars.copy_context()

    def run() -> None:
        try:
            future.set_result(context.run(work))
        except BaseException as error:
            future.set_exception(error)

    Thread(target=run, daemon=True).start()
    return future.result
