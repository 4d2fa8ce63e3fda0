#!/usr/bin/env python3
"""Checks that the version is the same everywhere, or sets it.

scripts/version.py --check  fails where a file has another version than the workspace in Cargo.toml
scripts/version.py 0.2.0    sets it there, the crates' dependencies on each other, CITATION.cff, plug-ins and Cargo.lock
"""

import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
# Before a version in a file, and behind it. All else (`pyproject.toml`, `tdcr --version`, `tdcr.__version__`) is taken from
# Cargo.toml when it is built.
PLACES = {
    "Cargo.toml": [
        r'(\[workspace\.package\]\nversion = ")([^"]+)(")',
        r'(\ntdcr[a-z-]* = \{ path = "[^"]+", version = "=)([^"]+)(" \})',
    ],
    "CITATION.cff": [r"(\nversion: )(\S+)()"],
    "python/plugins/cosseratbench_tdcr/pyproject.toml": [r'(\nversion = ")([^"]+)(")'],
    "python/plugins/lerobot_robot_tdcr/pyproject.toml": [r'(\nversion = ")([^"]+)(")'],
}


def found():
    """Versions by file, in their order."""
    for name, patterns in PLACES.items():
        text = (ROOT / name).read_text()
        for pattern in patterns:
            versions = [match[2] for match in re.finditer(pattern, text)]
            if not versions:
                sys.exit(f"{name}: no version where one was expected ({pattern!r})")
            yield from ((name, version) for version in versions)


def version():
    """The version of the workspace."""
    return next(found())[1]


def check():
    wanted = version()
    wrong = [f"{name}: {version}, where Cargo.toml's workspace is {wanted}" for name, version in found() if version != wanted]
    if f"## {wanted}" not in (ROOT / "CHANGELOG.md").read_text():
        wrong.append(f"CHANGELOG.md: no section of {wanted}")
    if wrong:
        sys.exit("\n".join(wrong))


def set_to(new):
    if not re.fullmatch(r"\d+\.\d+\.\d+(-[0-9A-Za-z.]+)?", new):
        sys.exit(f"{new} is not a version such as 0.2.0")
    for name, patterns in PLACES.items():
        text = (ROOT / name).read_text()
        for pattern in patterns:
            text = re.sub(pattern, rf"\g<1>{new}\g<3>", text)
        (ROOT / name).write_text(text)
    # Their own packages alone: what they depend on stays as it is locked.
    subprocess.run(["cargo", "update", "--workspace", "--quiet"], cwd=ROOT, check=True)


def main():
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    if sys.argv[1] == "--check":
        check()
    else:
        set_to(sys.argv[1])


if __name__ == "__main__":
    main()
