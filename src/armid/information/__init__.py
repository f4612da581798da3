"""Evidence of the data: observations, streaming factors, square-root information."""
