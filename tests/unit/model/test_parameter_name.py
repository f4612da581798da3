"""Names of parameters: text and parts belong together."""

from __future__ import annotations

import copy
import pickle

import pytest

from armid.model.parameter_name import ParameterName, parameter_names

CASES = [
    ("ZZ_1", ("ZZ", 1, None, False)),
    ("ZZR_12", ("ZZ", 12, None, True)),
    ("FV_3[2]", ("FV", 3, 2, False)),
    ("IAR_2[1]", ("IA", 2, 1, True)),
    ("FP0_4", ("FP0", 4, None, False)),
    ("c_x_1", ("c_x", 1, None, False)),
    ("MX", ("MX", None, None, False)),
]


@pytest.mark.parametrize(("text", "parts"), CASES)
def test_a_name_is_its_text_and_knows_what_it_is_made_of(text: str, parts: tuple[str, int | None, int | None, bool]):
    name = ParameterName(*parts)
    assert name == text and hash(name) == hash(text)
    read = ParameterName.read(text)
    assert (read.symbol, read.number, read.recording, read.grouped) == parts


def test_names_of_recordings_and_groups_follow_from_a_name():
    name = ParameterName("FV", 1)
    assert name.of_recording(2) == "FV_1[2]" and name.of_recording(2).of_all == name
    assert name.regrouped() == "FVR_1"


@pytest.mark.parametrize("text", [text for text, _ in CASES])
def test_a_copy_keeps_the_parts(text: str):
    name = ParameterName.read(text)
    for again in (copy.deepcopy(name), pickle.loads(pickle.dumps(name))):
        assert again == name and (again.symbol, again.recording) == (name.symbol, name.recording)


def test_names_that_have_their_parts_stay():
    names = parameter_names(["FV_1", ParameterName("FS", 2)])
    assert parameter_names(names) == names and parameter_names(names)[1] is names[1]
