"""Recordings of a study: reading, selection of parts, processing, names, and agreement of the recordings."""
