"""Updates of an earlier estimate by new recordings: recalibration, payload and drive gains."""
