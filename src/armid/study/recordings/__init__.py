"""Recordings of a study: read, cut, processed and labelled."""
