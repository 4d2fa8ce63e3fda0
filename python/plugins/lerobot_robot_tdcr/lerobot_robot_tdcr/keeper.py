"""A rig that holds its pose while LeRobot does something else."""

import threading
from types import TracebackType

import tdcr


class Keeper:
    """Tells the rig its last command again where LeRobot is silent, as while it encodes an episode.

    The servos' watchdogs would stop the robot else. Calls of the rig are made in a ``with`` block, between those of the thread
    that this is.

    Args:
        rig: The rig, its motors on.
        longest: How long it may be silent (s, by the rig's clock); the tension is released then.
    """

    def __init__(self, rig: tdcr.Rig, longest: float) -> None:
        self._rig, self._longest = rig, longest
        self._turn = threading.Lock()
        self._last = rig.time
        self._error: Exception | None = None
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._keep, daemon=True)
        self._thread.start()

    def __enter__(self) -> tdcr.Rig:
        self._turn.acquire()
        if self._error is not None:
            self._turn.release()
            raise self._error
        return self._rig

    def __exit__(self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None) -> None:
        self._last = self._rig.time
        self._turn.release()

    def end(self) -> None:
        """Ends the thread."""
        self._ended.set()
        self._thread.join()

    def _keep(self) -> None:
        while self._error is None and not self._ended.wait(self._rig.period):
            with self._turn:
                silent = self._rig.time - self._last
                # Soon enough for the watchdog, of which two periods are no more than its time, and not between two frames.
                if silent < self._rig.period:
                    continue
                try:
                    if silent > self._longest:
                        self._rig.release()
                        reason = f"LeRobot was silent for {silent:.0f} s, and robot.hold is {self._longest:.0f} s"
                        raise tdcr.errors.RigError(f"{reason}; all motors were switched off")
                    self._rig.step(self._rig.commanded)
                except tdcr.errors.TdcrError as error:
                    self._error = error
