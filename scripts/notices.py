#!/usr/bin/env python3
"""Writes NOTICES: whose code is in the program and the Python package, and under which licences, with their texts.

scripts/notices.py          writes the file again
scripts/notices.py --check  fails where it is not what would be written

The crates are those that `tdcr` and its Python module depend on in a build for Linux (x86-64), without those of tests and of
build scripts, by Cargo.lock. Of licences that a crate leaves to choose from, MIT is chosen, else Apache-2.0, else the first.
The texts are those in the crates' own packages; equal ones stand once.
"""

import json
import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
FILE = ROOT / "NOTICES"
PLATFORM = "x86_64-unknown-linux-gnu"

# Scripts that lie in the tree, for the page of `tdcr view`: name, licence, source, and where its text is.
SCRIPTS = [("three.js 0.180.0", "MIT", "https://github.com/mrdoob/three.js", ROOT / "src/view/page/three/LICENSE")]

PREFERRED = ["MIT", "Apache-2.0"]
# What the file of a licence is called, where a package has several.
FILE_OF = {
    "MIT": "mit",
    "Apache-2.0": "apache",
    "Zlib": "zlib",
    "BSD-2-Clause": "bsd",
    "BSD-3-Clause": "bsd",
    "Unicode-3.0": "unicode",
}


def crates():
    """Packages that the program is built of, by name and version."""
    command = ["cargo", "metadata", "--format-version", "1", "--locked", "--filter-platform", PLATFORM]
    found = subprocess.run(command, cwd=ROOT, check=True, stdout=subprocess.PIPE).stdout
    metadata = json.loads(found)
    packages = {package["id"]: package for package in metadata["packages"]}
    nodes = {node["id"]: node for node in metadata["resolve"]["nodes"]}
    modules = (package["id"] for package in metadata["packages"] if package["name"] == "tdcr-python")
    seen, waiting = set(), [metadata["resolve"]["root"], *modules]
    while waiting:
        crate = waiting.pop()
        if crate in seen:
            continue
        seen.add(crate)
        for dependency in nodes[crate]["deps"]:
            if any(kind["kind"] is None for kind in dependency["dep_kinds"]):
                waiting.append(dependency["pkg"])
    others = (packages[crate] for crate in seen if packages[crate]["source"])
    return sorted(others, key=lambda package: (package["name"], package["version"]))


def chosen(expression):
    """The licences, all of which are kept, that are chosen of an SPDX expression."""
    kept = []
    for part in re.split(r"\s+AND\s+", expression.replace("/", " OR ")):
        choices = [word for word in re.split(r"\s+OR\s+|[()]", part) if word.strip()]
        preferred = [licence for licence in PREFERRED if licence in choices]
        kept.append((preferred or choices)[0].strip())
    return kept


def texts(package):
    """The texts of the licences chosen, and notices of their own."""
    folder = Path(package["manifest_path"]).parent
    names = re.compile(r"^(licen[sc]e|copying|copyright|notice|unlicense)", re.IGNORECASE)
    files = sorted(path for path in folder.iterdir() if path.is_file() and names.match(path.name))
    licences = chosen(package["license"] or "")
    wanted = [FILE_OF.get(licence, licence.lower()) for licence in licences]
    named = [path for path in files if any(word in path.name.lower() for word in wanted)]
    notices = [path for path in files if path.name.lower().startswith(("notice", "copyright"))]
    kept = dict.fromkeys((named or files) + notices)
    return [path.read_text(encoding="utf-8", errors="replace").strip() for path in kept]


def notices():
    """What the file is to hold."""
    packages = crates()
    lines = [
        "Third-party notices",
        "===================",
        "",
        "`tdcr` is built with the crates below, and holds the scripts after them. Written by scripts/notices.py; do not edit.",
        "",
    ]
    holders = {}
    for package in packages:
        name = f"{package['name']} {package['version']}"
        source = package["repository"] or f"https://crates.io/crates/{package['name']}"
        lines.append(f"- {name}: {package['license']}, {source}")
        found = texts(package)
        for text in found:
            holders.setdefault(" ".join(text.split()), (text, []))[1].append(name)
        if not found:
            authors = ", ".join(package["authors"]) or "its authors"
            text = f"Copyright {authors}. {package['license']}; the package holds no text, LICENSE-* beside this file have it."
            holders.setdefault(text, (text, []))[1].append(name)
    for name, licence, source, file in SCRIPTS:
        lines.append(f"- {name}: {licence}, {source}")
        text = file.read_text(encoding="utf-8").strip()
        holders.setdefault(" ".join(text.split()), (text, []))[1].append(name)
    for text, names in holders.values():
        lines += ["", "-" * 80, "Of " + ", ".join(names), "", *(line.rstrip() for line in text.splitlines())]
    return "\n".join(lines) + "\n"


def main():
    expected = notices()
    if sys.argv[1:] == ["--check"]:
        if not FILE.exists() or FILE.read_text(encoding="utf-8") != expected:
            sys.exit("NOTICES is not of the crates in Cargo.lock; run scripts/notices.py")
    elif sys.argv[1:]:
        sys.exit(__doc__)
    else:
        FILE.write_text(expected, encoding="utf-8")


if __name__ == "__main__":
    main()
