"""The robot: a rig behind LeRobot's calls."""

import tomllib
from functools import cached_property
from typing import Any

import numpy as np
from lerobot.robots import Robot
from lerobot.utils.errors import DeviceAlreadyConnectedError, DeviceNotConnectedError

import tdcr

from .config_tdcr import TdcrRobotConfig


class TdcrRobot(Robot):
    """A tendon-driven continuum robot with its servos and cameras.

    Actions move the rig no faster than its slew; what is sent is returned. Tension is released on ``disconnect``, and by the rig
    itself on every other way out. LeRobot's loop has to come round twice in the rig's watchdog (``safety.watchdog``), at most
    once a ``motion.period``.
    """

    config_class = TdcrRobotConfig
    name = "tdcr"

    def __init__(self, config: TdcrRobotConfig) -> None:
        super().__init__(config)
        self.config = config
        self._file = tomllib.loads(config.rig.read_text(encoding="utf-8"))
        self._rig: tdcr.Rig | None = None
        self._tendons = [f"tendon{tendon}" for tendon in range(len(self._file["servos"]["ids"]))]

    @property
    def _sizes(self) -> dict[str, tuple[int, int, int]]:
        """Shape of the pictures of each camera, from the rig's file."""
        cameras = self._file.get("cameras", []) if self.config.pictures else []
        return {camera["serial"]: (*reversed(camera["camera"]["resolution"]), 3) for camera in cameras}

    @cached_property
    def observation_features(self) -> dict[str, Any]:
        servos = {f"{tendon}.{what}": float for tendon in self._tendons for what in ("pos", "current")}
        return {**servos, **self._sizes}

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
        self._connected().home(recall=True)

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
        except BaseException:
            self.disconnect()
            raise

    def get_observation(self) -> dict[str, Any]:
        rig = self._connected()
        seen: dict[str, Any] = {}
        for tendon, state in zip(self._tendons, rig.state(), strict=True):
            if isinstance(state, tdcr.rig.Silence):
                raise ConnectionError(f"{tendon}, servo {state.id}: {state.reason}")
            seen |= {f"{tendon}.pos": state.command, f"{tendon}.current": state.pull}
        if self._sizes:
            views = rig.grab().views
            seen |= {serial: view.color for serial, view in zip(rig.cameras, views, strict=True)}
        return seen

    def send_action(self, action: dict[str, Any]) -> dict[str, Any]:
        rig = self._connected()
        wanted = np.array([float(action[f"{tendon}.pos"]) for tendon in self._tendons])
        at = np.array(rig.commanded)
        farthest = rig.slew * rig.period
        sent = at + np.clip(wanted - at, -farthest, farthest)
        rig.step(sent)
        return {f"{tendon}.pos": float(value) for tendon, value in zip(self._tendons, sent, strict=True)}

    def disconnect(self) -> None:
        if self._rig is not None:
            self._rig.release()
        self._rig = None

    def _connected(self) -> tdcr.Rig:
        if self._rig is None:
            raise DeviceNotConnectedError(f"{self} is not connected: call connect() first")
        return self._rig
