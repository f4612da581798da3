"""Run of the whole study of the thesis, and conversion of the results to `thesis.json`."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable
from dataclasses import dataclass
from importlib.util import find_spec
from typing import Any

from armid.errors import MissingExtraError
from armid.excitation.fourier import Excitation
from armid.runs.consistency_check import Verdict, verdict_record
from armid.thesis.algorithm_corrections import Steps, steps
from armid.thesis.audit import Audit, audit
from armid.thesis.chapter_4_results import Pictures, Results, results
from armid.thesis.design_trials import Designs, designs
from armid.thesis.dynamics_check import Dynamics, Kinematics, dynamics, kinematics
from armid.thesis.errata import Erratum, errata
from armid.thesis.reduction import Reduction, reduction
from armid.thesis.setting import Extent, Setting, Tell, make_setting

NEEDED = {"mujoco": "lab", "casadi": "nlp"}
"""Required packages, with the extra of armid that installs each package. The study checks them before it begins."""

SHARES = {"model": (0.0, 0.03), "Algorithm 3": (0.03, 0.45), "Algorithm 2": (0.45, 0.96), "audit": (0.96, 1.0)}
"""Beginning and end of each part of the study in the report of progress, as shares of the whole time."""


@dataclass(frozen=True, eq=False, slots=True)
class Thesis:
    """Results of the study of the thesis, chapter by chapter.

    Attributes:
        setting: Arm, true parameters and motions.
        kinematics: Results of section 3.1.1.
        dynamics: Results of sections 2.2 and 3.1.2.
        reduction: Results of section 3.1.4 and equation (A.1).
        steps: Results of section 3.2, step by step.
        designs: Results of section 3.3 and Algorithm 2.
        results: Results of chapter 4, on the virtual arm.
        audit: Audit of the published results.
        errata: Errata of the thesis.
        seconds: Wall time of the study [s].
    """

    setting: Setting
    kinematics: Kinematics
    dynamics: Dynamics
    reduction: Reduction
    steps: Steps
    designs: Designs
    results: Results
    audit: Audit
    errata: tuple[Erratum, ...]
    seconds: float


def reproduce(extent: Extent | None = None, *, progress: Tell | None = None) -> Thesis:
    """Runs the study of the thesis.

    Args:
        extent: Extent of the run; if `None`, the whole study.
        progress: Callback with the name of the part and the share of the study that is done.

    Raises:
        MissingExtraError: MuJoCo or CasADi is not installed.
    """
    for name, extra in NEEDED.items():
        if find_spec(name) is None:
            raise MissingExtraError(name, "The study of the thesis", extra)
    began = time.perf_counter()
    report = progress or _silent

    def within(chapter: str) -> Callable[[float], None]:
        begin, end = SHARES[chapter]
        return lambda share: report(chapter, begin + share * (end - begin))

    within("model")(0.0)
    setting = make_setting(extent or Extent())
    frames, moving, base = kinematics(setting), dynamics(setting), reduction(setting)
    stepped, estimates = steps(setting, within("Algorithm 3"))
    designed = designs(setting, within("Algorithm 2"))
    within("audit")(0.0)
    tables, audited = results(setting, estimates), audit(setting, estimates)
    found = errata(setting, moving, base, designed, stepped, audited, estimates)
    within("audit")(1.0)
    seconds = time.perf_counter() - began
    return Thesis(setting, frames, moving, base, stepped, designed, tables, audited, found, seconds)


def _silent(chapter: str, share: float) -> None:
    """Callback that ignores progress."""
    del chapter, share


SERIES = {"time", "measured", "base", "physical"}
"""Fields of `Pictures` that are lines of figures; they are left out of the record."""


def thesis_record(thesis: Thesis) -> dict[str, Any]:
    """Content of `thesis.json`: all results of the reproduced thesis, without the curves of its figures."""
    return {
        field.name: _record(getattr(thesis, field.name))
        for field in dataclasses.fields(thesis)
        if field.name != "setting"
    } | {"extent": _record(thesis.setting.extent)}


def _record(value: Any) -> Any:
    if isinstance(value, Verdict):
        return verdict_record(value)
    if isinstance(value, Excitation):
        return {"base_frequency": value.base_frequency, "offset": value.offset, "a": value.a, "b": value.b}
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        left_out = SERIES if isinstance(value, Pictures) else set[str]()
        return {f.name: _record(getattr(value, f.name)) for f in dataclasses.fields(value) if f.name not in left_out}
    if isinstance(value, tuple | list):
        return [_record(each) for each in value]
    return value
