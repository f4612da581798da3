"""Lines of a recording's table at the prompt: they replace keys of the run's log format."""

from __future__ import annotations

import pytest

from armid.cli.log_format_options import changed_reading
from armid.errors import ArmidError
from armid.measurement.log_format import LogFormat

RUN = LogFormat(columns={"q": "q{}", "effort": "i{}"}, drive_gain=[2.0, 3.0], drive_gain_deviation=0.1)


def test_lines_replace_keys_of_the_run_and_options_replace_lines():
    given = changed_reading(RUN, 50.0, None, None, ['units = "deg"', "rate = 20", "drive_gain = [1, 2]"])
    assert given == {"units": "deg", "rate": 50.0, "drive_gain": [1, 2]}


def test_columns_that_are_not_named_stay_those_of_the_run():
    given = changed_reading(RUN, None, None, None, ['columns = { effort = "tau{}" }'])
    assert given["columns"] == {"q": ("q{}",), "effort": "tau{}"}


def test_a_log_of_torques_needs_no_gains_of_the_run():
    given = changed_reading(RUN, None, None, None, ['drive_gain = "none"'])
    assert given == {"drive_gain": None, "drive_gain_deviation": None}
    assert changed_reading(RUN, None, None, None, ['period = "none"']) == {"period": "none"}


@pytest.mark.parametrize("line", ["drive_gain [2]", "drive_gian = 2", "role = 1"])
def test_what_is_no_line_is_refused(line: str):
    with pytest.raises(ArmidError):
        changed_reading(RUN, None, None, None, [line])
