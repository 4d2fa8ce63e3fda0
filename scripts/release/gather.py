#!/usr/bin/env python3
"""Puts together what several machines built: `make gather-release BUILT=FOLDER`, with a folder of each machine's `dist/`.

Writes `dist/pypi` (wheels of all machines, one source distribution), `dist/files` (all else, the command for each kind of
machine, and checksums) and `dist/notes.md`. Fails where the tag of the checkout is another version than was built.
"""

import argparse
import os
import shutil
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "scripts"), str(ROOT / "scripts/release")]

import build  # noqa: E402
import version  # noqa: E402


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("built", type=Path, help="folder with a folder of each machine")
    parser.add_argument("--out", type=Path, default=ROOT / "dist", help="folder that is made anew")
    args = parser.parse_args()
    number = version.version()
    tag = os.environ.get("GITHUB_REF_NAME", f"v{number}")
    if tag != f"v{number}":
        sys.exit(f"the tag is {tag}, where the version is {number}")
    folders = sorted(path for path in args.built.iterdir() if path.is_dir())
    if not folders:
        sys.exit(f"{args.built} has no folder of a machine")
    shutil.rmtree(args.out, ignore_errors=True)
    for part in ("pypi", "files"):
        (args.out / part).mkdir(parents=True)
    sources = f"tdcr-{number}.tar.gz"
    for folder in folders:
        for path in sorted(folder.iterdir()):
            if path.name == "SHA256SUMS":
                continue
            for part in ("pypi", "files") if path.suffix == ".whl" or path.name == sources else ("files",):
                # What is no machine's own is that of the first.
                if not (args.out / part / path.name).exists():
                    shutil.copy(path, args.out / part)
    shutil.move(args.out / "files" / f"tdcr-{number}-notes.md", args.out / "notes.md")
    build.checksums(args.out / "files")


if __name__ == "__main__":
    main()
