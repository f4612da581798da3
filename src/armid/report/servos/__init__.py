"""Page of a result of `armid servo`."""
