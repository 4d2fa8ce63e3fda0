"""The command line that `pip` installs is that of the binary: its words, its exit status, and how Ctrl-C ends it."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from by_command_line import TDCR

BY_PIP = [sys.executable, "-m", "tdcr"]


def run(front: list[str], *arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([*front, *arguments], capture_output=True, text=True, timeout=60.0, check=False)


@pytest.mark.parametrize(
    ("arguments", "status"),
    [
        (["--version"], 0),
        (["settle", "--robot", "2m", "--command", "0.034,0.007,0.001,0.026,0.015,0.019", "--json"], 0),
        (["settle", "--robot", "9m", "--random", "1"], 1),
        (["fly"], 2),
        (["settle", "--random", "-1"], 2),
        (["--threads", "0", "data", "info", "nowhere"], 2),
    ],
)
def test_words_and_exit_status_are_those_of_the_binary(arguments: list[str], status: int) -> None:
    ours, binary = run(BY_PIP, *arguments), run([str(TDCR)], *arguments)
    assert (ours.returncode, ours.stdout, ours.stderr) == (binary.returncode, binary.stdout, binary.stderr)
    assert ours.returncode == status
    if "--json" in arguments:
        assert json.loads(ours.stdout)["converged"] is True


@pytest.mark.parametrize("resumes", [True, False], ids=["safe point", "at once"])
def test_ctrl_c_ends_it_as_it_ends_the_binary(resumes: bool, tmp_path: Path) -> None:
    for kind, front in (("ours", BY_PIP), ("binary", [str(TDCR)])):
        # One that stops at a safe point and can be resumed, and one that ends at once.
        out = ["collect", "--samples", "100000", "--out", str(tmp_path / kind)]
        work = out if resumes else ["settle", "--random", "10000000"]
        with subprocess.Popen([*front, *work], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True) as running:
            assert running.stderr is not None
            begun = running.stderr.readline()
            # Until its first step asks whether to go on, a signal ends it at once.
            time.sleep(0.5)
            running.send_signal(signal.SIGINT)
            said = running.stderr.read()
            assert running.wait(timeout=60.0) == 130, said
        assert begun
        if resumes:
            assert "stopping at the next safe point" in said and "run the same command again" in said
        assert "Traceback" not in said and "KeyboardInterrupt" not in said
