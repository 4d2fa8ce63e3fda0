#!/usr/bin/env python3
"""Checks that the wheel and the tests share one build of what both depend on: fails where their features of a crate differ.

Cargo builds a crate once for each set of features. What is built for the tests has the features that any of the workspace's
targets asks for; the wheel, built alone, would have fewer. `python/Cargo.toml` names crates so that it has the same.
"""

import subprocess
import sys
from collections import defaultdict
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
WHEEL = ["-p", "tdcr-python"]
TESTS = ["--workspace", "--exclude", "tdcr-mujoco"]
# For the wheel and for the tests: what runs within them, and with that what runs while they are built (build scripts and
# procedural macros), of which Cargo keeps builds of their own.
EDGES = [("normal,no-proc-macro", "normal,dev,no-proc-macro"), ("normal,build", "all")]


def features(packages, edges):
    """Sets of features that a build of these packages has of each crate on these edges of the tree."""
    command = ["cargo", "tree", "--locked", *packages, "-e", edges, "--prefix", "none", "-f", "{p}|{f}"]
    tree = subprocess.run(command, cwd=ROOT, check=True, stdout=subprocess.PIPE, text=True).stdout
    found = defaultdict(set)
    for line in tree.splitlines():
        # With all edges there are lines for features too: these have no bar.
        crate, bar, names = line.removesuffix(" (*)").partition("|")
        if bar:
            found[crate.strip()].add(names.strip())
    return found


def main():
    apart = False
    for of_wheel, of_tests in EDGES:
        wheel, tests = features(WHEEL, of_wheel), features(TESTS, of_tests)
        for crate in sorted(crate for crate, sets in wheel.items() if not sets <= tests[crate]):
            print(
                f"{crate}: the wheel has the features {sorted(wheel[crate])}, the tests {sorted(tests[crate])}", file=sys.stderr
            )
            apart = True
    if apart:
        sys.exit(
            "name these crates with the tests' features in python/Cargo.toml: else they, and all above them, are built twice"
        )


if __name__ == "__main__":
    main()
