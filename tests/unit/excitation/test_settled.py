"""Searches that reach their time limit: reported if the plan was still improving, not if it had converged."""

import math

import numpy as np
import pytest

from armid.excitation.design.multistart import Search, SearchCandidate
from armid.excitation.search_convergence import STILL, unsettled

START = (0.2, 2.0)


def searched(*descents, seconds=10.2, interrupted=False):
    """A search with the start and the ends of its descents: seconds, and value of the best so far."""
    best = SearchCandidate(np.zeros(1), (START, *descents)[-1][1], 0, "random")
    return Search(best, 0, len(descents), seconds, interrupted, (START, *descents))


def test_descents_that_time_cut_short_are_told():
    found = unsettled(searched((10.1, 0.5), (10.2, 0.1)), "d-optimal", 10.0)
    assert found is not None and "before the first local search was completed" in found.evidence
    assert (found.severity, found.remedy) == ("warning", "give the search more time, for instance --budget 60.")


@pytest.mark.parametrize(("criterion", "change"), [("d-optimal", 2.0), ("condition", 1.0)])
def test_what_the_last_descents_gained_is_told_by_its_measure(criterion, change):
    """A step of the criterion that makes deviations, or the condition number, smaller by a fifth."""
    step = -change * math.log(0.8)
    found = unsettled(searched((3.0, 1.0), (7.0, 1.0), (9.0, 1.0 - step), (10.2, 1.0 - step)), criterion, 10.0)
    assert found is not None and "the last 3 local searches" in found.evidence and "by 20 %" in found.evidence
    assert ("condition number" in found.evidence) == (criterion == "condition")


def test_a_search_that_has_settled_says_nothing():
    early = ((1.0, 1.0), (4.0, 0.3), (7.0, 0.3 - STILL), (10.2, 0.3 - STILL))
    assert unsettled(searched(*early), "d-optimal", 10.0) is None
    assert unsettled(searched((8.0, 0.1), (8.1, 0.1), (10.1, 0.1)), "d-optimal", 10.0) is None
    assert unsettled(searched((1.0, 0.1), (4.0, 0.0), seconds=5.0), "d-optimal", 10.0) is None  # rounds ended it
    assert unsettled(searched((10.2, 0.0), interrupted=True), "d-optimal", 10.0) is None  # that is said already
    assert unsettled(searched((9.0, 0.0)), "d-optimal", None) is None


def test_the_remedy_is_longer_than_what_was_given():
    found = unsettled(searched((90.0, 0.0), seconds=91.0), "d-optimal", 80.0)
    assert found is not None and "--budget 160" in found.remedy
