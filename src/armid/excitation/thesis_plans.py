"""Built-in plans: the two excitations that the thesis publishes."""

from __future__ import annotations

from pathlib import Path

from armid.errors import ArmidError, did_you_mean
from armid.excitation.fourier import Excitation, load_plan

TABLES = Path(__file__).parent / "tables"

PLANS = {
    "thesis-a1": "Table A.1 of the thesis: ten harmonics, designed for the smallest condition number",
    "thesis-a2": "Table A.2 of the thesis: five harmonics, designed for a test of feasibility",
}
"""Names of the built-in plans, with a description of each."""


def builtin_plan(name: str) -> Excitation:
    """Loads the built-in plan with a given name, as the thesis publishes it, with a period of 20 s.

    Raises:
        ArmidError: The name is unknown.
    """
    if name not in PLANS:
        raise ArmidError(
            f"There is no built-in plan {name!r}.", possible=", ".join(PLANS), remedy=did_you_mean(name, PLANS)
        )
    return load_plan(TABLES / f"{name}.json")
