#!/usr/bin/env python3
"""Builds the tests of a choice of packages and runs them, two test programs at a time.

    scripts/run_tests.py CARGO_OPTIONS...

`cargo test` begins when all is built, and runs one program after the other: a processor is idle while the largest crate is
compiled last, and while a program's longest test runs. Here one program runs while others are compiled, and then two. What each
prints is shown when it has ended. Documentation's tests follow, by Cargo.
"""

import json
import os
import subprocess
import sys
import threading
import time
from pathlib import Path
from queue import PriorityQueue

#: Longest first, so that none is left for the end. The others follow by size.
LONGEST = ["cli", "inverse", "statics"]


class Tests:
    """Programs of tests that are built, those that are to run next first."""

    def __init__(self):
        self.built = PriorityQueue()
        self.failed = []
        self.printing = threading.Lock()

    def add(self, artifact):
        """Takes a message of Cargo's, if it is of a program of tests."""
        if artifact["reason"] == "compiler-artifact" and artifact["profile"]["test"] and artifact["executable"]:
            name, executable = artifact["target"]["name"], artifact["executable"]
            rank = LONGEST.index(name) if name in LONGEST else len(LONGEST)
            size = Path(executable).stat().st_size
            self.built.put((rank, -size, name, executable, Path(artifact["manifest_path"]).parent))

    def end(self, workers, at_once):
        """Says that there are no more, or that those that are left are not to be run."""
        rank = -1 if at_once else len(LONGEST) + 1
        for _ in range(workers):
            self.built.put((rank, 0, "", "", Path()))

    def run(self):
        """Runs programs until there are no more."""
        while True:
            *_, name, executable, package = self.built.get()
            if not executable:
                return
            began = time.monotonic()
            environment = os.environ | {"CARGO_MANIFEST_DIR": str(package)}
            done = subprocess.run(
                [executable], cwd=package, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, check=False
            )
            with self.printing:
                print(f"     Running {name} of {package.name} ({executable}): {time.monotonic() - began:.1f} s", flush=True)
                sys.stdout.buffer.write(done.stdout)
                sys.stdout.flush()
            if done.returncode:
                self.failed.append(f"{name} of {package.name} (exit status {done.returncode})")


def main():
    options = sys.argv[1:]
    tests = Tests()
    workers = [threading.Thread(target=tests.run, daemon=True) for _ in range(2)]
    workers[0].start()
    command = ["cargo", "test", "--no-run", *options, "--message-format=json-render-diagnostics"]
    with subprocess.Popen(command, stdout=subprocess.PIPE) as build:
        for line in build.stdout:
            tests.add(json.loads(line))
    workers[1].start()
    tests.end(len(workers), at_once=build.returncode != 0)
    for worker in workers:
        worker.join()
    if build.returncode:
        sys.exit(build.returncode)
    if tests.failed:
        sys.exit(f"tests failed: {', '.join(tests.failed)}")
    sys.exit(subprocess.run(["cargo", "test", "--doc", *options], check=False).returncode)


if __name__ == "__main__":
    main()
