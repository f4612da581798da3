"""Information of a long recording needs hardly more memory than the recording itself."""

from __future__ import annotations

import json
import os
import subprocess
import sys

import pytest

ALLOWANCE = 8.0
"""Growth of the resident set over the inputs [MB]: factors of 27 blocks 1.7, a chunk of friction columns 1.8 and its
making, a tile of columns 0.2, and what the allocator rounds up. The dense columns alone would be 360 MB."""

SAMPLES = 216_000

SCRIPT = """
import ctypes, json, os, resource, sys
import numpy as np
from armid.information import accumulate
from armid.information.accumulate import accumulate_information
from armid.model.base_parameters import find_base_parameters
from armid.model.dynamics_model import DynamicsModel
from armid.model.terms import Coulomb, RigidBody, Viscous
from problems import lively_motion, one_run, raw
from trees import iiwa_tree, robot_of

def peak():
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0

samples, noise = int(sys.argv[1]), float(sys.argv[2])
model = DynamicsModel(robot_of(iiwa_tree()), (RigidBody(), Viscous(), Coulomb()))
base = find_base_parameters(model)
rng = np.random.default_rng(0)
motion = lively_motion(rng, 7, 8000.0, samples / 8000.0)
torque = model.torque(motion, np.ones(len(model.parameters))) + noise * rng.normal(size=(samples, 7))
observations = raw(one_run(motion, torque, 8000.0, block_rows=8000))
few = raw(one_run(motion[slice(0, 100)], torque[:100], 8000.0))
accumulate.GRAM_ROWS, usual = 0, accumulate.GRAM_ROWS  # so that all of it runs once
accumulate_information(model, base, few)
del torque
libc = ctypes.CDLL(None)
if hasattr(libc, "malloc_trim"):
    libc.malloc_trim(0)
# The peak of a process starts anew where it is forked; the pages of libraries come back as they are used.
if child := os.fork():
    os._exit(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
accumulate_information(model, base, few)
accumulate.GRAM_ROWS = usual
before = peak()
information = accumulate_information(model, base, observations)
after = peak()
dense = np.ones((samples // 10, 211)) if len(sys.argv) > 3 else None
print(json.dumps({"growth": after - before, "made_by": str(information.made_by), "with_dense": peak() - before}))
sys.stdout.flush()
os._exit(0)
"""


def measured(*arguments):
    environment = os.environ | {"OPENBLAS_NUM_THREADS": "1", "PYTHONPATH": os.pathsep.join(p for p in sys.path if p)}
    command = [sys.executable, "-c", SCRIPT, *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, env=environment, check=False)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="peaks of forked processes are as Linux counts them")
@pytest.mark.parametrize(("noise", "method"), [(0.3, "products"), (0.0, "qr")])
def test_memory_stays_with_the_inputs(noise, method):
    result = measured(SAMPLES, noise)
    assert result["made_by"].endswith(method)
    assert result["growth"] <= ALLOWANCE


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="peaks of forked processes are as Linux counts them")
def test_the_measurement_sees_a_tenth_of_the_dense_columns():
    assert measured(SAMPLES, 0.3, "dense")["with_dense"] > 3.0 * ALLOWANCE
