"""The command line, and what tests compare its results by."""

from __future__ import annotations

import json
import os
import subprocess
from pathlib import Path
from typing import Any

TDCR = Path(os.environ.get("TDCR", Path(__file__).parents[3] / "target/release/tdcr"))
"""The command line."""

TINY: dict[str, Any] = {"width": 16, "depth": 2, "embedding": 16, "clouds": 8, "validate_every": 20}
"""A network that is trained in a moment."""


def command_line(*arguments: object) -> Any:
    """Runs the command line, and returns what it says as JSON."""
    command = [str(TDCR), *map(str, arguments), "--json", "--quiet"]
    return json.loads(subprocess.run(command, check=True, capture_output=True, timeout=60.0).stdout)


def files(folder: Path) -> dict[str, bytes]:
    """Every file below a folder, by its path there."""
    found = (path for path in sorted(folder.rglob("*")) if path.is_file())
    return {str(path.relative_to(folder)): path.read_bytes() for path in found}
