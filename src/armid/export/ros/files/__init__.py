"""Modules of `armid.export.ros.catalogue.ROS_FILES`, one for each kind of file."""
