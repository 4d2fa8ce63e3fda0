#!/usr/bin/env python3
"""Tries what is in `dist/` where nothing of this checkout is: `make try-release`, after `make release`.

- The wheel in an empty environment of each CPython from 3.11 on (pyenv's, the system's, and those that uv fetches): README's
  Python quick start with the output that it shows, a step of an environment, a training of 20 steps, and `tdcr` on the path.
- The source distribution, built without a network but for what builds it and installed.
- The tarball in a bare Debian by debootstrap, of the release that DEBIAN names: it settles a robot, and runs the demo.

Needs a network for packages; what could not be tried is said at the end, and the exit status is that of what was.
"""

import argparse
import os
import re
import shutil
import subprocess
import sys
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
OLDEST = (3, 11)
# Versions of CPython that uv fetches where they are not here.
FETCHED = ["3.11", "3.12", "3.13", "3.14", "3.15"]
# The oldest Debian whose archive is served still.
DEBIAN = "bullseye"
MIRROR = "http://deb.debian.org/debian"

TRAINING = """
import gymnasium, numpy as np, tdcr, tdcr.envs
env = gymnasium.make("tdcr/Reach2m-v0")
env.reset(seed=0)
observation, reward, terminated, truncated, info = env.step(env.action_space.sample())
assert env.observation_space.contains(observation) and np.isfinite(reward)
data = tdcr.collect("2m", "data", samples=20, points=200)
run = tdcr.train(data, "run", steps=20, width=32, depth=3, embedding=32)
cloud = run.predictor.predict(tdcr.Robot("2m").mean_command, points=100)
assert run.steps == 20 and cloud.shape == (1, 100, 3) and np.isfinite(cloud).all()
"""

SETTLE = ["settle", "--robot", "2m", "--command", "0.034,0.007,0.001,0.026,0.015,0.019", "--payload", "0.02"]


class Failure(Exception):
    """What was tried does not work."""


def bare_environment(path):
    """No variable of this shell but where programs are, and how packages are reached."""
    kept = {
        name: value for name, value in os.environ.items() if name.startswith(("PIP_", "SSL_", "UV_")) or "proxy" in name.lower()
    }
    return kept | {"PATH": f"{path}:/usr/bin:/bin", "HOME": os.environ.get("HOME", "/"), "LANG": "C.UTF-8"}


def run(command, **options):
    done = subprocess.run([str(word) for word in command], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, **options)
    if done.returncode:
        raise Failure(f"{' '.join(str(word) for word in command[:4])} ..: exit status {done.returncode}\n{done.stdout[-3000:]}")
    return done.stdout


def uv_at_hand():
    """The path's, the tests', or that of the tools of the release."""
    own = [ROOT / ".venv/bin/uv", ROOT / "target/release-tools/bin/uv"]
    return shutil.which("uv") or str(next((uv for uv in own if uv.exists()), own[-1]))


def pythons(uv, scratch):
    """Interpreters by what `python --version` says."""
    found = {}

    def add(path):
        try:
            said = run([path, "-c", "import sys, platform; print(sys.version_info[:2], platform.python_version())"]).strip()
        except (Failure, OSError):
            return
        minor = re.match(r"\((\d+), (\d+)\) (\S+)", said)
        if minor and (int(minor[1]), int(minor[2])) >= OLDEST:
            found.setdefault(minor[3], Path(path))

    for path in sorted(Path(os.environ.get("PYENV_ROOT", Path.home() / ".pyenv")).glob("versions/*/bin/python")):
        add(path)
    for path in sorted(Path("/usr/bin").glob("python3.[0-9][0-9]")):
        add(path)
    fetched = scratch / "pythons"
    for minor in FETCHED:
        try:
            run([uv, "python", "install", "--no-progress", "--install-dir", fetched, "--no-bin", minor])
        except (Failure, OSError) as failure:
            print(f"CPython {minor} could not be fetched: {str(failure).splitlines()[-1]}")
    for path in sorted(fetched.glob("cpython-*/bin/python3")):
        add(path)
    return found


def quick_start():
    """README's Python code, and what it says it prints."""
    code, output = re.search(r"(?s)```python\n(.*?)```\s+```text\n(.*?)```", (ROOT / "README.md").read_text()).groups()
    return code, output


def try_package(python, package, scratch, uv, commit, source=False):
    """Installs a package into an empty environment, and uses it from an empty folder."""
    shutil.rmtree(scratch, ignore_errors=True)
    scratch.mkdir(parents=True)
    here = {"cwd": scratch}
    run([python, "-m", "venv", "venv"], **here)
    inside = scratch / "venv/bin"
    environment = bare_environment(inside)
    if source:
        # As for a wheel, but for a compiler; crates are those that were fetched before.
        cargo = Path(shutil.which("cargo")).parent
        environment |= {"PATH": f"{inside}:{cargo}:/usr/bin:/bin", "CARGO_NET_OFFLINE": "true"}
        environment |= {
            name: os.environ[name] for name in ("CARGO_HOME", "RUSTUP_HOME", "CARGO_TARGET_DIR") if name in os.environ
        }
    here["env"] = environment
    started = time.monotonic()
    run([inside / "python", "-m", "pip", "install", "--disable-pip-version-check", f"{package}[envs]"], **here)
    seconds = time.monotonic() - started
    code, output = quick_start()
    printed = run(["python", "-c", code], **here)
    if printed.split() != output.split():
        raise Failure(f"README's quick start prints\n{printed}\nwhere README has\n{output}")
    run(["python", "-c", TRAINING], **here)
    said = run(["tdcr", "--version"], **here)
    if commit and commit not in said:
        raise Failure(f"tdcr --version says {said!r}, without the commit {commit}")
    run(["tdcr", *SETTLE], **here)
    shutil.rmtree(scratch / "venv")
    return f"installed in {seconds:.0f} s"


def try_tarball(tarball, scratch, commit):
    """In a bare Debian, in which there is no Python either."""
    if not shutil.which("debootstrap"):
        raise FileNotFoundError("debootstrap is not installed")
    if os.geteuid():
        raise FileNotFoundError("debootstrap needs root")
    root = scratch / DEBIAN
    if not (root / "bin/sh").exists():
        run(["debootstrap", "--variant=minbase", DEBIAN, root, MIRROR])
    shutil.rmtree(root / "opt", ignore_errors=True)
    (root / "opt").mkdir()
    run(["tar", "-xzf", tarball, "-C", root / "opt", "--strip-components=1"])
    inside = ["chroot", root, "/usr/bin/env", "-i", "PATH=/opt/bin:/usr/bin:/bin", "HOME=/root"]
    said = run([*inside, "tdcr", "--version"])
    if commit and commit not in said:
        raise Failure(f"tdcr --version says {said!r}, without the commit {commit}")
    settled = run([*inside, "tdcr", *SETTLE])
    # As long as a minute allows: the demo resumes, and here it is enough that it goes on.
    began = run(
        [
            *inside,
            "sh",
            "-c",
            "cd /root && timeout 60 tdcr demo --out demo; status=$?; [ $status = 124 ] || [ $status = 0 ]; ls demo",
        ]
    )
    glibc = run([*inside, "sh", "-c", "ldd --version | head -n 1"]).split()[-1]
    if "tension" not in settled.lower() or "stages.json" not in began:
        raise Failure(f"tdcr settle or tdcr demo:\n{settled}\n{began}")
    return f"glibc {glibc}; the demo ran for a minute"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--dist", type=Path, default=ROOT / "dist")
    parser.add_argument("--scratch", type=Path, default=ROOT / "target/stranger")
    parser.add_argument("--uv", default=uv_at_hand())
    parser.add_argument("--only", choices=["wheel", "sdist", "tarball"], help="one of the three")
    parser.add_argument("--commit", help="what `tdcr --version` is to say [default: that of the checkout]")
    args = parser.parse_args()
    dist, scratch = args.dist.resolve(), args.scratch.resolve()
    scratch.mkdir(parents=True, exist_ok=True)
    commit = args.commit or run(["git", "-C", ROOT, "rev-parse", "HEAD"]).strip()

    tries = []
    here = pythons(args.uv, scratch)
    if not here:
        sys.exit("no CPython from 3.11 on was found")
    if args.only in (None, "wheel"):
        (wheel,) = dist.glob("*.whl")
        for name, python in here.items():
            tries.append(
                (f"wheel, CPython {name} ({python})", lambda p=python: try_package(p, wheel, scratch / "wheel", args.uv, commit))
            )
    if args.only in (None, "sdist"):
        (sources,) = (path for path in dist.glob("tdcr-*.tar.gz") if "linux" not in path.name)
        python = next(iter(here.values()))
        tries.append(
            ("source distribution", lambda: try_package(python, sources, scratch / "sdist", args.uv, commit, source=True))
        )
    if args.only in (None, "tarball"):
        (tarball,) = dist.glob("tdcr-*-linux-gnu.tar.gz")
        tries.append((f"tarball, Debian {DEBIAN}", lambda: try_tarball(tarball, scratch, commit)))

    failed = False
    for name, attempt in tries:
        try:
            print(f"{name}: {attempt()}", flush=True)
        except FileNotFoundError as missing:
            print(f"{name}: NOT TRIED: {missing}", flush=True)
        except Failure as failure:
            failed = True
            print(f"{name}: FAILED: {failure}", flush=True)
    sys.exit(failed)


if __name__ == "__main__":
    main()
