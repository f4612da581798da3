"""Commands of `armid`; each module contains one command."""
