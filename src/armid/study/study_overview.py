"""Summary of a study: its inputs and the options that differ from the defaults."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

import numpy as np

from armid.notebook_display import Summary


def study_summary(study: Any) -> Summary:
    """Summary of a `Study`: rows for arm, terms, method, processing and each recording, with changed options."""
    model = study.model
    terms = "friction selected joint by joint" if model.automatic else ", ".join(model.terms) or "default"
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


def _changed(value: Any, *excluded: str) -> str:
    """Text with the fields of a dataclass object that differ from their defaults, without those in `excluded`."""
    plain = type(value)(**{name: getattr(value, name) for name in excluded})
    changed = [
        (field.name, current)
        for field in fields(value)
        if field.name not in excluded and not _same(current := getattr(value, field.name), getattr(plain, field.name))
    ]
    return ", ".join(
        f"{name} = {current.tolist() if isinstance(current, np.ndarray) else current}" for name, current in changed
    )


def _same(one: Any, other: Any) -> bool:
    if isinstance(one, np.ndarray) or isinstance(other, np.ndarray):
        return np.array_equal(one, other)
    return bool(one == other)
