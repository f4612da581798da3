"""Updates of an earlier estimate with new recordings: recalibration, payload and drive gains."""
