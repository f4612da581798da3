"""Studies, and the runs that they become."""
