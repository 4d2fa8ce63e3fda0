"""Rigs: a robot with servos and cameras, in memory or on a desk, behind one file."""

from __future__ import annotations

import atexit
import contextlib
import json
import os
import signal
import sys
import threading
import warnings
import weakref
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import FrameType, TracebackType
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from tdcr import _tdcr
from tdcr._arrays import Floats, Progress, as_count, as_flag, as_float, as_number
from tdcr._files import as_path
from tdcr._results import Result
from tdcr.data import MOST, Dataset, PathLike, as_seed
from tdcr.errors import CommandError, InputError, TdcrError
from tdcr.robot import Robot
from tdcr.vision import Cloud, View, as_view


@dataclass(frozen=True)
class WinchState:
    """What a servo does, with the spool and tendon behind it.

    Attributes:
        id: Address of the servo.
        position: From home (ticks, 4096 a turn).
        command: The command that the position stands for (m).
        velocity: Of the servo (rad/s).
        pull: Current of the servo (A), positive where it pulls.
    """

    id: int
    position: int
    command: float
    velocity: float
    pull: float


@dataclass(frozen=True)
class Silence:
    """Why there is no state of a servo.

    Attributes:
        id: Address of the servo.
        reason: What went wrong, or that the servo is not homed.
    """

    id: int
    reason: str


@dataclass(frozen=True, eq=False, repr=False)
class Pictures(Result):
    """Pictures of all cameras of a rig from one moment.

    Attributes:
        views: One for each camera, in the order of the rig file.
        times: When they were taken, shape (cameras,), by the rig's clock (s).
        skew: Largest difference between these (s).
    """

    views: list[View]
    times: Floats
    skew: float


@dataclass(frozen=True, eq=False, repr=False)
class Measured(Result):
    """Where the cameras of a rig see the tip.

    Attributes:
        tip: Origin of the last disc, world frame, shape (3,) (m).
        axis: Its z axis, world frame, shape (3,).
        cloud: What the cameras see of the robot, fused and thinned.
        pictures: The pictures, without depth where they show something else.
    """

    tip: Floats
    axis: Floats
    cloud: Cloud
    pictures: Pictures


@dataclass(frozen=True)
class CaptureReport:
    """How a capture went; one that was resumed counts as a whole.

    Attributes:
        data: The data set.
        samples: Samples of the data set.
        captured: Samples that this call captured.
        moving: Samples that were taken while something still moved, when patience came to its end.
        skew: Largest difference between the times of the pictures of a sample (s).
        drift: How far what is seen of the robot at home moved since the first look, at the most (m).
        current_drift: How much a servo's current at home changed since the first look, at the most (A).
        repeatability: Root mean square distance of the centres of the clouds of one command from their mean, over the commands
            that were captured more than once (m), if some were. A centre is the mean of the points seen.
        rested: Time that servos rested because they were hot (s).
        recalled: Times that a servo lost its turns, and its home was found again.
        rig_seconds: Time that the rig took, by its own clock (s).
        log: The log of this call (MCAP), if one was written.
    """

    data: Dataset
    samples: int
    captured: int
    moving: int
    skew: float
    drift: float
    current_drift: float
    repeatability: float | None
    rested: float
    recalled: int
    rig_seconds: float
    log: Path | None


#: Rigs that are not gone.
_OPEN: weakref.WeakSet[Rig] = weakref.WeakSet()


@atexit.register
def _release_all() -> None:
    """Releases every rig of this process, as a ``with`` block does at its end."""
    for rig in list(_OPEN):
        # A fork has its parent's rigs, and no business with them.
        if rig._process == os.getpid():
            with contextlib.suppress(TdcrError):
                rig.release()


#: Signals that end a process without a word: by ``kill``, where a window is closed, from the keyboard (Ctrl-\\), by timers, by
#: schedulers of clusters, and where its processor time is used up.
_ENDING = ("SIGTERM", "SIGHUP", "SIGQUIT", "SIGALRM", "SIGUSR1", "SIGUSR2", "SIGXCPU")

#: Signals that stop a process: from the keyboard (Ctrl-Z), and for a background process that uses its terminal.
_STOPPING = ("SIGTSTP", "SIGTTIN", "SIGTTOU")


def _end_by_exception() -> None:
    """Has signals that would end the process without a word raise ``SystemExit``, so that ``with`` blocks come to their end, and
    those that would stop it, as Ctrl-Z, too while motors are on."""
    if threading.current_thread() is not threading.main_thread():
        return
    for name, handler in _handlers():
        if signal.getsignal(name) is signal.SIG_DFL:
            signal.signal(name, handler)


def _handlers() -> list[tuple[int, Callable[[int, FrameType | None], None]]]:
    ending = [(name, _exit) for name in _ENDING]
    stopping = [(name, _stop) for name in _STOPPING]
    named = [*ending, *stopping]
    return [(getattr(signal, name), handler) for name, handler in named if hasattr(signal, name)]


def _exit(number: int, _frame: FrameType | None) -> None:
    raise SystemExit(128 + number)


def _stop(number: int, frame: FrameType | None) -> None:
    if not _tdcr.while_released(lambda: os.kill(os.getpid(), signal.SIGSTOP)):
        # A background process that writes to its terminal may be stopped for that.
        if number == signal.SIGTSTP:
            print("motors are on, which nobody would look after while this process is stopped, so it ends", file=sys.stderr)
        _exit(number, frame)


def _end_as_usual() -> None:
    """Gives those signals their default action back in a fork, which holds no torque: a worker of a pool must end when told."""
    for number, handler in _handlers():
        if signal.getsignal(number) is handler:
            signal.signal(number, signal.SIG_DFL)


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_end_as_usual)


class Rig:
    """A robot with servos and cameras: simulated, recorded or real, as its file says; the same calls on each.

    Nothing moves before the servos are homed and :meth:`engage` is called. The tension is released where something goes wrong,
    where a call is interrupted, at the end of a ``with`` block, and at the end of the process. SIGTERM, SIGQUIT, SIGHUP (a
    window that is closed, a connection that is lost), SIGUSR1, SIGUSR2, SIGALRM and SIGXCPU raise ``SystemExit`` once a rig was
    opened in the main thread, where they had their default action; so do SIGTSTP (Ctrl-Z), SIGTTIN and SIGTTOU while motors are
    on, as a stopped process cannot look after them::

        with tdcr.Rig("rig-sim.toml") as rig:
            rig.engage()
            rig.move_to(command)
            cloud = rig.cloud()

    What is passed over in a robot's file of another tool is warned of, and is in ``robot.notes``.

    Args:
        path: The rig's file: see the guide to hardware.
        real_time: Whether a rig in memory keeps to the wall's clock; else it is as fast as it computes.

    Raises:
        RigError: For a file that describes no rig, and for parts that cannot be opened.
    """

    def __init__(self, path: PathLike, *, real_time: bool = False) -> None:
        _end_by_exception()
        self._native, notes = _tdcr.Rig.open(as_path(path, "path"), as_flag(real_time, "real_time"))
        for note in notes:
            warnings.warn(f"{as_path(path, 'path')}: {note}", stacklevel=2)
        self.robot = Robot._of(self._native.robot, tuple(notes))
        self._process = os.getpid()
        _OPEN.add(self)

    def __enter__(self) -> Rig:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> Literal[False]:
        self.release()
        return False

    def __repr__(self) -> str:
        return f"Rig({self.name!r}, {len(self.ids)} servos, {len(self.cameras)} cameras)"

    @property
    def name(self) -> str:
        """Name in the rig's file."""
        return self._native.name

    @property
    def ids(self) -> list[int]:
        """Addresses of the servos, in the order of a command."""
        return self._native.ids

    @property
    def cameras(self) -> list[str]:
        """Serial numbers of the cameras."""
        return self._native.cameras

    @property
    def time(self) -> float:
        """Time of the rig's clock (s)."""
        return self._native.time

    @property
    def engaged(self) -> bool:
        """Whether the motors are driven."""
        return self._native.engaged

    @property
    def commanded(self) -> Floats | None:
        """Where the servos are told to be, shape (tendons,) (m); ``None`` where the motors are off."""
        return self._native.commanded

    def homing(self) -> list[Literal["homed", "lost", "never"]]:
        """Asks the servos what is known of their homes, one word each: a servo that was without power has lost its turns."""
        return self._native.meet()

    def home(self, *, recall: bool = False) -> None:
        """Takes where the servos stand for home: the robot has to be straight, each tendon at its tension of home.

        Args:
            recall: Find home again from where the servos were left when they lost their turns, without touching anything.
        """
        self._native.home(as_flag(recall, "recall"))

    def engage(self) -> None:
        """Switches the motors on where they stand, with the rig's modes, current limits and watchdogs.

        Raises:
            RigError: For servos that are not homed, report a fault, or are too hot.
        """
        self._native.engage()

    def release(self) -> None:
        """Takes the tension from the tendons and switches the motors off. Nothing is done where they are off."""
        self._native.release()

    def goals(self, command: Any) -> NDArray[np.int32]:
        """Positions of the servos, from home (ticks), that stand for a command, shape (tendons,) (m)."""
        return self._native.goals(self._take(command))

    def state(self) -> list[WinchState | Silence]:
        """What each servo does, or why it does not say."""
        return _states(self._native.state())

    def step(self, command: Any) -> list[WinchState | Silence]:
        """Sends the goals of a command, shape (tendons,) (m), at once, and looks at the servos when the next are due.

        Raises:
            CommandError: For a command out of its range or the servos' limits, or farther from the one before than the rig's
                slew allows in a period (:meth:`move_to` goes there in steps); nothing is sent then.
            RigError: After the tension was released, with the reason.
        """
        return _states(self._native.step(self._take(command)))

    def move_to(self, command: Any) -> None:
        """Moves to a command, shape (tendons,) (m), on a straight line and no faster than the rig's slew.

        Raises:
            As :meth:`step`.
        """
        self._native.move_to(self._take(command))

    def go_home(self) -> None:
        """Moves home, all servos in proportion."""
        self._native.go_home()

    def grab(self) -> Pictures:
        """Pictures of all cameras, of the present or later, with all that they see."""
        return _pictures(*self._native.grab())

    def cloud(self, voxel: float = 0.002) -> Cloud:
        """What the cameras see of the robot, fused and thinned by voxels of this edge (m)."""
        return Cloud(*self._native.cloud(as_number(voxel, "voxel")))

    def measure(self, voxel: float = 0.002) -> Measured:
        """Where the cameras see the tip. The simulator's shape under the commands that the servos' positions stand for is laid
        onto what they see, disc by disc.

        Args:
            voxel: Edge of the voxels that thin the cloud (m).

        Raises:
            RigError: Where the cameras do not see enough of the robot, or as :meth:`grab`.
        """
        tip, axis, cloud, pictures = self._native.measure(as_number(voxel, "voxel"))
        return Measured(np.array(tip), np.array(axis), Cloud(*cloud), _pictures(*pictures))

    @property
    def tension(self) -> tuple[float, float]:
        """Smallest and largest tension (N) that the simulator may find in a tendon, as the rig's file says."""
        return self._native.tension

    @property
    def slew(self) -> float:
        """Largest speed of a tendon (m/s), as the rig's file says."""
        return self._native.motion[0]

    @property
    def period(self) -> float:
        """Time between two goals (s), as the rig's file says."""
        return self._native.motion[1]

    def draw(self, seed: int) -> Floats:
        """A command by chance, shape (tendons,) (m), that can be reached from home with tensions within bounds."""
        return self._native.draw(as_seed(seed))

    def steer(self, by: Any) -> Floats:
        """The command, shape (tendons,) (m), that brings the tip so far from where the rig is commanded, by the model.

        It is within the rig's limits of commands and tensions, and moves the tendons as little as it can. :meth:`move_to` goes
        there, as ``tdcr jog --tip`` does.

        Args:
            by: How far, shape (3,) (m, world frame).

        Raises:
            RigError: Where the motors are off, and where no command within the limits leads there.
        """
        x, y, z = as_float(by, "by", (3,)).tolist()
        return self._native.steer((x, y, z))

    def within_limits(self, command: Any) -> bool:
        """Whether a command, shape (tendons,) (m), is within its ranges and the servos' limits."""
        try:
            self.goals(command)
        except CommandError:
            return False
        return True

    def capture(
        self,
        out: PathLike = "data",
        *,
        commands: int | Any = 200,
        repeat: int = 1,
        payloads: Sequence[float] = (),
        hang: Callable[[float], object] | None = None,
        points: int = 10_000,
        voxel: float = 0.002,
        seed: int = 0,
        sentinel_every: int = 25,
        masks: PathLike | None = None,
        log: bool = True,
        progress: Progress | None = None,
    ) -> CaptureReport:
        """Makes a data set: moves the robot, sees it, keeps the clouds; as ``tdcr capture``.

        Interrupted by Ctrl-C or by an exception of ``progress``, the tension is released, and the same call goes on where it
        stopped. With more ``commands`` it adds to the data set.

        Args:
            out: Folder of the data set.
            commands: Number of random commands, or the commands themselves, of shape (commands, tendons) (m), which are checked
                before anything moves. They are split 80/10/10 into train, val and test; of fewer than 10 one tests and one
                validates, as far as they go.
            repeat: Captures each command so many times: all of them once, then all again. A later call with more adds to the
                data set, and all samples of a command are in one split.
            payloads: Captures all commands, with their repeats, under one payload at the tip after another (kg; 0 for none).
                Payloads are part of the samples' conditions. A set of several payloads does not grow.
            hang: Is called with each payload before its samples, the rig released, and returns when it hangs at the tip. No other
                call of the rig is possible until then, and Ctrl-C is heard when it returns. A simulated rig needs none: it hangs
                them itself.
            points: Points per cloud.
            voxel: Edge of the voxels that thin the fused clouds (m).
            seed: Seed of commands, samples and splits.
            sentinel_every: Samples between two looks at the robot in its home pose.
            masks: Folder of masks that another program has written, ``camera0/000000.png`` and so on: they make the clouds, in
                place of the masks of the rig's file.
            log: Whether all that servos and cameras did is written to ``log.mcap`` in the folder, to ``log-2.mcap`` where the
                capture is resumed.
            progress: Is called with the number of samples captured since its last call.

        Raises:
            RigError: After the tension was released, with the reason.
            DataError: For a folder that holds something else, or cannot be written.
        """
        is_number = isinstance(commands, int | float | np.number)
        options = {
            "commands": as_count(commands, "commands") if is_number else 1,
            "given": None if is_number else as_float(commands, "commands", ("commands", self.robot.tendons)).tolist(),
            "repeat": as_count(repeat, "repeat", 1),
            "payloads": as_float(payloads, "payloads", ("payloads",)).tolist(),
            "points": as_count(points, "points", 1, MOST),
            "voxel": as_number(voxel, "voxel"),
            "seed": as_seed(seed),
            "sentinel_every": as_count(sentinel_every, "sentinel_every", 1),
            "masks": as_path(masks, "masks") if masks is not None else None,
            "no_log": not as_flag(log, "log"),
        }
        if hang is not None and not callable(hang):
            raise InputError(f"hang is {hang!r}; expected a function of a payload")
        report = json.loads(self._native.capture(as_path(out, "out"), json.dumps(options), hang, progress=progress))
        known = {name: report[name] for name in CaptureReport.__dataclass_fields__ if name not in ("data", "log")}
        written = Path(report["log"]) if report["log"] is not None else None
        return CaptureReport(data=Dataset(out), log=written, **known)

    def _take(self, command: Any) -> Floats:
        return as_float(command, "command", (self.robot.tendons,))


def record_background(
    rig: PathLike, out: PathLike = "background.mcap", *, pictures: int = 30, progress: Progress | None = None
) -> Path:
    """Records the empty scene, against which masks tell a robot; as ``tdcr background``. Returns ``out``.

    The robot has to be out of sight; cameras in memory do not see it. The log is what ``masks.background`` of the rig's file then
    names.

    Args:
        rig: The rig's file.
        out: The log to write, an MCAP file. One that is there is left as it is.
        pictures: Pictures by each camera, 5 to 1000.
        progress: Is called with the number of pictures taken since its last call.

    Raises:
        RigError: For a file that describes no rig, cameras that give no pictures, and a log that cannot be written.
    """
    count = as_count(pictures, "pictures", 5, 1000)
    for note in _tdcr.record_background(as_path(rig, "rig"), as_path(out, "out"), count, progress=progress):
        warnings.warn(f"{as_path(rig, 'rig')}: {note}", stacklevel=2)
    return Path(out)


def _states(
    readings: Sequence[tuple[int, tuple[int, float, float, float] | None, str | None]],
) -> list[WinchState | Silence]:
    return [WinchState(id, *state) if state is not None else Silence(id, str(reason)) for id, state, reason in readings]


def _pictures(frames: Sequence[tuple[float, _tdcr.View]], skew: float) -> Pictures:
    return Pictures([as_view(view) for _, view in frames], np.array([time for time, _ in frames]), skew)
