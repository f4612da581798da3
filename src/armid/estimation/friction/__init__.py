"""Selection of each joint's friction by its error on left-out data."""
