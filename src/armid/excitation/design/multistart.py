"""The search: many starts, shared among processes, the same for a seed whatever their number, stopped at any time.

Work comes in rounds. A round scouts from a few starts, some of them uniform random coefficients as in the thesis and,
from the second round on, some of them the best plan so far, shaken; the best two scouts are then refined. What a
round does follows from the seed and from the rounds before it alone, so processes and their haste decide only how
many rounds fit into the time.
"""

from __future__ import annotations

import multiprocessing
import os
import pickle
import signal
import time
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ProcessPoolExecutor, wait
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache
from multiprocessing.context import BaseContext
from pathlib import Path

import numpy as np

from armid.errors import ArmidError
from armid.excitation.collision.distances import Clearance
from armid.excitation.design.interior_point import descend_inside
from armid.excitation.design.objective import Objective
from armid.excitation.design.sqp import (
    STAGES,
    DescentProblem,
    descend,
    from_pose,
    max_utilisation,
    shrink_to_feasible,
    utilisation,
)
from armid.excitation.limits.workspace import Workspace
from armid.threads import ONE_THREAD
from armid.values import Array

__all__ = ["Progress", "Search", "SearchCandidate", "search", "single_threaded_pool"]

SCOUTS, REFINED = 6, 2
"""Starts of a round, and how many of them are worth the sharp stages: the value after the smooth ones tells most of
the final one."""

SMOOTH = 2
"""Stages that a scout runs."""

UNIFORM = 1.5
"""Coefficients of random starts lie in ± this, as in the thesis; they are scaled into the limits afterwards."""

SHAKES = (0.1, 0.3, 0.8)
"""Root mean square of what is added to the best plan, over the plan's own."""

FIRST_SCALE = 0.95
"""Random starts begin at this share of their limits."""

Progress = Callable[["SearchCandidate", float, int], None]
"""Told the best plan so far, the seconds gone, and how many descents are done."""


@dataclass(frozen=True, eq=False, slots=True)
class SearchCandidate:
    """A plan that keeps every limit on the grid of the search.

    Attributes:
        x: Unknowns, shape (n k,).
        value: The criterion, without smoothing.
        round: When it was found.
        kind: How: `random`, `shaken` or `given`.
    """

    x: Array
    value: float
    round: int
    kind: str


@dataclass(frozen=True, eq=False, slots=True)
class Search:
    """Result of a search.

    Attributes:
        best: The best plan.
        rounds: Whole rounds done.
        descents: Descents done.
        seconds: Wall time.
        interrupted: Whether somebody stopped it.
        history: Seconds, and value of the best so far, at the start and after each descent.
    """

    best: SearchCandidate
    rounds: int
    descents: int
    seconds: float
    interrupted: bool
    history: tuple[tuple[float, float], ...]


@dataclass(frozen=True, eq=False, slots=True)
class _Task:
    """One descent."""

    round: int
    number: int
    kind: str
    x: Array | None
    seed: tuple[int, ...]
    refine: bool
    deadline: float


@dataclass(frozen=True, eq=False, slots=True)
class _Outcome:
    """End of a descent: where it came to, that drawn together into the limits, the criterion there, if it began."""

    task: _Task
    reached: Array | None = None
    inside: Array | None = None
    value: float = np.inf
    begun: bool = True


@lru_cache(maxsize=4)
def _problem(pickled: bytes) -> tuple[DescentProblem, Objective]:
    """The problem as it came, and the grid that candidates are compared on."""
    problem: DescentProblem = pickle.loads(pickled)
    return problem, problem.fine


def random_start(problem: DescentProblem, grid: Objective, rng: np.random.Generator) -> Array:
    """Uniform random coefficients at rest at the start pose, each joint scaled to its own limits."""
    basis = problem.basis
    c = rng.uniform(-UNIFORM, UNIFORM, (basis.n, 2 * basis.harmonics + 1))
    c[:, -1] = basis.start
    x = basis.project(c).reshape(basis.n, -1)
    by_name = {name: j for j, name in enumerate(problem.goal.model.robot.joint_names)}
    share = np.zeros(basis.n)
    for channel, u in zip(problem.channels, utilisation(problem, grid, x.ravel()), strict=True):
        for label, peak in zip(channel.labels, u.max(axis=0), strict=True):
            if label in by_name:
                share[by_name[label]] = max(share[by_name[label]], peak)
    x *= (FIRST_SCALE / np.where(share > 0.0, share, FIRST_SCALE))[:, None]
    inside = shrink_to_feasible(problem, grid, x.ravel())
    if inside is None and basis.free:  # random coefficients may begin in a pose that is none
        inside = shrink_to_feasible(problem, grid, from_pose(basis, x.ravel()))
    return x.ravel() if inside is None else inside


def _run(pickled: bytes, task: _Task) -> _Outcome:
    """One descent, in whatever process; nothing where it has not come inside the limits, or begins too late."""
    if time.time() > task.deadline:
        return _Outcome(task, begun=False)
    problem, grid = _problem(pickled)
    rng = np.random.default_rng(task.seed)
    if task.x is None:
        x = random_start(problem, grid, rng)
    elif task.refine:
        x = task.x
    else:
        size = SHAKES[task.number % len(SHAKES)] * float(np.sqrt(np.mean(task.x**2)))
        x = task.x + size * rng.standard_normal(len(task.x))
    stages = STAGES[SMOOTH:] if task.refine else STAGES[:SMOOTH]
    if not task.refine and any(isinstance(channel, Clearance | Workspace) for channel in problem.channels):
        # What bodies leave free is bent: the first stage stays inside it.
        x, stages = descend_inside(problem, x, stages[0], task.deadline), stages[1:]
    x = descend(problem, x, stages, task.deadline)
    inside = shrink_to_feasible(problem, grid, x)
    return _Outcome(task) if inside is None else _Outcome(task, x, inside, grid.value(inside))


def _ignore_interrupts() -> None:
    """In a worker: Ctrl-C is for the process that waits."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def _context() -> BaseContext:
    """Choose how processes are made: by fork where nothing else runs here, which takes milliseconds; else anew."""
    tasks = Path("/proc/self/task")
    alone = tasks.is_dir() and len(list(tasks.iterdir())) == 1
    return multiprocessing.get_context("fork" if alone else "spawn")


@contextmanager
def single_threaded_pool(workers: int) -> Generator[Executor]:
    """Processes whose BLAS has one thread each: matrices here are small, and threads would wait for one another.

    A process that was itself started with `OPENBLAS_NUM_THREADS=1` forks its workers and loses no time.

    Args:
        workers: How many processes.
    """
    before = {name: os.environ.get(name) for name in ONE_THREAD}
    os.environ.update(ONE_THREAD)
    others = set(multiprocessing.active_children())
    pool = ProcessPoolExecutor(workers, _context(), initializer=_ignore_interrupts)
    try:
        for future in [pool.submit(time.sleep, 0.0) for _ in range(workers)]:
            future.result()
        for name, value in before.items():
            if value is None:
                os.environ.pop(name)
            else:
                os.environ[name] = value
        yield pool
    finally:
        # Nobody waits for what they are still at: a search has gathered what it wants, or was stopped by hand.
        pool.shutdown(wait=False, cancel_futures=True)
        for process in set(multiprocessing.active_children()) - others:
            process.terminate()
            process.join()


class _Round:
    """The tasks of one round, first the scouts, then the refinement of the best of them."""

    def __init__(self, number: int, seed: int, best: SearchCandidate | None, deadline: float) -> None:
        self.number = number
        shaken = 0 if best is None or best.kind == "start" else SCOUTS // 2
        self.scouts = [
            _Task(
                number,
                k,
                "shaken" if k < shaken else "random",
                best.x if best is not None and k < shaken else None,
                (seed, number, k),
                refine=False,
                deadline=deadline,
            )
            for k in range(SCOUTS)
        ]
        self._seed, self._deadline = seed, deadline

    def refinements(self, found: Sequence[_Outcome]) -> list[_Task]:
        """The best scouts, once more; in the order of their numbers where values are equal."""
        good = [(o.value, o.task.number, o.reached, o.task.kind) for o in found if o.reached is not None]
        good.sort(key=lambda each: each[:2])
        return [
            _Task(self.number, SCOUTS + k, kind, x, (self._seed, self.number, SCOUTS + k), True, self._deadline)
            for k, (_, _, x, kind) in enumerate(good[:REFINED])
        ]


class _Board:
    """The best so far, and who is told of it."""

    def __init__(self, problem: DescentProblem, progress: Progress | None, began: float) -> None:
        self.pickled = pickle.dumps(problem)
        self.problem, self.grid = _problem(self.pickled)
        self.best: SearchCandidate | None = None
        self.descents = 0
        self.history: list[tuple[float, float]] = []
        self._progress, self._began = progress, began

    def offer(self, x: Array, value: float, number: int, kind: str) -> None:
        """A plan inside the limits; kept where it is better."""
        if self.best is None or value < self.best.value:
            self.best = SearchCandidate(x, value, number, kind)
        if self._progress is not None:
            self._progress(self.best, time.time() - self._began, self.descents)

    def take(self, outcome: _Outcome) -> None:
        """The outcome of a descent."""
        self.descents += outcome.begun
        if outcome.inside is not None:
            self.offer(outcome.inside, outcome.value, outcome.task.round, outcome.task.kind)
        if outcome.begun:
            self.note()

    def note(self) -> None:
        """Write down how far the search has come."""
        assert self.best is not None  # the start is there before any descent
        self.history.append((time.time() - self._began, self.best.value))


def search(
    problem: DescentProblem,
    *,
    seed: int = 1,
    budget: float | None = 30.0,
    rounds: int | None = None,
    executor: Executor | None = None,
    given: Sequence[Array] = (),
    progress: Progress | None = None,
) -> Search:
    """Look for the best plan.

    Args:
        problem: What is asked.
        seed: Of random starts and shakes.
        budget: Wall time [s]; `None` for no end other than `rounds`.
        rounds: Whole rounds at most; a search that ends by them gives the same plan on any machine of a kind.
        executor: Runs the descents; in this process where left out.
        given: Plans to begin with.
        progress: Told of every descent.

    Raises:
        ArmidError: No time, or not even standing still keeps the limits.
    """
    if (budget is not None and not budget > 0.0) or (rounds is not None and rounds < 1):
        raise ArmidError(
            f"A search needs time: found a budget of {budget} s and {rounds} rounds.",
            remedy="give some seconds; ten are enough for a good plan of a seven-joint arm.",
        )
    began = time.time()
    deadline = np.inf if budget is None else began + budget
    board = _Board(problem, progress, began)
    first = random_start(board.problem, board.grid, np.random.default_rng((seed, 0, 0)))
    if max_utilisation(board.problem, board.grid, first) > 1.0 + 1e-6:
        raise ArmidError("Not even standing still at the start pose keeps the limits.", remedy=_blame(board, first))
    board.offer(first, board.grid.value(first), 0, "start")
    for x in given:
        inside = shrink_to_feasible(board.problem, board.grid, x)
        if inside is not None:
            board.offer(inside, board.grid.value(inside), 0, "given")
    board.note()
    done, interrupted = 0, False
    try:
        while (rounds is None or done < rounds) and time.time() < deadline:
            current = _Round(done, seed, board.best, deadline)
            found = _gather(board, current.scouts, executor)
            _gather(board, current.refinements(found), executor)
            done += time.time() < deadline
    except KeyboardInterrupt:
        interrupted = True
    assert board.best is not None
    return Search(board.best, done, board.descents, time.time() - began, interrupted, tuple(board.history))


def _gather(board: _Board, tasks: Sequence[_Task], executor: Executor | None) -> list[_Outcome]:
    """Run tasks; the board learns of each as it ends, but in the order of their numbers where there is a choice."""
    results: list[_Outcome] = []
    if executor is None:
        for task in tasks:
            results.append(_run(board.pickled, task))
            board.take(results[-1])
    else:
        waiting: set[Future[_Outcome]] = {executor.submit(_run, board.pickled, task) for task in tasks}
        try:
            while waiting:
                ready, waiting = wait(waiting, return_when=FIRST_COMPLETED)
                for outcome in sorted((future.result() for future in ready), key=lambda each: each.task.number):
                    results.append(outcome)
                    board.take(outcome)
        finally:
            for future in waiting:
                future.cancel()
    return results


def _blame(board: _Board, x: Array) -> str:
    """Tell which limit to relax, and where."""
    worst = max(
        (
            (float(u[:, k].max()), channel.name, label)
            for channel, u in zip(
                board.problem.channels, utilisation(board.problem, board.grid, 0.0 * x), strict=True
            )
            for k, label in enumerate(channel.labels)
        ),
        default=(0.0, "", ""),
    )
    return f"relax {worst[1]} of {worst[2]} ({100 * worst[0]:.0f} % of its limit), or choose another start pose."
