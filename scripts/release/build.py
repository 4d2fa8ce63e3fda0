#!/usr/bin/env python3
"""Builds what is released, from a clean checkout, into `dist/`: `make release`.

- the Python package as a wheel for this kind of machine (CPython's stable ABI) and as a source distribution;
- the command line as a tarball with completions and manual pages;
- the crates, as cargo packages them;
- a bill of materials (CycloneDX), the section of CHANGELOG.md, and checksums of all.

scripts/release/build.py --no-verify    does not compile the packaged crates, which takes as long as all else
scripts/release/build.py --allow-dirty  takes a checkout with changes; what it makes names no commit

On Linux, programs are linked by zig against the C library of GLIBC, the oldest that Rust's own library runs on, whatever is
installed here. maturin then refuses a wheel that needs a newer one. Builds are of the profile `dist`: those of the tests,
optimised across crates.
"""

import argparse
import gzip
import hashlib
import io
import json
import os
import re
import shutil
import stat
import struct
import subprocess
import sys
import sysconfig
import tarfile
import tempfile
import zipfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "scripts"))

import version  # noqa: E402

GLIBC = "2.17"
PLATFORM = "manylinux2014"
# What a wheel may take, in bytes: somewhat more than today, so that it does not grow unseen.
LARGEST_WHEEL = 14_200_000
# Loads a module as `import` does, but for its first function.
LOAD = "import ctypes, sys; ctypes.PyDLL(sys.argv[1])"
# Members of the workspace that are not published.
UNPUBLISHED = ["tdcr-python", "tdcr-mujoco"]
ON_LINUX = sys.platform == "linux"


def run(*command, **options):
    """Runs a command in the checkout, and ends where it fails."""
    print("$", *command, file=sys.stderr, flush=True)
    return subprocess.run([str(word) for word in command], cwd=ROOT, check=True, **options)


def text_of(*command):
    return run(*command, stdout=subprocess.PIPE, text=True).stdout.strip()


class Tools:
    """maturin and zig, of fixed versions, in an environment of their own."""

    def __init__(self, target):
        requirements = ROOT / "scripts/release/requirements.txt"
        self.dir = target / "release-tools"
        self.bin = self.dir / ("Scripts" if os.name == "nt" else "bin")
        stamp = self.dir / "requirements.installed"
        if not stamp.exists() or stamp.read_text() != requirements.read_text():
            run(sys.executable, "-m", "venv", "--clear", self.dir)
            run(self.bin / "python", "-m", "pip", "install", "-q", "--disable-pip-version-check", "-r", requirements)
            stamp.write_text(requirements.read_text())
        self.maturin = self.bin / "maturin"

    def linker(self):
        """Arguments of rustc: what a program or module is linked by."""
        if not ON_LINUX:
            return []
        wrapper = self.bin / "link-for-old-glibc"
        machine = os.uname().machine
        # cargo-zigbuild leaves out what rustc asks of gcc alone.
        command = f'exec cargo-zigbuild zig cc -- -target {machine}-linux-gnu.{GLIBC} "$@"'
        wrapper.write_text(f'#!/bin/sh\nPATH="{self.bin}:$PATH"\n{command}\n')
        wrapper.chmod(wrapper.stat().st_mode | stat.S_IXUSR)
        return ["-C", f"linker={wrapper}"]


def commit_of_clean_checkout(allow_dirty):
    changed = text_of("git", "status", "--porcelain")
    if changed and not allow_dirty:
        sys.exit(f"the checkout has changes; commit them first:\n{changed}")
    return None if changed else text_of("git", "rev-parse", "HEAD")


def sections(program):
    """Names of the sections of a program of Linux (64-bit ELF, little-endian); none of other systems'."""
    if not program.startswith(b"\x7fELF\x02\x01"):
        return []
    (table,) = struct.unpack_from("<Q", program, 0x28)
    size, count, names = struct.unpack_from("<HHH", program, 0x3A)
    headers = [struct.unpack_from("<IIQQQQ", program, table + size * k) for k in range(count)]
    start = headers[names][4]
    return [program[start + header[0] :].split(b"\0", 1)[0] for header in headers]


def wheel(tools, dist, python):
    """The wheel, in the smallest build that runs on the oldest systems."""
    options = ["--profile", "dist", "--locked", "--interpreter", python, "--out", dist, "--compression-level", "9"]
    if ON_LINUX:
        options += ["--compatibility", PLATFORM]
    run(tools.maturin, "build", *options, "--", *tools.linker())
    (built,) = dist.glob("*.whl")
    with zipfile.ZipFile(built) as archive:
        (module,) = (name for name in archive.namelist() if re.search(r"_tdcr.*\.(so|pyd)$", name))
        if debug := [name for name in sections(archive.read(module)) if name.startswith(b".debug")]:
            sys.exit(f"{built.name}: {module} has debug information: {debug}")
        # Linkers let a module lack symbols; whoever imports it does not.
        with tempfile.TemporaryDirectory() as folder:
            run(python, "-c", LOAD, archive.extract(module, folder))
        (bill,) = (name for name in archive.namelist() if name.endswith(".cyclonedx.json"))
        materials = archive.read(bill)
    size = built.stat().st_size
    if size > LARGEST_WHEEL:
        sys.exit(f"{built.name} has {size} bytes, of at most {LARGEST_WHEEL}")
    return materials


def bill_of_materials(materials, dist, number):
    """What the wheel and the command line consist of, as maturin writes it: the wheel's crate depends on all others."""
    bill = json.loads(materials)
    named = {(part["name"], part["version"]) for part in bill["components"]}
    tree = text_of("cargo", "tree", "--locked", "-p", "tdcr", "-e", "normal", "--prefix", "none", "-f", "{p}")
    built = set(re.findall(r"(?m)^(\S+) v(\S+)", tree))
    missing = {f"{name} {version}" for name, version in built - named if name not in UNPUBLISHED}
    if missing:
        sys.exit(f"the bill of materials lacks {', '.join(sorted(missing))}")
    (dist / f"tdcr-{number}.cdx.json").write_text(json.dumps(bill, indent=1) + "\n")


def source_distribution(tools, dist, commit, time):
    """Sources for `pip`, with the commit, which they would else not know; its bytes depend on the sources alone."""
    told = ROOT / "COMMIT"
    try:
        if commit:
            told.write_text(commit + "\n")
        # For builds, it would have libraries in C compiled anew, and all above them.
        run(tools.maturin, "sdist", "--out", dist, env=os.environ | {"SOURCE_DATE_EPOCH": str(time)})
    finally:
        told.unlink(missing_ok=True)


def packed(files, archive, time):
    """A tarball whose bytes depend on the files alone, and `time`, seconds since the epoch."""
    with archive.open("wb") as raw:
        squeezed = gzip.GzipFile(fileobj=raw, mode="wb", mtime=time, filename="")
        with squeezed, tarfile.open(fileobj=squeezed, mode="w") as tar:
            for name, (content, mode) in sorted(files.items()):
                entry = tarfile.TarInfo(name)
                entry.size, entry.mode, entry.mtime = len(content), mode, time
                tar.addfile(entry, io.BytesIO(content))


def command_line(tools, dist, number, target, time):
    """The command with completions and manual pages."""
    # With the wheel's crate, so that both share one build of what they depend on.
    run("cargo", "rustc", "--profile", "dist", "--locked", "--bin", "tdcr", "-p", "tdcr", "--", *tools.linker())
    suffix = ".exe" if os.name == "nt" else ""
    program = target / "dist" / f"tdcr{suffix}"
    host = re.search(r"host: (\S+)", text_of("rustc", "-vV"))[1]
    name = f"tdcr-{number}-{host}"
    files = {f"{name}/bin/tdcr{suffix}": (program.read_bytes(), 0o755)}
    for shell, path in {
        "bash": "share/bash-completion/completions/tdcr",
        "zsh": "share/zsh/site-functions/_tdcr",
        "fish": "share/fish/vendor_completions.d/tdcr.fish",
    }.items():
        script = run(program, "completions", shell, stdout=subprocess.PIPE).stdout
        files[f"{name}/{path}"] = (script, 0o644)
    pages = target / "release-man"
    shutil.rmtree(pages, ignore_errors=True)
    run(program, "manual", "--out", pages, "--quiet")
    for page in pages.iterdir():
        files[f"{name}/share/man/man1/{page.name}"] = (page.read_bytes(), 0o644)
    for document in ("LICENSE-APACHE", "LICENSE-MIT", "NOTICES", "README.md", "CHANGELOG.md"):
        files[f"{name}/share/doc/tdcr/{document}"] = ((ROOT / document).read_bytes(), 0o644)
    packed(files, dist / f"{name}.tar.gz", time)


def crates(dist, target, number, verify, allow_dirty):
    """The crates as cargo packages them, each compiled from its package beside the others, none of which is published yet."""
    options = [f"--exclude={name}" for name in UNPUBLISHED]
    if allow_dirty:
        options.append("--allow-dirty")
    if verify:
        # Whether they compile is checked, not how fast they are: optimised, this would take as long as all that is above.
        # Here alone each has the features of its own dependencies only, without which code may be left over.
        options += ["--config", 'build.rustflags=["-Dwarnings"]']
        options += ["--config", 'profile.dev.package."*".opt-level=0', "--config", "profile.dev.debug=false"]
    else:
        options.append("--no-verify")
    run("cargo", "package", "--workspace", "--locked", *options)
    for package in sorted((target / "package").glob(f"*-{number}.crate")):
        shutil.copy(package, dist)


def notes(dist, number):
    """The section of CHANGELOG.md."""
    sections = re.split(r"(?m)^## ", (ROOT / "CHANGELOG.md").read_text())
    (section,) = (section for section in sections if re.match(rf"{re.escape(number)}\b", section))
    (dist / f"tdcr-{number}-notes.md").write_text("# tdcr " + section.rstrip() + "\n")


def checksums(dist):
    """As `sha256sum --check` reads them."""
    files = sorted(path for path in dist.iterdir() if path.name != "SHA256SUMS")
    lines = [f"{hashlib.sha256(path.read_bytes()).hexdigest()}  {path.name}\n" for path in files]
    (dist / "SHA256SUMS").write_text("".join(lines))
    for path in files:
        print(f"{path.stat().st_size:>11,} {path.name}")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=ROOT / "dist", help="folder that is made anew")
    parser.add_argument("--allow-dirty", action="store_true", help="take a checkout with changes")
    parser.add_argument("--no-verify", action="store_true", help="do not compile the packaged crates")
    # A tool's own Python may not be the one that a user has: the wheel is the same for all from 3.11 on.
    parser.add_argument("--python", default=sysconfig.get_config_var("EXENAME") or sys.executable, help="a CPython from 3.11 on")
    args = parser.parse_args()

    version.check()
    number = version.version()
    commit = commit_of_clean_checkout(args.allow_dirty)
    target = Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target")).resolve()
    if commit:
        os.environ["TDCR_COMMIT"] = commit
    time = int(text_of("git", "log", "-1", "--format=%ct"))
    dist = args.out.resolve()
    shutil.rmtree(dist, ignore_errors=True)
    dist.mkdir(parents=True)

    tools = Tools(target)
    bill_of_materials(wheel(tools, dist, args.python), dist, number)
    command_line(tools, dist, number, target, time)
    source_distribution(tools, dist, commit, time)
    crates(dist, target, number, not args.no_verify, args.allow_dirty)
    notes(dist, number)
    checksums(dist)


if __name__ == "__main__":
    main()
