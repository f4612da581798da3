"""A study in a few rows: what it reads and what it says beyond the defaults."""

from __future__ import annotations

from dataclasses import fields
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from armid.notebook import Displayed, Summary

if TYPE_CHECKING:
    from armid.study.config import Study

__all__ = ["Outlined"]


class Outlined(Displayed):
    """A study that shows its arm, terms, method, recordings, and the options that differ from their defaults."""

    __slots__ = ()

    def summary(self) -> Summary:
        """One row each for arm, terms, method and processing, and one a recording."""
        study = cast("Study", self)
        model = study.model
        terms = "friction chosen joint by joint" if model.automatic else ", ".join(model.terms) or "default"
        rows = [
            ("arm", study.robot.description, _changed(study.robot, "description")),
            ("terms", terms, ", ".join(f"{name} {shapes}" for name, shapes in model.shapes.items())),
            ("method", study.estimation.method, _changed(study.estimation, "method")),
            ("processing", f"cut-off {study.processing.cutoff} Hz", _changed(study.processing, "cutoff")),
        ]
        for each in study.recordings:
            part = "" if tuple(each.part) == (0.0, 1.0) else f"part {each.part[0]:g} to {each.part[1]:g}"
            rows.append((each.role, each.path, ", ".join(filter(None, (part, _changed(each.reading))))))
        train = sum(each.role == "train" for each in study.recordings)
        title = f"study of {study.robot.description}: {train} to train, {len(study.recordings) - train} to validate"
        return Summary(title, ("", "", "options"), tuple(rows))


def _changed(value: Any, *told: str) -> str:
    """Fields of a dataclass that differ from a plain one, those left out that are told elsewhere."""
    plain = type(value)(**{name: getattr(value, name) for name in told})
    changed = [
        (field.name, own)
        for field in fields(value)
        if field.name not in told and not _same(own := getattr(value, field.name), getattr(plain, field.name))
    ]
    return ", ".join(f"{name} = {own.tolist() if isinstance(own, np.ndarray) else own}" for name, own in changed)


def _same(one: Any, other: Any) -> bool:
    if isinstance(one, np.ndarray) or isinstance(other, np.ndarray):
        return np.array_equal(one, other)
    return bool(one == other)
