"""Generation of the source code of a model in one of the programming languages."""

from __future__ import annotations

from collections.abc import Sequence

from numpy.typing import ArrayLike

from armid.codegen.catalogue import LANGUAGES
from armid.codegen.functions import PROGRAMS
from armid.codegen.language_input import make_source
from armid.errors import OutputError, did_you_mean
from armid.model.base_parameters import BaseParameters
from armid.model.dynamics_model import DynamicsModel


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
    """Generates the source code of a model: the text of each file; the keys are the paths of the files.

    Args:
        model: Arm and torque terms. If a term depends on the load torque, the model needs `load_parameters`.
        base: Base parameters of the model.
        values: Values of the base parameters, shape (b,).
        language: Name of the language, one of `LANGUAGES`.
        name: Name of the generated module and prefix of its functions; if empty, the name of the robot is used.
        heading: Lines about the origin of the code, for the head of the files.
        wanted: Names of the functions that are generated, from `PROGRAMS`.

    Raises:
        OutputError: `language` is not in `LANGUAGES`.
        ModelError: A function does not exist, or a term depends on the load and no load parameters are given.
    """
    if language not in LANGUAGES:
        raise OutputError(
            f"There is no code generator for {language!r}.",
            possible=", ".join(LANGUAGES),
            remedy=did_you_mean(language, LANGUAGES),
        )
    source = make_source(model, base, values, name=name, heading=heading, wanted=wanted)
    return LANGUAGES[language].write(source)
