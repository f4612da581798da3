"""Recordings of a run found locate_recording, and those of the demo, which is a simulation, made locate_recording."""

from __future__ import annotations

import pytest

from armid.errors import ArmidError
from armid.export import input_digest_check
from armid.export.input_digest_check import unseen_recordings
from armid.runs import locate_recording
from armid.runs.locate_recording import find_recording
from armid.runs.run import load_run
from armid.study import demo
from reports import make_run


@pytest.mark.parametrize("folder", [".", ""])
def test_a_missing_recording_names_where_it_was_looked_for(folder, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ArmidError, match=r"log\.csv was not found in the current working folder"):
        find_recording("log.csv", "0" * 64, folder)


def test_an_export_of_the_demo_is_checked_on_unseen_motion(tmp_path, monkeypatch):
    """The validation log of a demo is in no file: it is simulated once more, as for the report."""
    run = load_run(make_run(tmp_path).folder)
    asked = []

    def made(folder):
        asked.append(folder)
        raise ArmidError("simulated", remedy="none: enough was seen.")

    study = input_digest_check._record(run)
    for each in study["recordings"]:
        each["path"] = demo.UNSEEN
    monkeypatch.setattr(input_digest_check, "_record", lambda run: study)
    monkeypatch.setattr(locate_recording, "demo_recordings", made)
    assert set(unseen_recordings(run).missing) == {"simulated"} and asked[0] == run.folder
