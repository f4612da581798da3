"""Files for ROS description packages, made from the URDF with the identified values."""
