"""Multi-start search for the best excitation, parallel in several processes and reproducible for a given seed.

The search works in rounds. In each round, first short descents are run from a few starting points. Some starting
points are uniform random coefficients, as in the thesis. From the second round on, others are random perturbations of
the best plan so far. The best two results are then refined. A round depends only on the seed and on the rounds before
it. Therefore the number and the speed of the processes affect only the number of rounds that are finished in a given
time, and not the result of a round. A search can be stopped at any time.
"""

from __future__ import annotations

import multiprocessing
import os
import pickle
import time
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ProcessPoolExecutor, wait
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache
from multiprocessing.context import BaseContext
from pathlib import Path

import numpy as np

from armid.checked_array import Array
from armid.errors import ArmidError
from armid.excitation.collision.distances import Clearance
from armid.excitation.design.configuration_space_obstacles import MeasuredPairs
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
from armid.excitation.limits.constraint_channels import States
from armid.excitation.limits.workspace import Workspace
from armid.output.worker_process import follow_parent
from armid.threads import ONE_THREAD

SCOUTS, REFINED = 6, 2
"""Number of short descents in each round of the search, and number of their results that are refined in the sharper
stages of the descent. The criterion after the smooth stages predicts the final criterion well."""

SMOOTH = 2
"""Number of stages in a short descent: the first stages of `STAGES`."""

AMPLITUDE = 1.5
"""Bound of the uniform random coefficients of a starting point [rad/s or m/s], as in the thesis. The series is then
scaled so that it keeps the limits."""

PERTURBATIONS = (0.1, 0.3, 0.8)
"""RMS of the perturbations of the best plan's unknowns, divided by the RMS of these unknowns."""

START_UTILISATION = 0.95
"""Utilisation of the limits to which each joint of a random starting point is scaled."""

Progress = Callable[["SearchCandidate", float, int], None]
"""Function that reports progress: best plan so far, elapsed time [s] and number of finished descents."""


TINY = 1e-4
"""Deviation of the unknowns of a very small motion [rad/s or m/s]; a limit that it violates excludes any motion."""


@dataclass(frozen=True, eq=False, slots=True)
class SearchCandidate:
    """Plan that keeps every limit on the grid of the search.

    Attributes:
        x: Unknowns of the plan, shape (n k,).
        value: Value of the criterion, computed without smoothing.
        round: Number of the round in which the plan was found.
        kind: Kind of the starting point of the descent: `start`, `random`, `shaken` (a perturbed plan) or `given`.
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
        rounds: Number of completed rounds.
        descents: Number of descents done.
        seconds: Wall time of the search [s].
        interrupted: True if the user stopped the search.
        history: Elapsed time [s] and value of the best plan so far, at the start and after each descent.
    """

    best: SearchCandidate
    rounds: int
    descents: int
    seconds: float
    interrupted: bool
    history: tuple[tuple[float, float], ...]


@dataclass(frozen=True, eq=False, slots=True)
class _Task:
    """Input of one descent."""

    round: int
    number: int
    kind: str
    x: Array | None
    seed: tuple[int, ...]
    refine: bool
    deadline: float


@dataclass(frozen=True, eq=False, slots=True)
class _Outcome:
    """Result of one descent.

    Attributes:
        task: Input of the descent.
        reached: Unknowns at the end of the descent; `None` if they cannot be scaled to keep the limits.
        inside: Unknowns after scaling about the start pose, so that the plan keeps the limits.
        value: Criterion at `inside`.
        begun: True if the descent began before the deadline.
    """

    task: _Task
    reached: Array | None = None
    inside: Array | None = None
    value: float = np.inf
    begun: bool = True


@lru_cache(maxsize=4)
def _problem(pickled: bytes) -> tuple[DescentProblem, Objective]:
    """Unpickles an optimisation problem, and returns it with the grid on which plans are compared; cached."""
    problem: DescentProblem = pickle.loads(pickled)
    return problem, problem.fine


def random_start(problem: DescentProblem, grid: Objective, rng: np.random.Generator) -> Array:
    """Unknowns (n k,) of a random series that starts at rest; the amplitude of each joint is scaled to its limits."""
    basis = problem.basis
    c = rng.uniform(-AMPLITUDE, AMPLITUDE, (basis.n, 2 * basis.harmonics + 1))
    c[:, -1] = basis.start
    x = basis.project(c).reshape(basis.n, -1)
    by_name = {name: j for j, name in enumerate(problem.goal.model.robot.joint_names)}
    share = np.zeros(basis.n)
    states = States(grid, x.ravel())
    for channel in problem.channels:
        if not set(channel.labels) & set(by_name):  # distances of bodies are no limits of single joints
            continue
        for label, peak in zip(channel.labels, channel.values(states).max(axis=0), strict=True):
            if label in by_name:
                share[by_name[label]] = max(share[by_name[label]], peak)
    x *= (START_UTILISATION / np.where(share > 0.0, share, START_UTILISATION))[:, None]
    inside = shrink_to_feasible(problem, grid, x.ravel())
    if inside is None and basis.free:  # random coefficients may begin in an infeasible pose
        inside = shrink_to_feasible(problem, grid, from_pose(basis, x.ravel()))
    return x.ravel() if inside is None else inside


def _run(pickled: bytes, task: _Task) -> _Outcome:
    """Runs one descent; the outcome has no plan if no scaled motion keeps the limits or the deadline has passed."""
    if time.time() > task.deadline:
        return _Outcome(task, begun=False)
    problem, grid = _problem(pickled)
    rng = np.random.default_rng(task.seed)
    if task.x is None:
        x = random_start(problem, grid, rng)
        if time.time() > task.deadline:
            return _Outcome(task)
    elif task.refine:
        x = task.x
    else:
        size = PERTURBATIONS[task.number % len(PERTURBATIONS)] * float(np.sqrt(np.mean(task.x**2)))
        x = task.x + size * rng.standard_normal(len(task.x))
    stages = STAGES[SMOOTH:] if task.refine else STAGES[:SMOOTH]
    if not task.refine and any(
        isinstance(channel, Clearance | MeasuredPairs | Workspace) for channel in problem.channels
    ):
        # The collision-free set is not convex: the first stage stays inside it.
        x, stages = descend_inside(problem, x, stages[0], task.deadline), stages[1:]
    x = descend(problem, x, stages, task.deadline)
    inside = shrink_to_feasible(problem, grid, x)
    return _Outcome(task) if inside is None else _Outcome(task, x, inside, grid.value(inside))


def _context() -> BaseContext:
    """Start method of worker processes: the faster `fork` if this process has only one thread, otherwise `spawn`."""
    tasks = Path("/proc/self/task")
    one_thread = tasks.is_dir() and len(list(tasks.iterdir())) == 1
    return multiprocessing.get_context("fork" if one_thread else "spawn")


@contextmanager
def single_threaded_pool(workers: int) -> Generator[Executor]:
    """Context manager with a pool of processes whose BLAS uses one thread each, which is faster for small matrices.

    If this process was started with `OPENBLAS_NUM_THREADS=1`, the workers are forked, which takes less time.

    Args:
        workers: Number of processes.
    """
    before = {name: os.environ.get(name) for name in ONE_THREAD}
    os.environ.update(ONE_THREAD)
    others = set(multiprocessing.active_children())
    pool = ProcessPoolExecutor(workers, _context(), initializer=follow_parent, initargs=(os.getpid(),))
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
        # Running tasks are abandoned: the search has collected its results, or the user has stopped it.
        pool.shutdown(wait=False, cancel_futures=True)
        for process in set(multiprocessing.active_children()) - others:
            process.terminate()
            process.join()


class _Round:
    """Tasks of one round: the short descents, then the refinements of the best results."""

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

    def refinements(self, outcomes: Sequence[_Outcome]) -> list[_Task]:
        """Tasks that refine the best short descents; descents with equal values are sorted by their numbers."""
        feasible = [(o.value, o.task.number, o.reached, o.task.kind) for o in outcomes if o.reached is not None]
        feasible.sort(key=lambda each: each[:2])
        return [
            _Task(self.number, SCOUTS + k, kind, x, (self._seed, self.number, SCOUTS + k), True, self._deadline)
            for k, (_, _, x, kind) in enumerate(feasible[:REFINED])
        ]


class _Incumbent:
    """Best plan so far, with the history of its criterion and the function that reports progress."""

    def __init__(self, problem: DescentProblem, progress: Progress | None, began: float) -> None:
        self.pickled = pickle.dumps(problem)
        self.problem, self.grid = _problem(self.pickled)
        self.best: SearchCandidate | None = None
        self.descents = 0
        self.history: list[tuple[float, float]] = []
        self._progress, self._began = progress, began

    def update(self, x: Array, value: float, number: int, kind: str) -> None:
        """Replaces the best plan by a feasible plan with unknowns x if the criterion `value` is smaller."""
        if self.best is None or value < self.best.value:
            self.best = SearchCandidate(x, value, number, kind)
        if self._progress is not None:
            self._progress(self.best, time.time() - self._began, self.descents)

    def add_outcome(self, outcome: _Outcome) -> None:
        """Counts a descent and updates the best plan and its history."""
        self.descents += outcome.begun
        if outcome.inside is not None:
            self.update(outcome.inside, outcome.value, outcome.task.round, outcome.task.kind)
        if outcome.begun:
            self.append_history()

    def append_history(self) -> None:
        """Appends the elapsed time and the value of the best plan to the history."""
        assert self.best is not None  # the first plan is known before any descent
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
    """Searches, among the plans that keep every limit, for the plan with the smallest criterion.

    Args:
        problem: Criterion, unknowns and limits.
        seed: Seed of the random starts and perturbations.
        budget: Wall time [s]; if `None`, the search ends after `rounds` only.
        rounds: Largest number of rounds; `None` for no limit. If the search ends because this number is reached,
            machines of the same kind give the same plan.
        executor: Executor that runs the descents; if not given, they are run in this process.
        given: Plans that are compared first, each with unknowns of shape (n k,).
        progress: Function that is called whenever a plan has been compared with the best plan.

    Raises:
        ArmidError: The budget or the number of rounds is not positive, or the start pose itself violates a limit.
    """
    if (budget is not None and not budget > 0.0) or (rounds is not None and rounds < 1):
        raise ArmidError(
            f"A search needs a positive time and at least one round; found a time of {budget} s and {rounds} rounds.",
            remedy="give a time of some seconds; ten are enough for a good plan of a seven-joint arm.",
        )
    began = time.time()
    deadline = np.inf if budget is None else began + budget
    incumbent = _Incumbent(problem, progress, began)
    first = random_start(incumbent.problem, incumbent.grid, np.random.default_rng((seed, 0, 0)))
    _check_first(incumbent, first)
    incumbent.update(first, incumbent.grid.value(first), 0, "start")
    for x in given:
        inside = shrink_to_feasible(incumbent.problem, incumbent.grid, x)
        if inside is not None:
            incumbent.update(inside, incumbent.grid.value(inside), 0, "given")
    incumbent.append_history()
    done, interrupted = 0, False
    try:
        while (rounds is None or done < rounds) and time.time() < deadline:
            current = _Round(done, seed, incumbent.best, deadline)
            scouted = _run_tasks(incumbent, current.scouts, executor)
            _run_tasks(incumbent, current.refinements(scouted), executor)
            done += time.time() < deadline
    except KeyboardInterrupt:
        interrupted = True
    assert incumbent.best is not None
    return Search(
        incumbent.best, done, incumbent.descents, time.time() - began, interrupted, tuple(incumbent.history)
    )


def _check_first(incumbent: _Incumbent, first: Array) -> None:
    """Raises an error if the start pose violates a limit, or if in the first motion (n k,) no joint can move."""
    still, tiny = 0.0 * first, TINY * np.random.default_rng(0).normal(size=len(first))
    if max_utilisation(incumbent.problem, incumbent.grid, first) > 1.0 + 1e-6:
        remedy = _most_violated(incumbent, still)
        raise ArmidError("The start pose itself violates a limit, even without motion.", remedy=remedy)
    if not incumbent.grid.states(first)[1].any():
        remedy = _most_violated(incumbent, tiny)
        raise ArmidError("No motion keeps every limit, not even a very small one.", remedy=remedy)


def _run_tasks(incumbent: _Incumbent, tasks: Sequence[_Task], executor: Executor | None) -> list[_Outcome]:
    """Runs tasks and adds each outcome as soon as it is ready; simultaneous outcomes are sorted by task number."""
    results: list[_Outcome] = []
    if executor is None:
        for task in tasks:
            results.append(_run(incumbent.pickled, task))
            incumbent.add_outcome(results[-1])
    else:
        waiting: set[Future[_Outcome]] = {executor.submit(_run, incumbent.pickled, task) for task in tasks}
        try:
            while waiting:
                ready, waiting = wait(waiting, return_when=FIRST_COMPLETED)
                for outcome in sorted((future.result() for future in ready), key=lambda each: each.task.number):
                    results.append(outcome)
                    incumbent.add_outcome(outcome)
        finally:
            for future in waiting:
                future.cancel()
    return results


def _most_violated(incumbent: _Incumbent, x: Array) -> str:
    """Remedy that names the limit that a motion (n k,) violates most, and the joint or pair of bodies."""
    worst = max(
        (
            (float(u[:, k].max()), channel.name, label)
            for channel, u in zip(
                incumbent.problem.channels, utilisation(incumbent.problem, incumbent.grid, x), strict=True
            )
            for k, label in enumerate(channel.labels)
        ),
        default=(0.0, "", ""),
    )
    return f"relax {worst[1]} of {worst[2]} ({100 * worst[0]:.0f} % of its limit), or give another pose with --start."
