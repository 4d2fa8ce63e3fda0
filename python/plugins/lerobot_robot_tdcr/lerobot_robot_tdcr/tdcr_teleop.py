"""The teleoperator: a hand on the keys, or a table of commands, for the rig that is connected."""

import contextlib
import csv
import os
import select
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from lerobot.teleoperators import Teleoperator
from lerobot.utils.errors import DeviceAlreadyConnectedError, DeviceNotConnectedError

import tdcr

from .config_tdcr_teleop import TdcrTeleopConfig
from .keeper import Keeper
from .tdcr_robot import TdcrRobot

KEYS = {"w": (0, 1, 0), "s": (0, -1, 0), "d": (1, 0, 0), "a": (-1, 0, 0), "+": (0, 0, 1), "=": (0, 0, 1), "-": (0, 0, -1)}
"""Directions in the world's axes: those of `tdcr jog --tip`."""


class TdcrTeleop(Teleoperator):
    """Steers the tip of the robot `tdcr` that this process has connected.

    All keys of a terminal that came since the last frame count; of a file or a pipe, a character a frame. What would bring the
    tip out of reach does nothing.
    """

    config_class = TdcrTeleopConfig
    name = "tdcr"

    def __init__(self, config: TdcrTeleopConfig) -> None:
        super().__init__(config)
        self.config = config
        self._connected: contextlib.ExitStack | None = None
        self._keys = -1
        self._rows: list[list[float]] = [] if config.commands is None else list(_rows(config.commands))
        self._row = 0
        self._wanted: Any = None

    @property
    def action_features(self) -> dict[str, type]:
        with self._rig() as rig:
            return {f"tendon{tendon}.pos": float for tendon in range(len(rig.ids))}

    @property
    def feedback_features(self) -> dict[str, type]:
        return {}

    @property
    def is_connected(self) -> bool:
        return self._connected is not None

    @property
    def is_calibrated(self) -> bool:
        return True

    def calibrate(self) -> None:
        """Nothing."""

    def configure(self) -> None:
        """Nothing."""

    def connect(self, calibrate: bool = True) -> None:
        if self._connected is not None:
            raise DeviceAlreadyConnectedError(f"{self} is connected")
        with contextlib.ExitStack() as opened:
            if not self._rows:
                self._keys = opened.enter_context(_opened(self.config.keys))
                print("w s: along y; a d: along x; + -: along z", file=sys.stderr)
            self._connected = opened.pop_all()

    def get_action(self) -> dict[str, Any]:
        if self._connected is None:
            raise DeviceNotConnectedError(f"{self} is not connected: call connect() first")
        if self._rows:
            self._wanted = self._rows[self._row % len(self._rows)]
            self._row += 1
        else:
            self._steer()
        return {f"tendon{tendon}.pos": float(value) for tendon, value in enumerate(self._wanted)}

    def send_feedback(self, feedback: dict[str, Any]) -> None:
        """Nothing: keys push back on nobody."""

    def disconnect(self) -> None:
        if self._connected is not None:
            self._connected.close()
        self._connected = None

    def _steer(self) -> None:
        """Takes what the keys ask for into the command that is wanted."""
        with self._rig() as rig:
            if self._wanted is None:
                self._wanted = rig.commanded
            by = self.config.step * sum((np.array(KEYS[key]) for key in _pressed(self._keys) if key in KEYS), np.zeros(3))
            if by.any():
                with contextlib.suppress(tdcr.errors.RigError):
                    self._wanted = rig.steer(by)

    def _rig(self) -> Keeper:
        if TdcrRobot.connected is None:
            raise DeviceNotConnectedError("no robot of type tdcr is connected, which this teleoperator steers")
        return TdcrRobot.connected


def _rows(file: Path) -> Iterator[list[float]]:
    """The commands of a table, by the names of its columns."""
    with file.open(newline="", encoding="utf-8") as lines:
        table = csv.DictReader(lines)
        names = {name.split()[0]: name for name in table.fieldnames or [] if name.split()}
        columns = [names[f"c{k}"] for k in range(len(names)) if f"c{k}" in names]
        if not columns:
            raise ValueError(f"{file} has no columns c0, c1, ... in its first line")
        for row in table:
            yield [float(row[column]) for column in columns]


@contextlib.contextmanager
def _opened(keys: Path | None) -> Iterator[int]:
    """The file of the keys; a terminal gives each at once, and shows none."""
    # Opened for writing, too, a pipe waits for nobody and has no end.
    file = sys.stdin.fileno() if keys is None else os.open(keys, os.O_RDWR)
    try:
        if not os.isatty(file):
            yield file
            return
        import termios
        import tty

        before = termios.tcgetattr(file)
        tty.setcbreak(file)
        try:
            yield file
        finally:
            termios.tcsetattr(file, termios.TCSADRAIN, before)
    finally:
        if keys is not None:
            os.close(file)


def _pressed(keys: int) -> str:
    """What was pressed since one last asked."""
    if not select.select([keys], [], [], 0.0)[0]:
        return ""
    return os.read(keys, 64 if os.isatty(keys) else 1).decode(errors="ignore")
