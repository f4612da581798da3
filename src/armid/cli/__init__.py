"""Command line of armid."""
