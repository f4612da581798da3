"""Entry of the command line: signals wait while modules are loaded, and while the interpreter ends."""

from __future__ import annotations

import signal

SIGNALS = [getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)]


def main() -> None:
    """Run the command line of this process."""
    block = getattr(signal, "pthread_sigmask", None)
    before = SIGNALS if block is None else block(signal.SIG_BLOCK, SIGNALS)
    blocked = [each for each in SIGNALS if each not in before]
    from armid.cli.main import main as run

    try:
        run(blocked=blocked)
    finally:
        if block is not None:
            block(signal.SIG_BLOCK, SIGNALS)
