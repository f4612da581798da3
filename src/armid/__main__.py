"""Command line as a module: `python -m armid` where the folder of the command `armid` is not on the path."""

from __future__ import annotations

from armid.cli.entry import main

if __name__ == "__main__":
    main()
