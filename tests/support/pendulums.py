"""Description of an arm of two joints without bodies, which is designed for within a second."""

from __future__ import annotations

ARM = """
name = "pendulum"
convention = "modified"
[[joint]]
name = "first"
d = 0.3
position = [-1.0, 1.0]
velocity = 1.0
[[joint]]
name = "second"
alpha = 1.5707963267948966
a = 0.1
position = [-1.5, 1.5]
velocity = 2.0
"""
