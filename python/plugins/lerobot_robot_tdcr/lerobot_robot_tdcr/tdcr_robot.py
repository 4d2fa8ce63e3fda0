"""The robot: a rig behind LeRobot's calls."""

import tomllib
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from lerobot.robots import Robot
from lerobot.utils.errors import DeviceAlreadyConnectedError, DeviceNotConnectedError

import tdcr

from .config_tdcr import TdcrRobotConfig
from .keeper import Keeper


class TdcrRobot(Robot):
    """A tendon-driven continuum robot with its servos and cameras.

    Actions move the rig no faster than its slew and no farther than its limits, tendon by tendon; what is sent is returned.
    Tension is released on ``disconnect``, and by the rig itself on every other way out. Between two calls of LeRobot the robot
    holds its pose. Its loop comes round at most once a ``motion.period``.
    """

    config_class = TdcrRobotConfig
    name = "tdcr"
    connected: ClassVar[Keeper | None] = None
    """The rig that was connected last, for what steers it."""

    def __init__(self, config: TdcrRobotConfig) -> None:
        super().__init__(config)
        self.config = config
        self._file = tomllib.loads(config.rig.read_text(encoding="utf-8"))
        self._rig: tdcr.Rig | None = None
        self._keeper: Keeper | None = None
        self._tendons = [f"tendon{tendon}" for tendon in range(len(self._file["servos"]["ids"]))]

    @property
    def cameras(self) -> dict[str, tuple[int, int, int]]:
        """Shape of the pictures of each camera, from the rig's file; LeRobot counts them."""
        cameras = self._file.get("cameras", []) if self.config.pictures else []
        return {camera["serial"]: (*reversed(camera["camera"]["resolution"]), 3) for camera in cameras}

    @cached_property
    def observation_features(self) -> dict[str, Any]:
        told = ("pos", "current") if self.config.currents else ("pos",)
        return {f"{tendon}.{what}": float for tendon in self._tendons for what in told} | self.cameras

    @cached_property
    def action_features(self) -> dict[str, type]:
        return {f"{tendon}.pos": float for tendon in self._tendons}

    @property
    def is_connected(self) -> bool:
        return self._rig is not None

    @property
    def is_calibrated(self) -> bool:
        return self._rig is not None and set(self._rig.homing()) == {"homed"}

    def calibrate(self) -> None:
        """Finds home again, where servos have lost their turns; a rig that never had one is homed by hand (``tdcr home``)."""
        if self._rig is None:
            raise DeviceNotConnectedError(f"{self} is not connected: call connect() first")
        self._rig.home(recall=True)

    def configure(self) -> None:
        """Nothing: the rig's file says how it is driven."""

    def connect(self, calibrate: bool = True) -> None:
        """Opens the rig, switches the motors on and goes home."""
        if self._rig is not None:
            raise DeviceAlreadyConnectedError(f"{self} is connected")
        rig = tdcr.Rig(self.config.rig, real_time=self.config.real_time)
        self._rig = rig
        try:
            if calibrate and not self.is_calibrated:
                self.calibrate()
            rig.engage()
            rig.go_home()
            self._keeper = TdcrRobot.connected = Keeper(rig, self.config.hold)
        except BaseException:
            self.disconnect()
            raise

    def get_observation(self) -> dict[str, Any]:
        seen: dict[str, Any] = {}
        with self._connected() as rig:
            for tendon, state in zip(self._tendons, rig.state(), strict=True):
                if isinstance(state, tdcr.rig.Silence):
                    raise ConnectionError(f"{tendon}, servo {state.id}: {state.reason}")
                seen[f"{tendon}.pos"] = state.command
                if self.config.currents:
                    seen[f"{tendon}.current"] = state.pull
            if self.cameras:
                views = rig.grab().views
                seen |= {serial: view.color for serial, view in zip(rig.cameras, views, strict=True)}
        return seen

    def send_action(self, action: dict[str, Any]) -> dict[str, Any]:
        with self._connected() as rig:
            wanted = np.array([float(action[f"{tendon}.pos"]) for tendon in self._tendons])
            at = np.array(rig.commanded)
            farthest = rig.slew * rig.period
            sent = at + np.clip(wanted - at, -farthest, farthest)
            if not rig.within_limits(sent):
                # A policy asks for a little more than the rig may; tendons that are at their ends stay there.
                alone = np.where(np.eye(len(at), dtype=bool), sent, at)
                sent = np.where([rig.within_limits(command) for command in alone], sent, at)
            rig.step(sent)
        return {f"{tendon}.pos": float(value) for tendon, value in zip(self._tendons, sent, strict=True)}

    def disconnect(self) -> None:
        if self._keeper is not None:
            self._keeper.end()
        if self._rig is not None:
            self._rig.release()
        self._rig = self._keeper = TdcrRobot.connected = None

    def _connected(self) -> Keeper:
        if self._keeper is None:
            raise DeviceNotConnectedError(f"{self} is not connected: call connect() first")
        return self._keeper
