"""Earlier estimates updated by new recordings: recalibration and payload."""
