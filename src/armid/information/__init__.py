"""What the data say: observations, streaming factors, square-root information."""
