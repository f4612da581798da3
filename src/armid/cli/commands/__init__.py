"""Commands; each module contains one command."""
