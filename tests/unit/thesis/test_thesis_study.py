"""Parts of the study of the thesis: what is in print, how much is run, what it needs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from armid.errors import MissingExtraError
from armid.thesis.page.chapter_elements import counted, subscripts
from armid.thesis.published import Summand, formula, published, weight
from armid.thesis.reproduction import reproduce
from armid.thesis.setting import QUICK, Extent, extent_of


def test_the_tables_in_print():
    found = published()
    assert len(found.base) == 57 and found.physical.shape == (7, 12) and len(found.frames) == 7
    assert found.base["MYR_2"] == (-5.8, 0.07)
    assert found.physical[0, :2].tolist() == [6.714, -0.581]
    assert len(found.columns) == 27 and len(found.groupings) == 19


def test_sums_are_read_and_written():
    lengths = np.array([0.0, 0.0, 2.0, 3.0])
    assert weight(Summand("M_4", -2.0, (3, 4), 2), lengths) == -50.0
    assert weight(Summand("MY_3", -1.0, (), 0), lengths) == -1.0
    terms = (Summand("MY_3", -1.0, (), 0), Summand("M_4", 2.0, (3, 4), 2), Summand("YZ_3", -1.0, (4,), 1))
    assert formula(terms) == "−MY_3 + 2 (d_3 + d_4)² M_4 − d_4 YZ_3"
    assert formula(()) == "0"


def test_subscripts_and_counts():
    assert subscripts("MYR_2 of β_i, d_n² M_{n−2}, x_0, q_max") == "MYR₂ of βᵢ, dₙ² Mₙ₋₂, x₀, q_max"
    assert (counted(1, "seed"), counted(2, "seed")) == ("1 seed", "2 seeds")


def test_extents():
    assert extent_of() == Extent() and extent_of(quick=True) == QUICK
    assert extent_of(quick=True, seeds=4, starts=3) == replace(QUICK, seeds=4, starts=3)


def test_what_it_needs_is_asked_for_first(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("armid.thesis.reproduction.find_spec", lambda name: None if name == "casadi" else name)
    told: list[str] = []
    with pytest.raises(MissingExtraError, match="casadi"):
        reproduce(QUICK, progress=lambda chapter, share: told.append(chapter))
    assert told == []
