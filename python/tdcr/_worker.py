"""A process of :func:`tdcr.sweep`: it is sent a function, then conditions one by one, and sends back what comes of each.

It is a process of its own, not one of :mod:`multiprocessing`: that would import the main module again, which a notebook and a
script from the standard input do not have, and which starts the sweep again where a script does not guard it.
"""

from __future__ import annotations

import json
import pickle
import signal
import subprocess
import sys
import traceback
from contextlib import suppress
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from typing import Any

import cloudpickle

from tdcr._threads import set_threads
from tdcr.errors import InputError, SweepError

_START = """\
import json, sys
sys.path[:] = json.loads(sys.argv[2])
from tdcr._worker import serve
serve(int(sys.argv[1]))
"""
"""What a worker runs: it imports from where its parent does."""


class Worker:
    """A worker, as the process that started it sees it."""

    def __init__(self, setup: bytes) -> None:
        self.connection, theirs = Pipe()
        with theirs:
            number = theirs.fileno()
            command = [sys.executable, "-c", _START, str(number), json.dumps(sys.path)]
            self.process = subprocess.Popen(command, pass_fds=[number], stdin=subprocess.DEVNULL)
        self.send(setup)

    def send(self, message: bytes) -> None:
        """Sends a condition. Where the worker is dead, :meth:`receive` says so."""
        with suppress(OSError):
            self.connection.send_bytes(message)

    def receive(self) -> tuple[bool, Any, str]:
        """Whether there is a result; the result, or the exception in its place; and where that was raised.

        Raises:
            EOFError: If the worker is dead.
        """
        try:
            return pickle.loads(self.connection.recv_bytes())  # type: ignore[no-any-return]
        except OSError as error:
            raise EOFError from error

    def end(self) -> str:
        """Waits until a worker that is dead has ended; returns how."""
        self.connection.close()
        status = self.process.wait()
        if status >= 0:
            return f"ended with exit status {status}"
        name = signal.Signals(-status).name if -status in set(signal.Signals) else f"signal {-status}"
        hint = ": it may need more memory than there is" if name == "SIGKILL" else ""
        return f"was killed by {name}{hint}"

    def stop(self) -> None:
        """Ends the worker, whatever it does."""
        self.process.kill()
        self.end()


def serve(number: int) -> None:
    """Computes the conditions that come over the connection of this file descriptor, until it is closed."""
    # Ctrl-C is for the parent, which ends its workers.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with Connection(number) as connection:
        try:
            function, cpus = pickle.loads(connection.recv_bytes())
            set_threads(cpus)
            while True:
                condition = connection.recv_bytes()
                connection.send_bytes(_answer(function, condition))
        except (EOFError, BrokenPipeError, ConnectionResetError):
            return
        except Exception as error:
            failure = SweepError(
                f"a worker cannot load the function: {type(error).__name__}: {error}; expected one that a module which workers "
                "can import defines, or the script or notebook itself"
            )
            connection.send_bytes(pickle.dumps((False, failure, traceback.format_exc())))


def _answer(function: Any, condition: bytes) -> bytes:
    try:
        result = function(pickle.loads(condition))
        try:
            answer: bytes = cloudpickle.dumps((True, result, ""))
        except Exception as error:
            raise InputError(f"what the function returned cannot be sent back: {type(error).__name__}: {error}") from error
        return answer
    except BaseException as error:
        where = traceback.format_exc()
        try:
            answer = cloudpickle.dumps((False, error, where))
            # Some exceptions are written but cannot be read.
            pickle.loads(answer)
            return answer
        except Exception:
            return pickle.dumps((False, SweepError(f"{type(error).__name__}: {error}"), where))
