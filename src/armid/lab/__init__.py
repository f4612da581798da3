"""A laboratory without a robot."""
