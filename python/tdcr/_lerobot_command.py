"""What ``tdcr data export --format lerobot`` does in Python."""

from __future__ import annotations

import json
import logging
import signal
import sys
from typing import Any

from tdcr import lerobot, set_threads
from tdcr.errors import TdcrError

_INTERRUPTED = 130
"""Exit status after an interruption, as of every command."""


def run(request: dict[str, Any]) -> int:
    """Does what ``src/cli/data/lerobot.rs`` asks for; returns the exit status.

    ``function`` names a function of :mod:`tdcr.lerobot`, ``keywords`` are its arguments, ``episodes`` is how many it makes;
    ``threads``, ``json`` and ``quiet`` are the options of every command.
    """
    # What ends the process leaves no half of a data set.
    for name in ("SIGTERM", "SIGHUP"):
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), signal.default_int_handler)
    logging.basicConfig(format=" INFO export: %(message)s")
    logging.getLogger("tdcr").setLevel(logging.WARNING if request["quiet"] else logging.INFO)
    set_threads(request["threads"])
    try:
        folder = getattr(lerobot, request["function"])(**request["keywords"])
    except TdcrError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("error: interrupted", file=sys.stderr)
        return _INTERRUPTED
    episodes = request["episodes"]
    if request["json"]:
        print(json.dumps({"dir": str(folder), "episodes": episodes}, indent=2))
    elif not request["quiet"]:
        print(f"{folder}: {episodes} episode{'s' if episodes != 1 else ''}")
    return 0
