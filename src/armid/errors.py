"""Errors that state the request, the problem that was found, the possible values and the remedy.

All errors that armid raises for bad input derive from `ArmidError`. So a program needs to catch only one type, and
the command line can print one message. A `Finding` is not raised: it is an observation that is stored with a result.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

from armid.remedy import Remedy


class ArmidError(Exception):
    """Bad input, described in such a way that the user can correct it.

    Args:
        problem: What was asked and what was found instead, one sentence.
        possible: What would have been accepted, for instance the known names.
        remedy: What to do, an imperative sentence.
    """

    def __init__(self, problem: str, *, possible: str = "", remedy: str = "") -> None:
        self.problem = problem
        self.possible = possible
        self.remedy = remedy
        parts = [problem]
        if possible:
            parts.append(f"Possible: {possible}")
        if remedy:
            parts.append(f"Remedy: {remedy}")
        super().__init__("\n".join(parts))


class RobotError(ArmidError):
    """A robot description that cannot be read or is not an open chain of one-degree-of-freedom joints."""


class RecordingError(ArmidError):
    """A recording that cannot be read or does not fit the robot.

    Args:
        problem: What was asked and what was found instead, one sentence.
        possible: What would have been accepted.
        remedy: What to do, an imperative sentence.
        source: File of the recording, with which the message begins; `None` if `problem` already names the file.
        code: Code of the doctor's finding for this fault; empty if there is none.
    """

    def __init__(
        self, problem: str, *, possible: str = "", remedy: str = "", source: str | None = None, code: str = ""
    ) -> None:
        self.evidence = problem
        self.code = code
        named = "" if source is None else f"{source or 'The recording'}: "
        super().__init__(f"{named}{problem}{f' [{code}]' if code else ''}", possible=possible, remedy=remedy)


class ModelError(ArmidError):
    """Torque terms that do not fit the robot, or base parameters for which two independent computations differ."""


class StudyError(ArmidError):
    """A study that contradicts itself, or that contains an unknown name."""


class EstimationError(ArmidError):
    """Data that do not determine the requested estimate."""


class UnsolvedError(EstimationError):
    """A numerical search that found no solution, or a solution that fails its checks."""


class LabError(ArmidError):
    """An arm, a controller or sensors that cannot be simulated, or a simulation that diverged."""


class OutputError(ArmidError):
    """A result that cannot be written."""


WITHOUT_WINDOWS = ("collision", "witness")
"""Extras whose packages have no wheels for Windows."""


class MissingExtraError(ArmidError):
    """An optional dependency that is not installed.

    Args:
        package: Import name of the missing package.
        purpose: Purpose for which the package is needed.
        extra: Extra of armid that installs the package.
    """

    def __init__(self, package: str, purpose: str, extra: str) -> None:
        problem = f"{purpose} needs the package {package!r}, which is not installed."
        if sys.platform == "win32" and extra in WITHOUT_WINDOWS:
            super().__init__(
                problem,
                possible="Linux and macOS; the package has no wheels for Windows",
                remedy=f"in the Windows Subsystem for Linux: pip install 'armid[{extra}]'",
            )
        else:
            super().__init__(problem, remedy=f"pip install 'armid[{extra}]'")


@dataclass(frozen=True, slots=True)
class Finding:
    """Observation that the reader of a result should know.

    Attributes:
        code: Short stable name, for instance `description-rounded`.
        severity: `error` if the work cannot continue, `warning` if the result may be wrong, `info` if it only
            explains the result.
        channel: Joint, link, column or file that the finding concerns; empty if it concerns the robot or the
            recording as a whole.
        evidence: Observation, with numbers.
        remedy: Action to take; empty if none is needed.
    """

    code: str
    severity: Literal["error", "warning", "info"]
    channel: str
    evidence: str
    remedy: Remedy | str = ""


def did_you_mean(name: object, known: Iterable[str]) -> str:
    """Remedy with the known name that is most similar to a given name; empty if no name is similar.

    Args:
        name: Given name.
        known: Known names.
    """
    from difflib import get_close_matches

    plain = {str(each).lower(): each for each in known}
    close = get_close_matches(str(name).lower(), plain, 1)
    return f"did you mean {plain[close[0]]!r}?" if close else ""
