"""A robot in the browser that follows the hand."""

from __future__ import annotations

import html
import webbrowser
from types import TracebackType
from typing import Any

from tdcr import _tdcr
from tdcr._arrays import as_float
from tdcr.errors import InputError
from tdcr.loads import Loads, one_load
from tdcr.robot import RobotLike, as_robot
from tdcr.scene import Scene, as_scene


class Viewer:
    """A page with a robot, served on this machine alone until it is closed; a context manager. Made by :func:`view`.

    In a notebook it shows the page.
    """

    def __init__(self, native: _tdcr.Viewer) -> None:
        self._native = native

    @property
    def address(self) -> str:
        """The page's address, with the token that lets in whoever knows it."""
        return self._native.address

    def close(self) -> None:
        """Ends the server; open pages say so."""
        self._native.close()

    def __enter__(self) -> Viewer:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()

    def __repr__(self) -> str:
        return f"Viewer({self.address!r})"

    def _repr_html_(self) -> str:
        address = html.escape(self.address)
        return f'<iframe src="{address}" width="100%" height="700" style="border: 1px solid #8884"></iframe>'


def view(
    robot: RobotLike,
    payload: Any = None,
    *,
    command: Any = None,
    scene: Scene | None = None,
    loads: Loads | None = None,
    port: int = 0,
    browser: bool = False,
) -> Viewer:
    """Serves a page on which a robot follows the hand: its discs are dragged, its tendons have sliders.

    Args:
        robot: The robot, or what :class:`tdcr.Robot` makes one of.
        payload: Mass hung from the last disc (kg).
        command: What it begins with, shape (tendons,) (m or N); the middle of the tendons' ranges by default.
        scene: Obstacles around it.
        loads: Other loads, in place of the payload.
        port: Of 127.0.0.1; 0 for any free one.
        browser: Whether to open the page in a browser; in a notebook the result shows it.

    Returns:
        The page; keep it as long as it is to be served.

    Raises:
        CommandError: For a command that the robot cannot take.
        LoadsError: For loads that it cannot take.
        TdcrError: For a port that is not to be had.
    """
    robot = as_robot(robot)
    if isinstance(port, bool) or not isinstance(port, int) or not 0 <= port < 65536:
        raise InputError(f"port is {port!r}; expected a whole number from 0 to 65535")
    if not isinstance(browser, bool):
        raise InputError(f"browser is {browser!r}; expected True or False")
    start = None if command is None else as_float(command, "command", (robot.tendons,))
    around = None if scene is None else as_scene(scene)._native
    viewer = Viewer(_tdcr.Viewer.open(robot._native, around, start, one_load(loads, payload)._native, port))
    if browser:
        webbrowser.open(viewer.address)
    return viewer
