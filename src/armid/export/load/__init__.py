"""Files with an identified payload for robot controllers, in the form in which each controller takes load data."""
