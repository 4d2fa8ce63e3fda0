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
WHEEL = ["-p", "tdcr-python", "-e", "normal,build"]
TESTS = ["--workspace", "--exclude", "tdcr-mujoco", "-e", "all"]


def features(packages):
    """Sets of features that a build of these packages has of each crate."""
    command = ["cargo", "tree", "--locked", *packages, "--prefix", "none", "-f", "{p}|{f}"]
    tree = subprocess.run(command, cwd=ROOT, check=True, stdout=subprocess.PIPE, text=True).stdout
    found = defaultdict(set)
    for line in tree.splitlines():
        # With all edges there are lines for features too: these have no bar.
        crate, bar, names = line.removesuffix(" (*)").partition("|")
        if bar:
            found[crate.strip()].add(names.strip())
    return found


def main():
    wheel, tests = features(WHEEL), features(TESTS)
    apart = {crate: sets - tests[crate] for crate, sets in wheel.items() if not sets <= tests[crate]}
    for crate, sets in sorted(apart.items()):
        print(f"{crate}: the wheel has the features {sorted(sets)}, the tests {sorted(tests[crate])}", file=sys.stderr)
    if apart:
        sys.exit(
            "name these crates with the tests' features in python/Cargo.toml: else they, and all above them, are built twice"
        )


if __name__ == "__main__":
    main()
