"""Commands on a folder that `armid servo` made: its page, and its error on new recordings."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any


def report_servo(folder: str, page: Path, data: Path | None) -> tuple[str, ...]:
    """Write the page of a servo result again, and return messages about recordings that cannot be read again."""
    from armid.report.servos.page import write_servo_page
    from armid.report.servos.page_data import gather_servo
    from armid.runs.servos.stored_servo import load_servo

    page_data = gather_servo(load_servo(folder), data=data)
    write_servo_page(page_data, page)
    return page_data.missing


def validate_servo_folder(
    folder: str, recordings: Sequence[str], changes: Mapping[str, Any], page: Path | None, *, json: bool
) -> bool:
    """Print the closed-loop error of a servo result on new recordings, and write a page if one is asked for.

    Returns:
        True if the identified arm predicts the motion better than its commands do.
    """
    from armid.cli.console import output_console, print_findings
    from armid.cli.servos.servo_result import errors_table
    from armid.report.servos.page import write_servo_page
    from armid.report.servos.page_data import gather_servo
    from armid.runs.servos.servo_validation import validate_servo
    from armid.runs.servos.stored_servo import load_servo
    from armid.study.servos.record import score_record
    from armid.study.storage.records import to_json

    stored = load_servo(folder)
    score, runs, findings = validate_servo(stored, recordings, changes)
    judged = replace(stored, errors=replace(stored.errors, score=score))
    written = None if page is None else write_servo_page(gather_servo(judged, runs), page)
    if json:
        record = {"verdict": score.verdict, **score_record(score), "page": None if written is None else str(written)}
        sys.stdout.write(to_json(record) + "\n")
    else:
        output_console().print(errors_table(judged))
        sys.stdout.write(f"verdict: {score.verdict}\n")
        sys.stdout.write("" if written is None else f"page written to {written}\n")
    print_findings(list(findings))
    return score.verdict == "pass"
