#!/usr/bin/env python3
"""Builds the tests of a choice of packages and runs them, two test programs at a time.

    scripts/run_tests.py CARGO_OPTIONS...

`cargo test` begins when all is built, and runs one program after the other: a processor is idle while the largest crate is
compiled last, and while a program's longest test runs. Here one program runs while others are compiled, and then two. What each
prints is shown when it has ended. Documentation's tests, by Cargo, run beside these two, and are shown last.

Cargo builds a package's binaries beside the tests that call them, and not before, as nothing of theirs is linked into the tests:
these tests wait for their package's binaries here.
"""

import json
import os
import subprocess
import sys
import threading
import time
from collections import defaultdict
from pathlib import Path
from queue import PriorityQueue

#: Longest first, so that none is left for the end. The others follow by size.
LONGEST = ["cli", "inverse", "statics"]


def binaries():
    """The names of each package's binaries, by the package."""
    command = ["cargo", "metadata", "--no-deps", "--locked", "--format-version=1"]
    packages = json.loads(subprocess.run(command, check=True, stdout=subprocess.PIPE).stdout)["packages"]
    return {package["id"]: {t["name"] for t in package["targets"] if "bin" in t["kind"]} for package in packages}


class Tests:
    """Programs of tests that are built, those that are to run next first."""

    def __init__(self, binaries):
        self.built = PriorityQueue()
        #: Binaries that are not built yet, and what calls them, each by package.
        self.unbuilt = binaries
        self.waiting = defaultdict(list)
        self.failed = []
        self.printing = threading.Lock()

    def add(self, artifact):
        """Takes a message of Cargo's, if it is of a program of tests or of a binary that such programs call."""
        if artifact["reason"] != "compiler-artifact" or not artifact["executable"]:
            return
        package, kind = artifact["package_id"], artifact["target"]["kind"]
        name, executable = artifact["target"]["name"], artifact["executable"]
        if artifact["profile"]["test"]:
            rank = LONGEST.index(name) if name in LONGEST else len(LONGEST)
            size = Path(executable).stat().st_size
            program = (rank, -size, name, executable, Path(artifact["manifest_path"]).parent)
            if kind == ["test"] and self.unbuilt[package]:
                self.waiting[package].append(program)
            else:
                self.built.put(program)
        elif kind == ["bin"]:
            self.unbuilt[package].discard(name)
            if not self.unbuilt[package]:
                self.release(package)

    def release(self, package):
        """Lets programs run that wait for this package's binaries."""
        for program in self.waiting.pop(package, []):
            self.built.put(program)

    def end(self, workers, at_once):
        """Says that there are no more, or that those that are left are not to be run."""
        # A binary that is not among what was asked for is not waited for.
        for package in list(self.waiting):
            self.release(package)
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
    tests = Tests(binaries())
    workers = [threading.Thread(target=tests.run, daemon=True) for _ in range(2)]
    workers[0].start()
    command = ["cargo", "test", "--no-run", *options, "--message-format=json-render-diagnostics"]
    with subprocess.Popen(command, stdout=subprocess.PIPE) as build:
        for line in build.stdout:
            tests.add(json.loads(line))
    workers[1].start()
    tests.end(len(workers), at_once=build.returncode != 0)
    documented = None
    if not build.returncode:
        command = ["cargo", "test", "--doc", *options]
        documented = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, check=False)
    for worker in workers:
        worker.join()
    if documented is None:
        sys.exit(build.returncode)
    sys.stdout.buffer.write(documented.stdout)
    sys.stdout.flush()
    if tests.failed:
        sys.exit(f"tests failed: {', '.join(tests.failed)}")
    sys.exit(documented.returncode)


if __name__ == "__main__":
    main()
