#!/usr/bin/env python3
"""Builds the tests of a choice of packages and runs them, two test programs at a time.

    scripts/run_tests.py CARGO_OPTIONS...

`cargo test` runs one program after the other, and each ends with a processor idle while its longest test runs; those of rigs
wait for servos most of their time. What each prints is shown when it has ended. Documentation's tests follow, by Cargo.
"""

import json
import os
import subprocess
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

#: Longest first, so that none is left for the end. The others follow by size.
LONGEST = ["cli", "inverse", "statics"]


def programs(options):
    """Programs of tests with the folders of their packages, built by Cargo."""
    command = ["cargo", "test", "--no-run", *options]
    build = subprocess.run([*command, "--message-format=json-render-diagnostics"], stdout=subprocess.PIPE, check=False)
    if build.returncode:
        sys.exit(build.returncode)
    found = []
    for line in build.stdout.splitlines():
        message = json.loads(line)
        if message["reason"] == "compiler-artifact" and message["profile"]["test"] and message["executable"]:
            found.append((message["target"]["name"], Path(message["executable"]), Path(message["manifest_path"]).parent))

    def place(program):
        name, executable, _ = program
        return LONGEST.index(name) if name in LONGEST else len(LONGEST), -executable.stat().st_size

    return sorted(found, key=place)


def main():
    options = sys.argv[1:]
    printing = threading.Lock()

    def run(program):
        name, executable, package = program
        began = time.monotonic()
        environment = os.environ | {"CARGO_MANIFEST_DIR": str(package)}
        done = subprocess.run(
            [executable], cwd=package, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, check=False
        )
        with printing:
            print(f"     Running {name} of {package.name} ({executable}): {time.monotonic() - began:.1f} s", flush=True)
            sys.stdout.buffer.write(done.stdout)
            sys.stdout.flush()
        return None if done.returncode == 0 else f"{name} of {package.name} (exit status {done.returncode})"

    with ThreadPoolExecutor(2) as pool:
        failed = [name for name in pool.map(run, programs(options)) if name]
    if failed:
        sys.exit(f"tests failed: {', '.join(failed)}")
    sys.exit(subprocess.run(["cargo", "test", "--doc", *options], check=False).returncode)


if __name__ == "__main__":
    main()
