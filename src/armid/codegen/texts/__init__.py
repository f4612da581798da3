"""Texts of generated code that do not depend on the arm: examples, a monitor, and a package for ROS 2."""
