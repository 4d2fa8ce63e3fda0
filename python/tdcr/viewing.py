"""A robot in the browser that follows the hand."""

from __future__ import annotations

import atexit
import html
import os
import warnings
import weakref
import webbrowser
from pathlib import Path
from types import TracebackType
from typing import Any

from tdcr import _tdcr
from tdcr._arrays import as_float, as_quaternions
from tdcr._files import as_path
from tdcr.errors import InputError
from tdcr.loads import Loads, one_load
from tdcr.moving_robot import MovingRobot
from tdcr.rig import _end_by_exception
from tdcr.robot import Robot, RobotLike, as_robot
from tdcr.scene import Scene, as_scene
from tdcr.statics import Equilibrium

#: Viewers that are not gone.
_OPEN: weakref.WeakSet[Viewer] = weakref.WeakSet()


@atexit.register
def _close_all() -> None:
    """Closes every page of this process: the tension of a rig behind one is released."""
    for viewer in list(_OPEN):
        # A fork has its parent's pages, and no business with them.
        if viewer._process == os.getpid():
            viewer.close()


class Viewer:
    """A page with a robot, served on this machine alone until it is closed; a context manager. Made by :func:`view`.

    In a notebook it shows the page.
    """

    def __init__(self, native: _tdcr.Viewer) -> None:
        self._native = native
        self._process = os.getpid()
        _OPEN.add(self)

    @property
    def address(self) -> str:
        """The page's address, with the token that lets in whoever knows it."""
        return self._native.address

    @property
    def log(self) -> Path | None:
        """The log of the rig; ``None`` where none is written."""
        return self._native.log

    @property
    def robot(self) -> Robot:
        """The robot."""
        return Robot._of(self._native.robot)

    def show(self, what: Any, *, command: Any = None) -> None:
        """Shows the robot on all pages that are open, and on those that are opened later.

        Args:
            what: A command, shape (t,) (m or N), which the robot of each page follows from where it is; or where the robot is: a
                :class:`tdcr.Equilibrium`, a :class:`tdcr.MovingRobot`, or the rotation (w, x, y, z) of each disc relative to the
                body below, shape (n, 4). A pose is shown as it is given, and nothing is solved.
            command: What the tendons of a robot in a pose are under, shape (t,) (m or N), for the tensions shown. That of
                the moving robot, or the middle of the tendons' ranges, by default.

        Raises:
            InputError: For another shape, and a page that is closed.
            CommandError: For a command that the robot cannot take.
        """
        robot = self.robot
        if isinstance(what, MovingRobot) and command is None:
            command = what.acting
        if isinstance(what, Equilibrium | MovingRobot):
            what = what.configuration
        rotations = getattr(what, "ndim", None) == 2
        if not rotations:
            if command is not None:
                raise InputError("command is given besides the command to show; expected it with a pose")
            self._native.show(as_float(what, "command", (robot.tendons,)), None)
            return
        under = robot.mean_command if command is None else as_float(command, "command", (robot.tendons,))
        self._native.show(under, as_quaternions(what, "configuration", (robot.discs, 4)))

    def close(self) -> None:
        """Ends the server; open pages say so. Waits until the tension of a rig is released."""
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
    robot: RobotLike | None = None,
    payload: Any = None,
    *,
    command: Any = None,
    commands: Any = None,
    scene: Scene | None = None,
    loads: Loads | None = None,
    data: str | os.PathLike[str] | None = None,
    model: str | os.PathLike[str] | None = None,
    log: str | os.PathLike[str] | None = None,
    study: str | os.PathLike[str] | None = None,
    rig: str | os.PathLike[str] | None = None,
    out: str | os.PathLike[str] | None = None,
    port: int = 0,
    browser: bool = False,
) -> Viewer:
    """Serves a page on which a robot follows the hand: its discs are dragged, its tendons have sliders.

    Args:
        robot: The robot, or what :class:`tdcr.Robot` makes one of; that of the rig, the model, the data set or the study by
            default, else the paper's of two modules.
        payload: Mass hung from the last disc (kg).
        command: What it begins with, shape (tendons,) (m or N); the middle of the tendons' ranges by default.
        commands: Commands that the page can play, shape (rows, tendons) (m or N).
        scene: Obstacles around it.
        loads: Other loads, in place of the payload.
        data: Folder of a data set, whose clouds are shown over the robot.
        model: File of a trained model, whose cloud follows the robot.
        log: Log of a rig (MCAP) to scrub through.
        study: Folder of a finished study: a point of its figure shows the robot of the row.
        rig: File of a rig to look at live, and to move by the page that arms it. When the page is closed, or this process ends,
            its tension is released.
        out: Folder of the rig's log: ``log.mcap`` in it has all that its servos and cameras do, ``log-2.mcap`` the next time.
        port: Of 127.0.0.1; 0 for any free one.
        browser: Whether to open the page in a browser, with a warning where there is none; in a notebook the result shows it.

    Returns:
        The page; keep it as long as it is to be served.

    Raises:
        CommandError: For a command that the robot cannot take.
        LoadsError: For loads that it cannot take.
        DataError: For a data set, model, log or study that cannot be read.
        RigError: For a rig that cannot be opened, or whose log cannot be begun.
        TdcrError: For a port that is not to be had.
    """
    if isinstance(port, bool) or not isinstance(port, int) or not 0 <= port < 65536:
        raise InputError(f"port is {port!r}; expected a whole number from 0 to 65535")
    if not isinstance(browser, bool):
        raise InputError(f"browser is {browser!r}; expected True or False")
    if rig is not None:
        others = {
            "robot": robot,
            "command": command,
            "commands": commands,
            "scene": scene,
            "data": data,
            "log": log,
            "study": study,
        }
        given = [name for name, value in others.items() if value is not None]
        if given:
            raise InputError(f"{', '.join(given)} and rig are given; expected the rig alone, whose robot is where its servos are")
    elif out is not None:
        raise InputError("out is given without a rig; expected the log of a rig, or no folder")
    paths = {"data": data, "model": model, "log": log, "study": study, "rig": rig, "out": out}
    shown = {name: None if path is None else as_path(path, name) for name, path in paths.items()}
    chosen = None if robot is None else as_robot(robot)
    start = None if command is None else as_float(command, "command", ("tendons" if chosen is None else chosen.tendons,))
    played = (
        None if commands is None else as_float(commands, "commands", ("rows", "tendons" if chosen is None else chosen.tendons))
    )
    around = None if scene is None else as_scene(scene)._native
    if rig is not None:
        _end_by_exception()
    native = _tdcr.Viewer.open(
        None if chosen is None else chosen._native,
        as_robot("2m")._native,
        around,
        start,
        played,
        one_load(loads, payload)._native,
        shown,
        port,
    )
    viewer = Viewer(native)
    if browser and not webbrowser.open(viewer.address):
        warnings.warn(f"no browser could be started; open {viewer.address}", stacklevel=2)
    return viewer
