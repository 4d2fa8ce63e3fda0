"""The command line: what `pip` installs as ``tdcr``, and ``python -m tdcr``."""

from __future__ import annotations

import os
import signal
import sys

from tdcr._tdcr import run_command


def main() -> int:
    """Runs the command line with the arguments of the process; returns the exit status."""
    # The interpreter would only note a Ctrl-C, and act on it when the command has ended.
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    if sys.executable:
        # For the command that runs Python.
        os.environ.setdefault("TDCR_PYTHON", sys.executable)
    return run_command(["tdcr", *sys.argv[1:]])


if __name__ == "__main__":
    sys.exit(main())
