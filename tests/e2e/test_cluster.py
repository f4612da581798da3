"""Fleets on a Dask cluster: the same results as without it, also if workers are killed."""

from __future__ import annotations

import json
import os
import signal
from pathlib import Path

import numpy as np
import pytest

from armid.cli import main as cli
from armid.cluster import cluster_executor
from armid.errors import ArmidError
from armid.excitation.design.multistart import single_threaded_pool
from armid.study.fleet.fleet_file import load_fleet_file
from armid.study.fleet.identify_fleet import FleetIdentification, identify_fleet
from fleets import made_fleet, write_fleet

distributed = pytest.importorskip("distributed")

UNITS = 4


@pytest.fixture(scope="module")
def fleet(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_fleet(made_fleet(UNITS, 2), tmp_path_factory.mktemp("fleet"))


@pytest.fixture(scope="module")
def alone(fleet: Path) -> FleetIdentification:
    """The fleet, identified in this process."""
    return identify_fleet(load_fleet_file(fleet))


def assert_equal(found: FleetIdentification, known: FleetIdentification) -> None:
    """Both have the same bits."""
    assert np.array_equal(found.estimate.values, known.estimate.values)
    assert np.array_equal(found.estimate.deviation, known.estimate.deviation)
    for one, other in zip(found.results, known.results, strict=True):
        assert np.array_equal(one.estimate.fit.covariance, other.estimate.fit.covariance)


def test_results_do_not_depend_on_the_executor(fleet: Path, alone: FleetIdentification):
    choice = load_fleet_file(fleet)
    with single_threaded_pool(2) as pool:
        assert_equal(identify_fleet(choice, executor=pool), alone)
    with cluster_executor("local", 2) as executor:
        assert_equal(identify_fleet(choice, executor=executor), alone)


def workers() -> list[int]:
    """Process numbers of the workers of the local cluster that are alive."""
    nannies = distributed.default_client().cluster.workers.values()
    return [nanny.pid for nanny in nannies if nanny.pid is not None]


def test_killed_workers_of_a_cluster_cost_no_result(fleet: Path, alone: FleetIdentification):
    killed: list[int] = []
    with cluster_executor("local", 2) as executor:

        def kill(stage: str, share: float) -> None:
            if stage in ("recordings", "units") and 0.0 < share < 1.0:
                killed.extend(workers()[:1])
                os.kill(killed[-1], signal.SIGKILL)

        found = identify_fleet(load_fleet_file(fleet), executor=executor, progress=kill)
    assert len(killed) >= 2
    assert_equal(found, alone)


def test_a_killed_pool_costs_no_result(fleet: Path, alone: FleetIdentification):
    """The tasks of a pool that has lost a process are run in this process."""
    killed: list[int] = []
    with single_threaded_pool(2) as pool:
        numbers = list(pool._processes)  # pyright: ignore

        def kill(stage: str, share: float) -> None:
            if not killed and stage == "recordings" and share > 0.0:
                killed.append(numbers[0])
                os.kill(numbers[0], signal.SIGKILL)

        found = identify_fleet(load_fleet_file(fleet), executor=pool, progress=kill)
    assert killed
    assert_equal(found, alone)


def test_the_command(fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    with pytest.raises(SystemExit) as ended:
        cli.main(
            [
                "fleet",
                str(fleet),
                "--scheduler",
                "local",
                "--jobs",
                "2",
                "--no-report",
                "--out",
                str(tmp_path / "out"),
            ]
        )
    assert not ended.value.code, capsys.readouterr().err
    assert len(json.loads((tmp_path / "out" / "fleet.json").read_text())["units"]) == UNITS


def test_a_missing_scheduler_is_one_error(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("armid.cluster.PATIENCE", 0.5)
    with pytest.raises(ArmidError, match="No scheduler of Dask answers at") as refused:
        with cluster_executor("tcp://127.0.0.1:9", 1):
            pass
    assert "dask scheduler" in refused.value.remedy
    with pytest.raises(ArmidError, match="No scheduler of Dask answers at nonsense"), cluster_executor("nonsense", 1):
        pass
