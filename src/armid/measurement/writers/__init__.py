"""Writers of recordings that are folders."""
