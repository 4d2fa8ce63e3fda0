"""Fixtures: the tdcr binary, and random commands."""

import json
import os
import pathlib
import signal
import subprocess

import numpy as np
import pytest

# MuJoCo's renderer without a screen; MuJoCo looks when it is first imported, in whichever test that is.
os.environ.setdefault("MUJOCO_GL", "egl")

# A shell has what it runs in the background ignore Ctrl-C, and `nohup` a hangup. Python leaves ignored what it finds so, and
# hands it on; tests send these.
signal.signal(signal.SIGINT, signal.default_int_handler)
for name in ("SIGHUP", "SIGQUIT"):
    signal.signal(getattr(signal, name), signal.SIG_DFL)


def pytest_collection_modifyitems(items):
    """Begins with the file that takes longest: at the end it would keep one processor waiting for the other."""
    items.sort(key=lambda item: item.path.name != "test_kernels.py")


@pytest.fixture(scope="session")
def tdcr():
    """Runs the tdcr binary with the given arguments and `--json`; returns the parsed result."""
    binary = os.environ.get("TDCR") or str(pathlib.Path(__file__).parents[2] / "target/release/tdcr")

    def run(*arguments):
        command = [binary, *map(str, arguments), "--json", "--quiet"]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
        return json.loads(done.stdout)

    return run


@pytest.fixture
def settle(tdcr):
    """Settles one command (m) of a standard robot with the tdcr binary, with more options."""

    def run(robot, command, payload=0.0, options=()):
        text = ",".join(repr(float(c)) for c in command)
        return tdcr("settle", "--robot", robot, "--command", text, "--payload", payload, *options)

    return run


@pytest.fixture
def rng():
    return np.random.default_rng(20260101)
