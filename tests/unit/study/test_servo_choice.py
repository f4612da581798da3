"""Options of the table `[servo]` reach the identification as numbers of one kind."""

from __future__ import annotations

import numpy as np

from armid.study.servos.choice import ServoChoice, servo_options
from servo_labs import small_arm


def test_whole_numbers_of_any_size_become_floats():
    """A TOML file may contain integers that no array of integers can contain."""
    large = 10**20
    options = servo_options(ServoChoice(large, large, large, large, 1, large), small_arm())
    for given in (options.stiffness, options.damping, options.limit):
        assert given is not None and given.dtype == np.float64
    assert all(isinstance(each, float) for each in (options.stiffness_deviation, options.delay, options.bodies))
