"""Source code of a model in one of the languages."""

from __future__ import annotations

from collections.abc import Sequence

from numpy.typing import ArrayLike

from armid.codegen.catalogue import LANGUAGES
from armid.codegen.functions import PROGRAMS
from armid.codegen.language_input import make_source
from armid.errors import OutputError, did_you_mean
from armid.model.base_parameters import BaseParameters
from armid.model.dynamics import DynamicsModel


def generate(
    model: DynamicsModel,
    base: BaseParameters,
    values: ArrayLike,
    language: str,
    *,
    name: str = "",
    heading: Sequence[str] = (),
    wanted: Sequence[str] = PROGRAMS,
) -> dict[str, str]:
    """Generate the source code of a model: the text of each file by its path.

    Args:
        model: Arm and torque terms, with its load parameters where a term depends on the load.
        base: Base parameters of the model.
        values: Their values, shape (b,).
        language: A row of `LANGUAGES`.
        name: Name of the code; by default the robot's name.
        heading: Lines about its origin, for the head of the file.
        wanted: Names of the functions, of `PROGRAMS`.

    Raises:
        OutputError: No such language.
        ModelError: No such function, or a term that depends on a load that is not known.
    """
    if language not in LANGUAGES:
        raise OutputError(
            f"There is no code generator for {language!r}.",
            possible=", ".join(LANGUAGES),
            remedy=did_you_mean(language, LANGUAGES),
        )
    source = make_source(model, base, values, name=name, heading=heading, wanted=wanted)
    return LANGUAGES[language].write(source)
