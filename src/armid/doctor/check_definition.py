"""Type `LogCheck`: functions of a check, and facts about the check that the doctor needs."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Literal

from armid.doctor.check_input import Explain, LogEvidence
from armid.errors import Finding

Scope = Literal["recording", "format", "command"]


@dataclass(frozen=True, eq=False, slots=True)
class LogCheck:
    """Check of a log for one fault or several related faults.

    Attributes:
        look: Function that searches a log for the fault and returns findings; the function repairs nothing.
        scope: Recordings that are checked during an identification; `armid doctor` always checks all recordings.
            `recording`: all recordings, because the fault may differ between recordings. `format`: the longest
            training recording of each log format, and every validation recording, because the fault is in the log
            format. `command`: no recordings; the check is done only by `armid doctor`.
        effects: Effects of the fault on an estimate, as text; the keys are the codes of the findings of this check.
        explain: Function that explains a misfit of the model by this fault, if the fault causes one.
        untested: Reasons why the remedy of a finding is not tested on left-out motion; the keys are codes of
            findings.
        hides: Codes of findings that are consequences of this fault; these findings are not reported together with
            the fault.
        follows: Codes of faults that cause the findings of this check; these findings are then not reported.
        needs_torque: False if the check is also valid for a log of motor currents.
        needs_command: True if the check compares commands with positions; such checks precede an identification of
            servos.
    """

    look: Callable[[LogEvidence], list[Finding]]
    scope: Scope
    effects: Mapping[str, str]
    explain: Explain | None = None
    untested: Mapping[str, str] = field(default_factory=dict[str, str])
    hides: tuple[str, ...] = ()
    follows: tuple[str, ...] = ()
    needs_torque: bool = True
    needs_command: bool = False
