"""Updates of an earlier estimate with new recordings: recalibration, and estimates of payload and drive gains."""
