"""Simulations, clouds, pictures, data sets and training curves in the viewer Rerun (https://rerun.io).

Rerun is an optional dependency, imported when :func:`log_to_rerun` is called: ``pip install ".[rerun]"``.
"""

from __future__ import annotations

import csv
import os
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tdcr._arrays import Floats, as_array, as_float, as_text
from tdcr._files import as_file, as_path
from tdcr._geometry import Geometry
from tdcr.data import Dataset, PathLike, Sample, Split
from tdcr.dynamics import Motion, Motions
from tdcr.errors import DataError, InputError, MissingPackageError
from tdcr.learning import Run
from tdcr.predictor import Prediction
from tdcr.robot import Robot, RobotLike, as_robot
from tdcr.statics import Equilibria, Equilibrium
from tdcr.vision import Cloud, View

_COLORS = ((0, 114, 178), (213, 94, 0), (0, 158, 115), (204, 121, 167), (86, 180, 233), (230, 159, 0), (240, 228, 66))
"""Colours of modules, those of :data:`tdcr.plot.COLORS`."""

_SAMPLES = 64
"""Samples of a data set that are in memory at a time."""


def log_to_rerun(
    what: Any,
    entity: str = "tdcr",
    *,
    robot: RobotLike | None = None,
    times: Any = None,
    out: PathLike | None = None,
    recording: Any = None,
) -> None:
    """Logs a result to Rerun: a robot in space with curves of its tendons, clouds, pictures, or curves of a training.

    ::

        motion = tdcr.simulate(robot, commands)
        tdcr.log_to_rerun(motion, robot=robot, out="motion.rrd")     # then: rerun motion.rrd

    What is logged of what, below ``entity``:

    - :class:`Equilibrium`: ``discs``, ``backbone``, ``tendons`` in space; ``length_m/tendon0``, ... and ``tension_N/tendon0``,
      ..., at the time that is set (``rerun.set_time``). :class:`Equilibria`: the same on the timeline ``row``, without rows that
      have not converged.
    - :class:`Motion`: the same on the timeline ``time``. :class:`Motions`: the same of each row, below ``row_0``, ...
    - :class:`Cloud`, or points of shape (N, 3): ``cloud``, at the time that is set; a list of them, or :class:`Prediction`: on
      the timeline ``row``.
    - :class:`View`, or a list of them: ``camera_0``, ..., a pinhole without its distortion, with ``color`` and ``depth``.
    - :class:`Dataset`, :class:`Split`, or a list of :class:`Sample`: ``cloud`` and ``condition/0_m``, ..., by number and unit,
      on the timeline ``sample``.
    - :class:`Run`, or the folder of a run: ``loss``, ``gradient_norm``, ``learning_rate`` and ``validation_cd``, the columns of
      its ``log.csv``, on the timeline ``step``.

    Positions are in the world's frame (m). Obstacles are not drawn.

    Args:
        what: One of those. A path is the folder of a run if there is a ``log.csv``, of a data set otherwise.
        entity: Path of the entity that everything is below.
        robot: The robot that poses are of, or what :class:`Robot` makes one of.
        times: Times (s) of equilibria or of a list of clouds, shape (rows,), for the timeline ``time`` instead of ``row``.
        out: File (``.rrd``) to write. A file that is there is replaced by the whole new one or not at all.
        recording: A ``rerun.RecordingStream``; without one, and without ``out``, the active one (``rerun.init``).

    Raises:
        MissingPackageError: Where the package ``rerun-sdk`` is not installed.
        InputError: For what cannot be logged, poses without a robot or of another one, and where no recording is active.
        DataError: For a folder that holds neither a run nor a data set, and a log that cannot be read.
    """
    try:
        import rerun
    except ImportError as error:
        raise MissingPackageError("tdcr.log_to_rerun needs Rerun, which is not installed: pip install rerun-sdk") from error
    entity = as_text(entity, "entity").strip("/")
    if not entity:
        raise InputError("entity is empty; expected the path of an entity, such as 'robot'")
    of_robot = None if robot is None else as_robot(robot)
    with _stream(rerun, out, recording) as stream:
        _Log(rerun, stream, entity).add(what, of_robot, times)


@contextmanager
def _stream(rerun: Any, out: PathLike | None, recording: Any) -> Iterator[Any]:
    """The recording to log to; that of a file is whole, and closed, at the end."""
    if out is not None and recording is not None:
        raise InputError("out and recording are both given; expected one of them")
    if out is None:
        if recording is not None and not isinstance(recording, rerun.RecordingStream):
            raise InputError(f"recording is {recording!r}; expected a rerun.RecordingStream")
        active = rerun.get_data_recording(recording)
        if active is None:
            raise InputError("no recording of Rerun is active: call rerun.init(...) before, or name a file to write as `out`")
        yield active
        return
    path = as_file(out, "out", ".rrd")
    with tempfile.TemporaryDirectory(dir=path.parent, prefix=f".{path.name}.") as folder:
        part = Path(folder) / path.name
        stream = rerun.RecordingStream("tdcr")
        try:
            stream.save(part)
            yield stream
        finally:
            stream.disconnect()
        os.replace(part, path)


@dataclass(frozen=True)
class _Series:
    """Instants on one of Rerun's timelines."""

    timeline: str
    at: Any
    seconds: bool

    def columns(self, rerun: Any) -> Any:
        at = np.asarray(self.at)
        return rerun.TimeColumn(self.timeline, **{"duration" if self.seconds else "sequence": at})


@dataclass(frozen=True)
class _Log:
    """An entity of a recording that results are logged below."""

    rerun: Any
    stream: Any
    entity: str

    def below(self, name: str) -> _Log:
        return _Log(self.rerun, self.stream, f"{self.entity}/{name}")

    def add(self, what: Any, robot: Robot | None, times: Any) -> None:
        """Whatever :func:`log_to_rerun` takes."""
        if times is not None and not isinstance(what, Equilibria | Prediction | list | tuple):
            raise InputError(f"times go with equilibria or a list of clouds, not with {type(what).__name__}")
        if isinstance(what, Equilibrium | Equilibria | Motion | Motions):
            if robot is None:
                raise InputError(f"robot is missing; expected the robot whose poses {type(what).__name__} has")
            self.poses(what, robot, times)
        elif isinstance(what, Run | str | os.PathLike):
            self.folder(what.folder if isinstance(what, Run) else Path(as_path(what, "what")))
        elif isinstance(what, Dataset | Split):
            self.data(what)
        else:
            self.seen(what, times)

    def series(self, name: str, kind: str, when: _Series | None, **fields: list[Any]) -> None:
        """Components of one archetype, each a list with an entry for each instant; of one instant without a series."""
        archetype = getattr(self.rerun, kind)
        path = f"{self.entity}/{name}"
        if when is None:
            one = archetype.from_fields(**{field: values[0] for field, values in fields.items()})
            self.rerun.log(path, one, recording=self.stream, strict=True)
            return
        columns: list[Any] = []
        for field, values in fields.items():
            flat = [entry for value in values for entry in value] if field == "strips" else np.concatenate(values)
            columns += archetype.columns(**{field: flat}).partition([len(value) for value in values])
        self.rerun.send_columns(path, [when.columns(self.rerun)], columns, recording=self.stream, strict=True)

    def curves(self, name: str, labels: list[str], when: _Series | None, values: Floats) -> None:
        """A curve for each column of values, shape (instants, curves)."""
        for label, column in zip(labels, values.T, strict=True):
            self.series(f"{name}/{label}", "Scalars", when, scalars=list(column[:, np.newaxis]))

    def static(self, name: str, archetype: Any) -> None:
        path = f"{self.entity}/{name}" if name else self.entity
        self.rerun.log(path, archetype, static=True, recording=self.stream, strict=True)

    def poses(self, what: Any, robot: Robot, times: Any) -> None:
        """Equilibria and motions."""
        if isinstance(what, Motions):
            for row, steps in enumerate(what.steps):
                motion = what[row]
                until = {name: getattr(motion, name)[:steps] for name in ("positions", "quaternions", "lengths", "tensions")}
                self.below(f"row_{row}").body(robot, _Series("time", what.times[:steps], True), **until)
            return
        fields = {name: getattr(what, name) for name in ("positions", "quaternions", "lengths", "tensions")}
        if isinstance(what, Equilibrium):
            self.body(robot, None, **{name: values[np.newaxis] for name, values in fields.items()})
        elif isinstance(what, Motion):
            self.body(robot, _Series("time", what.times, True), **fields)
        else:
            kept = what.converged
            when = _instants(times, len(what), "row")
            kept_at = _Series(when.timeline, when.at[kept], when.seconds)
            self.body(robot, kept_at, **{name: values[kept] for name, values in fields.items()})

    def body(self, robot: Robot, when: _Series | None, **of: Floats) -> None:
        """A robot in poses, shapes (instants, n, 3) and (instants, n, 4), with its tendons, shapes (instants, t)."""
        if of["positions"].shape[1] != robot.discs or of["lengths"].shape[1] != robot.tendons:
            discs, tendons = of["positions"].shape[1], of["lengths"].shape[1]
            raise InputError(f"what has {discs} discs and {tendons} tendons; the robot has {robot.discs} and {robot.tendons}")
        if len(of["positions"]) == 0:
            return
        fields = robot.to_dict()
        geometry, modules = Geometry.of(fields), fields["modules"]
        self.static("", self.rerun.ViewCoordinates.RIGHT_HAND_Z_UP)
        look = {
            "radii": geometry.radius,
            "lengths": [2.0 * modules[module]["half_height"] for module in geometry.module],
            "colors": [_COLORS[module % len(_COLORS)] for module in geometry.module],
        }
        self.static("discs", self.rerun.Cylinders3D.from_fields(**look, fill_mode="solid"))
        # Rerun has the real part of a quaternion last.
        turned = np.roll(of["quaternions"], -1, axis=-1)
        self.series("discs", "Cylinders3D", when, centers=list(of["positions"]), quaternions=list(turned))
        spines = [[np.vstack([geometry.base, positions])] for positions in of["positions"]]
        self.series("backbone", "LineStrips3D", when, strips=spines)
        paths = [geometry.tendon_paths(*pose) for pose in zip(of["positions"], of["quaternions"], strict=True)]
        self.series("tendons", "LineStrips3D", when, strips=paths)
        labels = [f"tendon{tendon}" for tendon in range(robot.tendons)]
        self.curves("length_m", labels, when, of["lengths"])
        self.curves("tension_N", labels, when, of["tensions"])

    def folder(self, path: Path) -> None:
        """A run's log, or a data set."""
        log = path / "log.csv"
        if not log.is_file():
            self.data(Dataset(path))
            return
        try:
            rows = list(csv.DictReader(log.read_text(encoding="utf-8").splitlines()))
            for name in rows[0].keys() - {"step"} if rows else ():
                # Validations are fewer than rows.
                known = [(int(row["step"]), float(row[name])) for row in rows if row[name]]
                if known:
                    steps, values = zip(*known, strict=True)
                    self.series(name, "Scalars", _Series("step", steps, False), scalars=list(np.array(values)[:, np.newaxis]))
        except (ValueError, KeyError, TypeError, OSError) as error:
            raise DataError(f"{log}: not the log of a run: {error}") from error

    def data(self, data: Dataset | Split) -> None:
        """Samples of a data set, some at a time."""
        dataset = data if isinstance(data, Dataset) else data.dataset
        for start in range(0, len(data), _SAMPLES):
            self.samples(data[start : start + _SAMPLES], start, dataset.condition_units)

    def samples(self, samples: list[Sample], first: int, units: tuple[str | None, ...]) -> None:
        """Samples in their order, the first of which has a number."""
        when = _Series("sample", np.arange(first, first + len(samples)), False)
        self.points(samples, when)
        labels = [f"{number}_{unit}" if unit else str(number) for number, unit in enumerate(units)]
        self.curves("condition", labels, when, np.stack([sample.condition for sample in samples]).astype(np.float64))

    def seen(self, what: Any, times: Any) -> None:
        """Clouds, samples and pictures: one, or several."""
        several: list[Any] | None = list(what) if isinstance(what, list | tuple) else None
        if isinstance(what, Prediction):
            several = list(what.points) if what.colors is None else [Cloud(*one) for one in zip(what.points, what.colors)]
        if several and all(isinstance(one, View) for one in several):
            for number, view in enumerate(several):
                self.below(f"camera_{number}").picture(view)
        elif several and times is None and all(isinstance(one, Sample) for one in several):
            self.samples(several, 0, (None,) * len(several[0].condition))
        elif several is not None:
            self.points(several, _instants(times, len(several), "row"))
        elif isinstance(what, View):
            self.below("camera_0").picture(what)
        else:
            self.points([what], None)

    def points(self, clouds: Iterable[Any], when: _Series | None) -> None:
        """Clouds with their colours, if all have some."""
        clouds = list(clouds)
        if not clouds:
            raise InputError("what is empty; expected at least one cloud")
        places = [as_float(getattr(cloud, "points", cloud), "what", ("points", 3)) for cloud in clouds]
        fields: dict[str, list[Any]] = {"positions": places}
        colors = [getattr(cloud, "colors", None) for cloud in clouds]
        if all(of is not None for of in colors):
            fields["colors"] = [as_array(of, "colors") for of in colors]
        self.static("", self.rerun.ViewCoordinates.RIGHT_HAND_Z_UP)
        self.series("cloud", "Points3D", when, **fields)

    def picture(self, view: View) -> None:
        """A camera with what it sees."""
        rerun, height, width = self.rerun, *view.depth.shape
        pose = rerun.Transform3D(translation=view.position, quaternion=np.roll(view.quaternion, -1))
        pinhole = rerun.Pinhole(
            image_from_camera=view.matrix,
            resolution=[width, height],
            camera_xyz=rerun.ViewCoordinates.RDF,
            image_plane_distance=0.05,
        )
        for name, archetype in (
            ("", pose),
            ("", pinhole),
            ("/color", rerun.Image(view.color)),
            ("/depth", rerun.DepthImage(view.depth, meter=1.0)),
        ):
            rerun.log(f"{self.entity}{name}", archetype, recording=self.stream, strict=True)


def _instants(times: Any, count: int, timeline: str) -> _Series:
    """Times of so many results, or their numbers."""
    if times is None:
        return _Series(timeline, np.arange(count), False)
    return _Series("time", as_float(times, "times", (count,)), True)
