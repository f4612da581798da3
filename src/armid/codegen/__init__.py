"""Source code of a model: straight lines of operations, made by carrying out the recursion on symbols.

`graph` is arithmetic on symbols in which nothing stands twice, `rigid` and `laws` are the dynamics on it, `functions`
says what code is made for, `program` is a function as a list of operations, `languages` how they are written.
`symbolic` gives the same as SymPy expressions, `tape` as something that the kernel runs.
"""

from collections.abc import Sequence

from numpy.typing import ArrayLike

from armid.codegen.functions import PROGRAMS, make_programs
from armid.codegen.languages import LANGUAGES
from armid.codegen.program import Argument, Program
from armid.codegen.source import FunctionSource, make_source
from armid.errors import OutputError, did_you_mean
from armid.model.base_parameters import BaseParameters
from armid.model.dynamics import DynamicsModel

__all__ = [
    "LANGUAGES",
    "PROGRAMS",
    "Argument",
    "FunctionSource",
    "Program",
    "generate",
    "make_programs",
    "make_source",
]


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
    """Source code of a model: the text of each file by its path.

    Args:
        model: Arm and torque terms, with its load parameters where a term depends on the load.
        base: Base parameters of the model.
        values: Their values, shape (b,).
        language: A row of `LANGUAGES`.
        name: What the code is called; the robot's name where none is given.
        heading: Lines about where it comes from, for the top of the file.
        wanted: Names of the functions, of `PROGRAMS`.

    Raises:
        OutputError: No such language.
        ModelError: No such function, or a term that depends on a load that is not known.
    """
    if language not in LANGUAGES:
        raise OutputError(
            f"No code is written in {language!r}.",
            possible=", ".join(LANGUAGES),
            remedy=did_you_mean(language, LANGUAGES),
        )
    source = make_source(model, base, values, name=name, heading=heading, wanted=wanted)
    return LANGUAGES[language].write(source)
