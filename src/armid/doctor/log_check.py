"""Check of a log for a fault, and what the doctor has to know of it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Literal

from armid.doctor.check_input import Explain, LogEvidence
from armid.errors import Finding

Scope = Literal["recording", "format", "command"]


@dataclass(frozen=True, eq=False, slots=True)
class LogCheck:
    """Check of a log for a fault.

    Attributes:
        look: Finds the fault in the evidence; it repairs nothing.
        scope: Recordings that an identification looks at; `armid doctor` always looks at all. `recording`: each,
            since the fault may differ between recordings. `format`: for each log format the longest training
            recording, and every validation recording, since the fault is in the log format. `command`: none.
        effects: By code of its findings: effect of the fault on an estimate.
        explain: Explanation of a misfit of the model by this fault, if it is such a fault.
        untested: By code: reason why the remedy is not tested on left-out motion.
        hides: Codes of findings that follow from the fault with the check's name and are not reported beside it.
        follows: Codes of faults beside which its own findings are not reported, since they follow from them.
        fails: Codes of its errors with which the verdict of an identification is `fail`, although its recordings
            agree with each other.
        needs_torque: False if the check holds for a log of motor currents, too.
    """

    look: Callable[[LogEvidence], list[Finding]]
    scope: Scope
    effects: Mapping[str, str]
    explain: Explain | None = None
    untested: Mapping[str, str] = field(default_factory=dict[str, str])
    hides: tuple[str, ...] = ()
    follows: tuple[str, ...] = ()
    fails: tuple[str, ...] = ()
    needs_torque: bool = True
