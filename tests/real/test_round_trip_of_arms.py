"""Descriptions of eight real arms edited by an export, byte for byte and read by other programs."""

from __future__ import annotations

from pathlib import Path

import pytest

from round_trips import PROGRAMS, round_trip

pytestmark = pytest.mark.real

REPEATED = "kuka_lwr4plus/kuka_lwr4.urdf"
"""Has two origins in an inertial, which MuJoCo does not take, written by whom ever."""

DESCRIPTIONS = (
    REPEATED,
    "franka_panda_gaz/panda.urdf",
    "kinova_gen3_raptor/kinova.urdf",
    "kuka_iiwa14_lasa/iiwa14.urdf",
    "kuka_lbr_med7/med7dock.urdf",
    "staubli_tx40/tx40_mdh_modified.urdf",
    "ur10_unisa/ur10_robot.urdf",
    "ur10e_innopolis/ur10e.urdf",
)


@pytest.mark.witness
@pytest.mark.parametrize("name", DESCRIPTIONS)
def test_only_what_was_identified_changes(shared_data: Path, tmp_path: Path, name: str):
    found = round_trip(shared_data / name, tmp_path, to="urdf")
    assert found.holds, found
    assert set(found.errors) == set(PROGRAMS) - ({"mujoco"} if name == REPEATED else set()), found
