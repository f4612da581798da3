"""Evidence that the checks look at: a recording as logged, as read, and as a model explains it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from armid.doctor.downsample import downsample
from armid.doctor.explanation import Explanation, LogState
from armid.doctor.remedy_trial import BY_ERROR_ALONE, RemedyTrial, try_out
from armid.doctor.stuck_channels import stuck_stretches, without_stuck
from armid.errors import Finding
from armid.measurement.log_format import LogFormat
from armid.measurement.recording import Recording
from armid.model.base_parameters import find_base_parameters
from armid.model.dynamics import DynamicsModel
from armid.model.terms import Coulomb, Offset, RigidBody, RotorInertia, Viscous
from armid.robot import Robot

__all__ = ["Explain", "LogEvidence"]

Explain = Callable[[LogState], Explanation | None]

ROUNDS = 3
"""Faults that are looked for on top of each other in what the model explains."""

ROWS = 3
"""Rows for each parameter of a joint from which a model is compared with: with fewer the fit follows the noise, and
friction that drives is \"sure\"."""

WIDTH = 0.02
"""Width of Coulomb friction in the model that the doctor compares with [rad/s]."""


@dataclass(frozen=True, eq=False)
class LogEvidence:
    """A log and what is known of it.

    Attributes:
        robot: The arm as described.
        raw: The recording as its file has it.
        reading: How it is read.
        recording: The recording in the robot's terms; `None` where it cannot be read so.
        noted: What was noticed while it was read.
        model: The study's model, if there is one: what its terms are.
        explains: Faults to look for where the model contradicts the log.
        saturation: Share of a joint's limit from which rows do not count anyway, if the study gives one.
    """

    robot: Robot
    raw: Recording
    reading: LogFormat
    recording: Recording | None
    noted: tuple[Finding, ...] = ()
    model: DynamicsModel | None = None
    explains: Sequence[Explain] = ()
    saturation: float | None = None

    @cached_property
    def state(self) -> LogState | None:
        """The log beside a model with friction, offsets and rotors; `None` where it holds too little."""
        if self.recording is None or self.recording.effort is None or self.robot.n == 0:
            return None
        log = downsample(self.counted)
        if not log.runs:
            return None
        own = () if self.model is None else self.model.terms
        names = {term.name for term in own}
        usual = (RigidBody(), Viscous(), Coulomb(width=WIDTH), Offset(), RotorInertia())
        plain = tuple(term for term in own if term.name == "coupling" or term.name in {u.name for u in usual})
        model = DynamicsModel(self.robot, plain + tuple(term for term in usual if term.name not in names))
        state = LogState(model, find_base_parameters(model), log)
        counted = state.rows.mask.sum(axis=0)
        enough = all(rows > ROWS * len(own) for rows, own in zip(counted, state.rows.parameters, strict=True))
        return state if enough else None

    @cached_property
    def stuck(self) -> tuple[tuple[int, str, int, int], ...]:
        """Joint, quantity, first and last row of each stretch in which a channel sticks."""
        recording = self.recording
        if recording is None or recording.consecutive is False:
            return ()
        return stuck_stretches(recording, self.rate)

    @property
    def counted(self) -> Recording:
        """The recording in the robot's terms, without what sticks."""
        assert self.recording is not None
        return without_stuck(self.recording, self.stuck)

    @property
    def explanations(self) -> tuple[Explanation, ...]:
        """Faults that together explain what the log contradicts, the strongest first."""
        return tuple(each for _, each in self._contest)

    @cached_property
    def _contest(self) -> tuple[tuple[LogState, Explanation], ...]:
        """Return what the log was taken for before each explanation, and the explanation.

        Where the log does not confirm the strongest, it is not told; but what it takes out is no other fault's.
        """
        state, codes = self.state, set[str]()
        found: list[tuple[LogState, Explanation]] = []
        for _ in range(ROUNDS):
            if state is None:
                break
            tried = [each for explain in self.explains if (each := explain(state)) is not None]
            tried = sorted((each for each in tried if each.code not in codes), key=lambda each: -each.gain)
            best = next((each for each in tried if self._holds(state, each)), None)
            if best is None:
                break
            if found or best.confirmed is None or best.confirmed(self):
                found.append((state, best))
            codes.add(best.code)
            state = best.after
        return tuple(found)

    def _holds(self, before: LogState, each: Explanation) -> bool:
        """Tell whether left-out motion bears an explanation out, or at least does not contradict it."""
        trial = self._trial(before, each.after)
        return trial.helps if each.code in BY_ERROR_ALONE else not trial.harms

    def _trial(self, before: LogState, after: LogState) -> RemedyTrial:
        """Errors on left-out motion, each computed once."""
        key = id(before), id(after)
        if key not in self._trials:
            self._trials[key] = try_out(before.rows, after.rows)
        return self._trials[key]

    @cached_property
    def _trials(self) -> dict[tuple[int, int], RemedyTrial]:
        return {}

    @cached_property
    def understood(self) -> LogState | None:
        """The log as it is understood once its faults are taken out."""
        return self.explanations[-1].after if self.explanations else self.state

    def explained(self, code: str) -> list[Finding]:
        """Findings of the explanations of one code."""
        found: list[Finding] = []
        for before, each in self._contest:
            if each.code == code:
                told = f"{each.evidence} {self._trial(before, each.after)}"
                found.append(Finding(code, each.severity, each.channel, told, each.remedy(self)))
        return found

    @cached_property
    def rate(self) -> float:
        """Samples a second of the log, or one where nobody knows [Hz]."""
        recording = self.recording or self.raw
        if recording.time is not None and len(recording.time) > 1:
            step = float(np.median(np.diff(recording.time)))
            return 1.0 / step if step > 0.0 else 1.0
        return recording.rate or 1.0

    def without(self, *codes: str) -> LogEvidence:
        """The same log, some of what was noted left out."""
        return replace(self, noted=tuple(finding for finding in self.noted if finding.code not in codes))
