"""Option `--fleet` of `armid identify`: identification of a new unit with its fleet as prior."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from armid.errors import StudyError

if TYPE_CHECKING:
    from armid.study.config import Study
    from armid.study.identify import Result
    from armid.study.prepare import Prepared

Fleet = Annotated[
    str | None,
    typer.Option(
        "--fleet", metavar="DIR", help="Fleet of this type of arm, as prior: a few seconds of motion are then enough."
    ),
]


def identified_with_fleet(
    study: Study, fleet: str, threads: int, *, compare: bool, method: str | None, quiet: bool
) -> tuple[Prepared, Result]:
    """Identify a new unit with a progress bar; return the prepared data and the result.

    `compare` and `method` are the values of --compare and --method, which --fleet excludes.
    """
    from armid.cli.console import progress
    from armid.runs.fleet.new_unit import study_like_fleet
    from armid.runs.fleet.stored_fleet import load_fleet
    from armid.study.fleet.unit_result import identify_unit

    if compare or method is not None:
        raise StudyError(
            f"--fleet and {'--compare' if compare else '--method'} are both given.",
            remedy="leave one of them out; with --fleet, the method is least squares with the fleet as prior.",
        )
    stored = load_fleet(fleet)
    study = study_like_fleet(study, stored)
    with progress(quiet=quiet) as tell:
        return identify_unit(study, stored.estimate.prior, threads=threads, progress=tell)
