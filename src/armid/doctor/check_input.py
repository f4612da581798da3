"""Input of the checks: a recording as logged, the same recording as read, and the fit of a model to it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np

from armid.doctor.changes.position_jumps import Jump, position_jumps, without_jumps
from armid.doctor.command_response import CommandResponse, command_response
from armid.doctor.downsample import downsample
from armid.doctor.earlier_run_links import KnownLinks
from armid.doctor.fitted_log import LogState
from armid.doctor.remedy_trial import WORSE, RemedyTrial, try_remedy
from armid.doctor.stuck_channels import stuck_segments, without_stuck
from armid.errors import Finding
from armid.maths.median import median
from armid.measurement.log_format import LogFormat
from armid.measurement.processing.saturation import without_plateaus
from armid.measurement.recording import Recording
from armid.model.base_parameters import find_base_parameters
from armid.model.dynamics_model import DynamicsModel
from armid.model.terms import Coulomb, Offset, RigidBody, RotorInertia, Viscous
from armid.remedy import Remedy
from armid.robot import Robot

ROUNDS = 3
"""Largest number of faults that are corrected one after the other."""

ROWS = 3
"""Smallest number of rows for each parameter of a joint with which a model is fitted. With fewer rows, the fit
follows the noise, and friction of the wrong sign can seem significant."""

INSTEAD = 0.5
"""Gain of the second strongest fault, relative to that of the strongest one, from which it is accepted instead if
the log does not confirm the strongest one."""

FURTHER_SHARE, CLEAR = 0.1, 0.1
"""Share of the gain of the first fault, and gain, one of which a further fault must have: what remains of a fault
that is corrected only in part, and model error, look like a weak second fault. A first fault with less gain than
`CLEAR` must lower the residual of all rows."""

TIE = 1e-9
"""Difference between two costs that is rounding: the residual of all rows is the same with and without a correction,
and other evidence decides, for example the position limits."""

LESS_ALIKE = 0.01
"""Decrease of the correlation between the measured torque and the torque of an earlier run, averaged over the
joints, from which the correction of a fault counts as contradicted by the run."""

WIDTH = 0.02
"""Velocity over which the doctor's model smooths Coulomb friction [rad/s]."""


@dataclass(frozen=True, eq=False, slots=True)
class Explanation:
    """Fault that, if it is present in a log, explains why the model does not fit the log.

    Attributes:
        code: Code of the finding.
        gain: Decrease of the mean over the joints of the logarithm of the RMS residual when the fault is corrected.
        severity: Severity of the finding.
        channel: Name of the joint; empty for all joints.
        evidence: Observation, with numbers.
        remedy: Function that returns the lines of a study that correct the fault. Its argument is the log with the
            log format in use.
        after: The log with the fault corrected.
        confirmed: Function that tests the fault by independent evidence in the log, if there is such a test. It is
            called only for the first fault.
        worse: Largest increase of the logarithm of the held-out error by the correction. It is negative, `HELPS`, if
            a smaller error is the only evidence. Wrong signs of torques, wrong zeros and wrong gravity also show in
            friction, inertias and weights.
        trial: Held-out errors without and with the correction, if they are computed on some of the rows only; if not
            given, they are computed on all rows.
    """

    code: str
    gain: float
    severity: Literal["error", "warning", "info"]
    channel: str
    evidence: str
    remedy: Callable[[LogEvidence], str]
    after: LogState
    confirmed: Callable[[LogEvidence], bool] | None = None
    worse: float = WORSE
    trial: RemedyTrial | None = None


Explain = Callable[[LogState], Explanation | None]


def _comparable_gain(before: LogState, each: Explanation) -> float:
    """Gain by which a fault is compared with others: the smaller one of the gains on all rows and on the judged rows.

    A delay is judged away from reversals. There a fault of another kind can look like one, and then the correction
    hardly lowers the residual of the other rows, or raises it.
    """
    if each.trial is None or not np.isfinite(each.gain):
        return each.gain
    return min(each.gain, before.fit.cost - each.after.fit.cost)


def _matters(accepted: Sequence[tuple[LogState, Explanation]], before: LogState, each: Explanation) -> bool:
    """True if the gain of a fault is large enough, beside those that were accepted before."""
    comparable = _comparable_gain(before, each)
    if accepted:
        return comparable > min(CLEAR, FURTHER_SHARE * accepted[0][1].gain)
    return comparable > -TIE or each.gain > CLEAR


def _rank(before: LogState, each: Explanation) -> float:
    """Gain by which faults are ordered: that of an ambiguous one counts less, as that of one that is not confirmed.

    Many orders of channels are tried, and some of them also fit the log of another fault. An order that is not the
    only one that fits has the severity `info`.
    """
    return _comparable_gain(before, each) * (INSTEAD if each.severity == "info" else 1.0)


@dataclass(frozen=True, eq=False)
class LogEvidence:
    """A log, the arm, and values computed from them that several checks use.

    Attributes:
        robot: The arm as described.
        raw: The recording as logged.
        reading: Log format with which the recording is read.
        recording: The recording in the convention of the robot; `None` if the recording cannot be converted.
        noted: Findings that were made when the recording was read and converted.
        model: Model of the study, if there is one; its torque terms are added to the terms of the doctor's model.
        explains: Functions `explain` of the checks. Each one returns the fault that it finds, if correcting this
            fault makes the model fit the log better.
        saturation: Share of a joint's torque limit above which the study excludes rows, if the study gives a share;
            `keep` if the study uses all rows.
        known: Links that are compared with the log instead of those of the description.
        cutoff: Cut-off of the study [Hz]; `None` if the cut-off is computed from the motion, or if nothing is
            filtered.
    """

    robot: Robot
    raw: Recording
    reading: LogFormat
    recording: Recording | None
    noted: tuple[Finding, ...] = ()
    model: DynamicsModel | None = None
    explains: Sequence[Explain] = ()
    saturation: float | Literal["keep"] | None = None
    known: KnownLinks | None = None
    cutoff: float | None = None

    @cached_property
    def state(self) -> LogState | None:
        """The log together with the model that the doctor fits to it: links, friction, offsets and rotor inertia.

        The result is `None` if the log is too short for a fit.
        """
        if self.recording is None or self.recording.effort is None or self.robot.n == 0:
            return None
        log = downsample(self.counted)
        if not log.runs:
            return None
        study_terms = () if self.model is None else self.model.terms
        names = {term.name for term in study_terms}
        usual = (RigidBody(), Viscous(), Coulomb(width=WIDTH), Offset(), RotorInertia())
        plain = tuple(term for term in study_terms if term.name == "coupling" or term.name in {u.name for u in usual})
        model = DynamicsModel(self.robot, plain + tuple(term for term in usual if term.name not in names))
        state = LogState(model, find_base_parameters(model), log, self.known)
        counted = state.rows.mask.sum(axis=0)
        enough = all(
            rows > ROWS * len(parameters) for rows, parameters in zip(counted, state.rows.parameters, strict=True)
        )
        return state if enough else None

    @cached_property
    def stuck(self) -> tuple[tuple[int, str, int, int], ...]:
        """Joint, quantity, first and last row of each segment of rows in which a channel is stuck at one value."""
        recording = self.recording
        if recording is None or recording.consecutive is False:
            return ()
        return stuck_segments(recording, self.rate)

    @cached_property
    def response(self) -> CommandResponse | None:
        """Response of the positions to the commands; `None` if the log has no commands or is too short."""
        return None if self.recording is None else command_response(self.recording, self.rate)

    @cached_property
    def jumps(self) -> tuple[Jump, ...]:
        """Positions that jump from one row to the next and stay."""
        return () if self.recording is None else tuple(position_jumps(self.recording))

    @property
    def counted(self) -> Recording:
        """The recording in the robot's convention, without samples at which a channel is stuck or saturated.

        Positions that jump and stay are moved back.
        """
        assert self.recording is not None
        return without_plateaus(without_stuck(without_jumps(self.recording, self.jumps), self.stuck))

    @property
    def explanations(self) -> tuple[Explanation, ...]:
        """Faults that together explain the misfit of the model, in the order in which they were accepted."""
        return tuple(each for _, each in self._accepted)

    @cached_property
    def _accepted(self) -> tuple[tuple[LogState, Explanation], ...]:
        """Accepted faults, each with the log in which all faults accepted before, but not this fault, are corrected.

        A fault that the log does not confirm is not reported. It is corrected nevertheless, so that the misfit is not
        attributed to another fault. If no other fault explains the misfit, the search ends. The log as a whole
        confirms nothing if something changes within it.
        """
        state, codes = self.state, set[str]()
        accepted: list[tuple[LogState, Explanation]] = []
        for _ in range(ROUNDS):
            if state is None:
                break
            candidates = [each for explain in self.explains if (each := explain(state)) is not None]
            candidates = [each for each in candidates if each.code not in codes and _matters(accepted, state, each)]
            candidates.sort(key=lambda each, before=state: -_rank(before, each))
            holding = (each for each in candidates if self._holds(state, each))
            best = next(holding, None)
            if best is None:
                break
            if not (sure := self._is_confirmed(best, bool(accepted), state)):
                least = INSTEAD * _comparable_gain(state, best)
                rivals = (each for each in holding if _comparable_gain(state, each) > least)
                other = next((each for each in rivals if self._is_confirmed(each, bool(accepted), state)), None)
                if other is not None:
                    best, sure = other, True
            if sure:
                accepted.append((state, best))
            elif len(candidates) == 1:
                break
            codes.add(best.code)
            state = best.after
        return tuple(accepted)

    def _is_confirmed(self, each: Explanation, further: bool, state: LogState) -> bool:
        """True if independent evidence confirms a fault; a fault after the first one must not raise the residual."""
        if further:
            return (each.confirmed is None or not state.change_corrected) and _comparable_gain(state, each) > -TIE
        return each.confirmed is None or each.confirmed(self)

    def _holds(self, before: LogState, each: Explanation) -> bool:
        """True if the held-out error confirms a fault, or if it does not contradict other evidence for the fault."""
        if each.severity == "error" and self._contradicts_run(before, each.after):
            return False
        trial = self._trial(before, each)
        return trial.after < trial.before + each.worse

    def _contradicts_run(self, before: LogState, after: LogState) -> bool:
        """True if the correction of a fault reduces the agreement of the log with the links of an earlier run."""
        if self.known is None or not self.known.of_run or before.nominal is None or after.nominal is None:
            return False
        return after.nominal.alike < before.nominal.alike - LESS_ALIKE

    def trial_of(self, accepted: Explanation) -> RemedyTrial:
        """Held-out errors of the model without and with the correction of an accepted fault."""
        before = next(state for state, each in self._accepted if each is accepted)
        return self._trial(before, accepted)

    def _trial(self, before: LogState, each: Explanation) -> RemedyTrial:
        """Held-out errors of the model before and after the correction of a fault.

        The result is stored and reused.
        """
        if each.trial is not None:
            return each.trial
        after = each.after
        key = id(before), id(after)
        if key not in self._trials:
            self._trials[key] = try_remedy(before.rows, after.rows)
        return self._trials[key]

    @cached_property
    def _trials(self) -> dict[tuple[int, int], RemedyTrial]:
        return {}

    @cached_property
    def corrected(self) -> LogState | None:
        """The log after correction of all faults that were found."""
        return self.explanations[-1].after if self.explanations else self.state

    def explained(self, code: str) -> list[Finding]:
        """Findings about the accepted faults that have a given code."""
        findings: list[Finding] = []
        for before, each in self._accepted:
            if each.code == code:
                text = f"{each.evidence} {self._trial(before, each)}"
                findings.append(
                    Finding(code, each.severity, each.channel, text, Remedy.read(each.remedy(self)).marked())
                )
        return findings

    @cached_property
    def rate(self) -> float:
        """Sample rate of the log [Hz]; 1 if the rate is unknown."""
        recording = self.recording or self.raw
        if recording.time is not None and len(recording.time) > 1:
            step = float(median(np.diff(recording.time)))
            return 1.0 / step if step > 0.0 else 1.0
        return recording.rate or 1.0

    def without(self, *codes: str) -> LogEvidence:
        """A copy without the findings in `noted` that have one of the given codes."""
        return replace(self, noted=tuple(finding for finding in self.noted if finding.code not in codes))
