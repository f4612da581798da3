"""Names of bodies and pairs are texts that keep their parts through copies, workers and files."""

from __future__ import annotations

import copy
import pickle

import pytest

from armid.robot.collision_body_names import BodyName, BodyPair, link_of


@pytest.mark.parametrize("again", [copy.deepcopy, lambda value: pickle.loads(pickle.dumps(value))])
def test_parts_survive_a_copy(again):
    pair = again(BodyPair(BodyName("elbow", 2), "floor"))
    assert pair == "elbow shape 2 - floor" and pair.first.link == "elbow" and pair.first.number == 2


def test_links_of_a_pair_do_not_depend_on_what_a_link_is_called():
    odd = BodyPair(BodyName("wrist - left (2)", 3), BodyName("arm shape 2"))
    assert odd.links == BodyPair("wrist - left (2)", "arm shape 2")
    assert link_of("floor") == "floor"
