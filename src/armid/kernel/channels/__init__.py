"""Passes of the kernel over the channels of a recording: zero-phase filters, speeds, and third differences."""
