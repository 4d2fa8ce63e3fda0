"""The native module: takes clean arrays; `tdcr` itself is what to use."""

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, Literal, final

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "BatchSimulation",
    "Calibration",
    "ContactRows",
    "ContactSettler",
    "Dataset",
    "EquilibriumRows",
    "FrictionPath",
    "Loads",
    "MotionRows",
    "MovingRobot",
    "Predictor",
    "RecordingCalibration",
    "ReplayedRecording",
    "Rig",
    "Robot",
    "RolloutGradientRows",
    "RolloutTangentRows",
    "Scene",
    "Settler",
    "ShapeController",
    "ShapePath",
    "Steps",
    "Stream",
    "TipPathOf",
    "View",
    "Viewer",
    "__version__",
    "base_jacobian_rows",
    "blend_gaussians",
    "blend_gaussians_backward",
    "calibrate",
    "calibrate_recording",
    "chamfer_rows",
    "check_data",
    "clouds",
    "collect",
    "compare",
    "data_info",
    "demo",
    "distill",
    "draw_data",
    "emd_rows",
    "evaluate",
    "export_clouds",
    "export_rosbag2",
    "follow_rows",
    "follow_rows_among",
    "follow_the_leader",
    "import_clouds",
    "jacobian_rows",
    "jvp_rows",
    "linearise",
    "merge",
    "merge_study",
    "obstacle_jacobian_rows",
    "parameter_bounds",
    "plan",
    "presets",
    "processors",
    "read_cloud_set",
    "record_background",
    "reduce",
    "render",
    "resolve_training",
    "rollout_jvp_rows",
    "rollout_rows",
    "rollout_vjp_rows",
    "run_command",
    "save_ply",
    "scene_vjp_rows",
    "select_points",
    "set_reduction",
    "set_threads",
    "settle_one",
    "settle_one_among",
    "settle_rows",
    "settle_rows_among",
    "sketch",
    "smallest_stiffness_rows",
    "start_noise",
    "study",
    "threads",
    "track_plant",
    "track_rig",
    "track_simulated",
    "train",
    "train_options",
    "train_settings",
    "velocities",
    "vjp_rows",
    "while_released",
]
__version__: str
_Floats = NDArray[np.float64]
_Vector = tuple[float, float, float]
_Progress = Callable[[int], object] | None
_Profile = tuple[_Floats, _Floats, _Floats, _Floats, list[str]]
_Account = tuple[float, float, float, float, int, int]
_Target = tuple[int, str, list[float], float, float]
_Finding = tuple[str, float, float, tuple[float, float], list[int], bool]
_Reading = tuple[int, tuple[int, float, float, float] | None, str | None]
_Cloud = tuple[NDArray[np.float32], NDArray[np.uint8]]

def set_threads(count: int) -> None:
    """Sets the number of threads that this process computes with, from 1 to 1024."""

def threads() -> int:
    """Number of threads that this process computes with."""

def processors() -> int:
    """Number of processors that this process may run on."""

def run_command(arguments: list[str]) -> int:
    """Runs the command line; returns the exit status."""

@final
class Robot:
    @staticmethod
    def load(name_or_path: str) -> tuple[Robot, list[str]]: ...
    @staticmethod
    def from_json(text: str) -> Robot: ...
    def to_json(self) -> str: ...
    def to_toml(self) -> str: ...
    def to_mjcf(self, options: dict[str, Any], scene: Scene | None = None) -> tuple[str, list[str]]: ...
    def to_urdf(self) -> str: ...
    @property
    def name(self) -> str: ...
    @property
    def discs(self) -> int: ...
    @property
    def tendons(self) -> int: ...
    @property
    def units(self) -> list[str]: ...
    def ranges(self) -> _Floats: ...
    def mean_command(self) -> _Floats: ...
    def random_commands(self, count: int, seed: int) -> _Floats: ...
    def straight_positions(self) -> _Floats: ...
    def value(self, parameter: str) -> float: ...
    def parameters(
        self,
    ) -> list[tuple[str, float, str, str, int | None, list[int], list[int], list[str], tuple[float, float]]]: ...
    def check_parameters(self, names: list[str]) -> None: ...
    def with_base(self, position: tuple[float, ...], quaternion: tuple[float, ...]) -> Robot: ...
    def base(self) -> tuple[tuple[float, ...], tuple[float, ...]]: ...
    def with_values(self, names: list[str], values: list[float]) -> Robot: ...

def parameter_bounds(name: str) -> tuple[float, float]: ...

@final
class Loads:
    def __new__(
        cls,
        payload: float,
        offset: _Vector,
        wrenches: list[tuple[int, _Vector, _Vector, _Vector, bool]],
        line: _Vector,
    ) -> Loads: ...

# Robots, commands, loads, payloads, wrenches.
_Rows = tuple[list[Robot], _Floats, list[Loads], _Floats | None, _Floats | None]

# Positions, quaternions, configuration, lengths, tensions, residual, iterations, whether it converged, codes of the stability
# and of what was examined, fastest growth.
_One = tuple[_Floats, _Floats, _Floats, _Floats, _Floats, float, int, bool, int, int, _Floats]

@final
class EquilibriumRows:
    @property
    def positions(self) -> _Floats: ...
    @property
    def quaternions(self) -> _Floats: ...
    @property
    def configuration(self) -> _Floats: ...
    @property
    def lengths(self) -> _Floats: ...
    @property
    def tensions(self) -> _Floats: ...
    @property
    def residual(self) -> _Floats: ...
    @property
    def iterations(self) -> NDArray[np.uint32]: ...
    @property
    def converged(self) -> NDArray[np.bool_]: ...
    @property
    def stability(self) -> NDArray[np.uint8]: ...
    @property
    def examined(self) -> NDArray[np.uint8]: ...
    @property
    def growth(self) -> NDArray[np.float64]: ...

@final
class Settler:
    def __new__(cls, robot: Robot) -> Settler: ...
    def settle(self, command: _Floats, loads: Loads) -> _One: ...
    def follow(self, command: _Floats, loads: Loads) -> _One: ...
    def settle_from(self, command: _Floats, loads: Loads, configuration: _Floats) -> _One: ...
    def memory(self) -> _Floats: ...
    def resume(self, memory: _Floats, loads: Loads) -> None: ...

@final
class Scene:
    @staticmethod
    def load(path: str) -> tuple[Scene, list[str]]: ...
    @staticmethod
    def from_json(text: str) -> Scene: ...
    def to_json(self) -> str: ...
    def to_toml(self) -> str: ...
    def names(self) -> list[str]: ...
    def self_contact(self) -> float | None: ...
    def self_friction(self) -> float: ...
    def moved(self, poses: list[tuple[int, _Vector | None, tuple[float, float, float, float] | None]]) -> Scene: ...

@final
class Viewer:
    @staticmethod
    def open(
        robot: Robot | None,
        fallback: Robot,
        scene: Scene | None,
        command: _Floats | None,
        commands: _Floats | None,
        loads: Loads,
        shown: dict[str, str | None],
        port: int,
    ) -> Viewer: ...
    @property
    def address(self) -> str: ...
    @property
    def robot(self) -> Robot: ...
    @property
    def log(self) -> Path | None: ...
    def show(self, command: _Floats, configuration: _Floats | None) -> None: ...
    def show_row(self, batch: BatchSimulation, row: int, targets: _Floats, radius: float) -> None: ...
    def close(self) -> None: ...

@final
class ContactRows:
    @property
    def row(self) -> NDArray[np.int64]: ...
    @property
    def disc(self) -> NDArray[np.int64]: ...
    @property
    def obstacle(self) -> NDArray[np.int64]: ...
    @property
    def other_disc(self) -> NDArray[np.int64]: ...
    @property
    def point(self) -> _Floats: ...
    @property
    def normal(self) -> _Floats: ...
    @property
    def gap(self) -> _Floats: ...
    @property
    def force(self) -> _Floats: ...
    @property
    def weak(self) -> NDArray[np.bool_]: ...
    @property
    def sliding(self) -> NDArray[np.uint8]: ...
    @property
    def complementarity(self) -> _Floats: ...
    @property
    def penetration(self) -> _Floats: ...
    @property
    def shape_error(self) -> _Floats: ...

@final
class ContactSettler:
    def __new__(cls, robot: Robot, scene: Scene) -> ContactSettler: ...
    def settle(self, command: _Floats, loads: Loads) -> tuple[_One, ContactRows]: ...
    def follow(self, command: _Floats, loads: Loads) -> tuple[_One, ContactRows]: ...
    def settle_from(self, command: _Floats, loads: Loads, configuration: _Floats) -> tuple[_One, ContactRows]: ...
    def memory(self) -> _Floats: ...
    def resume(self, memory: _Floats, loads: Loads) -> None: ...

def settle_one_among(
    robot: Robot,
    scene: Scene,
    command: _Floats,
    loads: Loads,
    payload: float | None = None,
    wrench: _Floats | None = None,
) -> tuple[_One, ContactRows]: ...
def settle_rows_among(rows: _Rows, scenes: list[Scene], progress: _Progress = None) -> tuple[EquilibriumRows, ContactRows]: ...
def follow_rows_among(rows: _Rows, scene: Scene, progress: _Progress = None) -> tuple[EquilibriumRows, ContactRows]: ...
def scene_vjp_rows(rows: _Rows, scenes: list[Scene], cotangents: _Floats, raises: bool) -> _Floats: ...
def obstacle_jacobian_rows(rows: _Rows, scenes: list[Scene], obstacle: int, raises: bool) -> _Floats: ...
def smallest_stiffness_rows(rows: _Rows, scenes: list[Scene] | None = None) -> _Floats: ...
def base_jacobian_rows(rows: _Rows, scenes: list[Scene], raises: bool) -> _Floats: ...
def settle_one(
    robot: Robot,
    command: _Floats,
    loads: Loads,
    payload: float | None = None,
    wrench: _Floats | None = None,
) -> _One: ...
def settle_rows(
    rows: _Rows,
    progress: _Progress = None,
) -> EquilibriumRows: ...
def follow_rows(
    rows: _Rows,
    progress: _Progress = None,
) -> EquilibriumRows: ...
def jacobian_rows(
    rows: _Rows,
    names: list[str],
    raises: bool,
    scenes: list[Scene] | None = None,
) -> _Floats: ...
def jvp_rows(
    rows: _Rows,
    names: list[str],
    rates: _Floats,
    raises: bool,
    scenes: list[Scene] | None = None,
) -> _Floats: ...
def vjp_rows(
    rows: _Rows,
    names: list[str],
    cotangents: _Floats,
    raises: bool,
    scenes: list[Scene] | None = None,
) -> _Floats: ...

@final
class FrictionPath:
    def __new__(cls, robot: Robot, resolution: float, scene: Scene | None = None) -> FrictionPath: ...
    def start(self, command: _Floats, loads: Loads) -> tuple[EquilibriumRows, list[_Profile], _Account, ContactRows | None]: ...
    def advance(self, command: _Floats, loads: Loads) -> tuple[EquilibriumRows, list[_Profile], _Account, ContactRows | None]: ...

@final
class TipPathOf:
    @staticmethod
    def curve(robot: Robot, name: str, centre: list[float] | None, diameter: float, duration: float) -> TipPathOf: ...
    @staticmethod
    def rows(rows: _Floats) -> TipPathOf: ...

_TrackingRows = tuple[_Floats, _Floats, _Floats, _Floats, _Floats, _Floats, _Floats]
_TrackOptions = tuple[float | None, float, float | None, list[float] | None, int]
_Different = tuple[float, float, float, float, float, str, float | None, float | None]

def track_simulated(
    robot: Robot,
    truth: Robot,
    scene: Scene,
    around: Scene,
    path: TipPathOf,
    controller: str,
    settings: _TrackOptions,
    different: _Different,
    seed: int,
) -> tuple[str, _TrackingRows, _Floats, str]: ...
def track_plant(
    plant: Any,
    robot: Robot,
    scene: Scene,
    path: TipPathOf,
    start: _Floats | None,
    controller: str,
    settings: _TrackOptions,
    seed: int,
) -> tuple[str, _TrackingRows, str]: ...
def track_rig(
    rig: Rig,
    scene: Scene | None,
    path: TipPathOf,
    payload: float,
    controller: str,
    settings: _TrackOptions,
    seed: int,
) -> tuple[str, _TrackingRows, str]: ...

_Press = tuple[int, int | None, float, float, float]
_OfObstacle = tuple[int, int, float]
_Solution = tuple[
    _Floats,
    EquilibriumRows,
    _Floats,
    str,
    list[tuple[int, str]],
    float,
    int,
    ContactRows | None,
    _Floats,
    list[_OfObstacle],
    _OfObstacle | None,
]

@final
class ShapeController:
    def __new__(
        cls,
        robot: Robot,
        scene: Scene,
        loads: Loads,
        tolerance: float,
        samples: int,
        seed: int,
        starts: int,
        max_steps: int,
    ) -> ShapeController: ...
    def reach(self, targets: list[_Target], presses: list[_Press], clearance: float | None = None) -> _Solution: ...
    def path(self, start: _Floats | None = None) -> ShapePath: ...

@final
class ShapePath:
    def follow(self, targets: list[_Target]) -> tuple[_Solution, str, _Floats, float, float]: ...

def plan(
    robot: Robot,
    scene: Scene,
    loads: Loads,
    start: _Floats,
    to: _Floats | None,
    to_insertion: float,
    tip: list[float] | None,
    clearance: float,
    tension: tuple[float, float],
    insertion: list[float] | None,
    seed: int,
    nodes: int,
    seconds: float,
    progress: _Progress = None,
) -> tuple[_Floats, _Floats, _Floats, _Floats, _Floats, int, int, float]: ...
def follow_the_leader(
    robot: Robot,
    scene: Scene,
    loads: Loads,
    curve: _Floats,
    base: str,
    stages: int,
    progress: _Progress = None,
) -> tuple[_Floats, _Floats, _Floats, _Floats, _Floats, _Floats, _Floats, _Floats]: ...

@final
class Calibration:
    @property
    def robot(self) -> Robot: ...
    @property
    def findings(self) -> list[_Finding]: ...
    @property
    def correlations(self) -> _Floats: ...
    @property
    def noise(self) -> float: ...
    @property
    def degrees_of_freedom(self) -> int: ...
    @property
    def condition(self) -> float: ...
    @property
    def state(self) -> str: ...
    @property
    def residual_rms(self) -> float: ...
    @property
    def steps(self) -> int: ...

def calibrate(
    unknowns: list[tuple[str, list[str]]],
    rows: _Rows,
    discs: list[int],
    positions: _Floats,
    priors: str | tuple[str] | None = None,
    error: float | None = None,
) -> Calibration: ...

@final
class ReplayedRecording:
    @property
    def times(self) -> _Floats: ...
    @property
    def patterns(self) -> list[str]: ...
    @property
    def lines(self) -> list[int]: ...
    @property
    def pulls(self) -> _Floats: ...
    @property
    def measured(self) -> _Floats: ...
    @property
    def predicted(self) -> _Floats: ...

@final
class RecordingCalibration:
    @property
    def robot(self) -> Robot: ...
    @property
    def columns(self) -> str: ...
    @property
    def found(self) -> str: ...
    @property
    def train(self) -> ReplayedRecording: ...
    @property
    def validation(self) -> ReplayedRecording | None: ...
    @property
    def notes(self) -> list[str]: ...

def calibrate_recording(
    robot: Robot,
    data: str,
    columns: str | tuple[str] | None,
    validate: str | None,
    report: str | None,
    options: dict[str, Any],
    progress: _Progress = None,
) -> RecordingCalibration: ...

@final
class View:
    @property
    def color(self) -> NDArray[np.uint8]: ...
    @property
    def depth(self) -> NDArray[np.float32]: ...
    @property
    def mask(self) -> NDArray[np.uint16]: ...
    @property
    def intrinsics(self) -> list[float]: ...
    @property
    def distortion(self) -> list[float]: ...
    @property
    def position(self) -> _Floats: ...
    @property
    def quaternion(self) -> _Floats: ...

def render(
    robot: Robot,
    configuration: _Floats,
    loads: Loads,
    base: bool,
    base_mesh: str | os.PathLike[str] | None,
    payload: bool,
    tendons: bool,
    noise: str | None,
    seed: int,
    index: int,
    scene: Scene | None = None,
) -> list[View]: ...
def clouds(
    robot: Robot,
    configurations: list[_Floats],
    base: bool,
    voxel: float,
    noise: str | None,
    seed: int,
    first: int,
    scene: Scene | None = None,
    progress: _Progress = None,
) -> list[_Cloud]: ...
def save_ply(path: str | os.PathLike[str], points: NDArray[np.float32], colors: NDArray[np.uint8]) -> None: ...

_Around = tuple[list[Scene] | None, _Floats | None]
_Start = tuple[_Floats | None, _Floats | None, bool]
_ByStates = tuple[_Floats | None, _Floats | None, _Floats | None]

@final
class Steps:
    def __new__(cls, timestep: float, integrator: str, skip: int) -> Steps: ...

@final
class MotionRows:
    @property
    def positions(self) -> _Floats: ...
    @property
    def quaternions(self) -> _Floats: ...
    @property
    def configuration(self) -> _Floats: ...
    @property
    def velocity(self) -> _Floats: ...
    @property
    def lengths(self) -> _Floats: ...
    @property
    def tensions(self) -> _Floats: ...
    @property
    def objects(self) -> _Floats: ...
    @property
    def steps(self) -> NDArray[np.uint32]: ...
    @property
    def contacts(self) -> ContactRows: ...
    @property
    def failures(self) -> list[tuple[int, str, str]]: ...

@final
class RolloutGradientRows:
    @property
    def commands(self) -> _Floats: ...
    @property
    def configuration(self) -> _Floats: ...
    @property
    def velocity(self) -> _Floats: ...
    @property
    def payload(self) -> _Floats: ...
    @property
    def wrench(self) -> _Floats: ...
    @property
    def wrenches(self) -> _Floats | None: ...
    @property
    def parameters(self) -> _Floats: ...
    @property
    def obstacles(self) -> _Floats: ...
    @property
    def base(self) -> _Floats: ...
    @property
    def failures(self) -> list[tuple[int, str, str]]: ...

@final
class RolloutTangentRows:
    @property
    def positions(self) -> _Floats: ...
    @property
    def quaternions(self) -> _Floats: ...
    @property
    def velocity(self) -> _Floats: ...
    @property
    def failures(self) -> list[tuple[int, str, str]]: ...

@final
class MovingRobot:
    def __new__(cls, robot: Robot, steps: Steps, scene: Scene | None = None) -> MovingRobot: ...
    def contacts(self) -> ContactRows: ...
    def objects(self) -> _Floats: ...
    def place_objects(self, states: _Floats) -> None: ...
    def check_outside(self) -> None: ...
    def tendon_profiles(self) -> list[_Profile]: ...
    def set_deflections(self, deflections: list[list[float]]) -> None: ...
    @property
    def dissipated(self) -> float: ...
    def reset(self, command: _Floats, loads: Loads) -> None: ...
    def start_at(self, configuration: _Floats, velocity: _Floats, command: _Floats) -> None: ...
    def resume_at(self, configuration: _Floats, velocity: _Floats, command: _Floats, clock: int | None) -> None: ...
    @property
    def clock(self) -> int | None: ...
    def step(self, command: _Floats, loads: Loads, skip: int) -> None: ...
    @property
    def time(self) -> float: ...
    @property
    def positions(self) -> _Floats: ...
    @property
    def quaternions(self) -> _Floats: ...
    @property
    def configuration(self) -> _Floats: ...
    @property
    def velocity(self) -> _Floats: ...
    @property
    def lengths(self) -> _Floats: ...
    @property
    def tensions(self) -> _Floats: ...
    @property
    def acting(self) -> _Floats: ...

def rollout_rows(
    robots: list[Robot],
    commands: _Floats,
    loads: list[Loads],
    payload: _Floats | None,
    wrench: _Floats | None,
    start: _Start,
    steps: Steps,
    around: _Around,
    progress: _Progress = None,
) -> MotionRows: ...
def rollout_vjp_rows(
    robots: list[Robot],
    commands: _Floats,
    loads: list[Loads],
    payload: _Floats | None,
    wrench: _Floats | None,
    start: _Start,
    steps: Steps,
    around: _Around,
    by_states: _ByStates,
    names: list[str],
    progress: _Progress = None,
) -> RolloutGradientRows: ...
def rollout_jvp_rows(
    robots: list[Robot],
    commands: _Floats,
    loads: list[Loads],
    payload: _Floats | None,
    wrench: _Floats | None,
    start: _Start,
    steps: Steps,
    around: _Around,
    rates: tuple[_Floats, _Floats, _Floats, _Floats, _Floats, _Floats, _Floats | None, _Floats, _Floats],
    names: list[str],
    progress: _Progress = None,
) -> RolloutTangentRows: ...
def linearise(
    robot: Robot,
    configuration: _Floats,
    velocity: _Floats,
    command: _Floats,
    loads: Loads,
    timestep: float,
    scene: Scene | None = None,
) -> tuple[_Floats, _Floats]: ...

_Floats32 = NDArray[np.float32]
_Bytes = NDArray[np.uint8]
_Run = tuple[_Floats32, NDArray[np.uint64], _Floats, str]

@final
class Dataset:
    def __new__(cls, path: str) -> Dataset: ...
    def meta(self) -> str | None: ...
    def robot(self) -> Robot | None: ...
    def units(self) -> tuple[_Floats, _Floats, float]: ...
    def sizes(self, split: int) -> tuple[int, int, int]: ...
    def conditions(self, split: int) -> _Floats32: ...
    def read(self, split: int, start: int, stop: int, progress: _Progress = None) -> tuple[_Floats32, _Floats32, _Bytes]: ...

def check_data(path: str, progress: _Progress = None) -> list[str]: ...
def collect(robot: Robot, scene: Scene, out: str, options: str, progress: _Progress = None) -> None: ...
def merge(parts: list[str], out: str, progress: _Progress = None) -> None: ...

@final
class Predictor:
    def __new__(cls, path: str, precision: str | None = None) -> Predictor: ...
    def save(self, path: str) -> None: ...
    def about(self) -> str: ...
    def robot(self) -> Robot | None: ...
    def units(self) -> tuple[_Floats, _Floats, float]: ...
    def predict(
        self,
        conditions: _Floats,
        options: dict[str, Any],
        progress: _Progress = None,
    ) -> tuple[_Floats32, _Bytes | None, _Floats32 | None, NDArray[np.uint32]]: ...
    def reach(
        self,
        cloud: _Floats32,
        start: _Floats,
        options: dict[str, Any],
    ) -> tuple[_Floats, _Floats, _Floats32]: ...

def train(
    source: str | tuple[Robot, str, Scene | None],
    out: str,
    options: str,
    surface_prior: Robot | None = None,
    progress: _Progress = None,
) -> _Run: ...
def train_options() -> str: ...
def distill(
    model: str,
    data: str,
    out: str,
    options: dict[str, Any],
    progress: _Progress = None,
) -> _Run: ...
def blend_gaussians(
    gaussians: tuple[Any, ...],
    size: tuple[int, int],
    near: float,
    rows: int | None = None,
) -> tuple[_Floats32, _Floats32, _Floats32]: ...
def blend_gaussians_backward(
    gaussians: tuple[Any, ...],
    size: tuple[int, int],
    near: float,
    by_colors: _Floats32,
    by_opacities: _Floats32,
    rows: int | None = None,
) -> tuple[_Floats32, _Floats32, _Floats32, _Floats32]: ...
def evaluate(
    scored: list[tuple[str | None, Any]],
    labels: list[str],
    data: str,
    options: str,
    worst: int,
    report: bool,
    progress: _Progress = None,
) -> tuple[str, str | None]: ...
def compare(
    a: str,
    b: str | None,
    robot: Robot | None,
    base: bool,
    options: str,
    worst: int,
    report: bool,
    progress: _Progress = None,
) -> tuple[str, str | None]: ...
def data_info(path: str) -> str: ...
def draw_data(paths: list[str], out: str, clouds: int, progress: _Progress = None) -> bytes: ...
def study(
    path: str, text: str | None, out: str, part: str | None = None, scene: Scene | None = None, progress: _Progress = None
) -> tuple[str, list[str]]: ...
def merge_study(parts: list[str], out: str) -> str: ...
def demo(out: str, options: dict[str, Any], progress: _Progress = None) -> str: ...
def chamfer_rows(p: _Floats32, q: _Floats32, progress: _Progress = None) -> _Floats: ...
def emd_rows(
    p: _Floats32,
    q: _Floats32,
    squared: bool,
    group: int | None = None,
    progress: _Progress = None,
) -> tuple[_Floats, _Floats, NDArray[np.int64]]: ...

_Pictures = tuple[list[tuple[float, View]], float]

@final
class Rig:
    @staticmethod
    def open(path: str, real_time: bool) -> tuple[Rig, list[str]]: ...
    @property
    def name(self) -> str: ...
    @property
    def robot(self) -> Robot: ...
    @property
    def ids(self) -> list[int]: ...
    @property
    def cameras(self) -> list[str]: ...
    @property
    def time(self) -> float: ...
    @property
    def engaged(self) -> bool: ...
    @property
    def commanded(self) -> _Floats | None: ...
    def meet(self) -> list[Literal["homed", "lost", "never"]]: ...
    def home(self, recall: bool) -> None: ...
    def engage(self) -> None: ...
    def release(self) -> None: ...
    def goals(self, command: _Floats) -> NDArray[np.int32]: ...
    def state(self) -> list[_Reading]: ...
    def step(self, command: _Floats) -> list[_Reading]: ...
    def move_to(self, command: _Floats) -> None: ...
    def go_home(self) -> None: ...
    def grab(self) -> _Pictures: ...
    def measure(self, voxel: float) -> tuple[list[float], list[float], _Cloud, _Pictures]: ...
    @property
    def tension(self) -> tuple[float, float]: ...
    @property
    def motion(self) -> tuple[float, float]: ...
    def draw(self, seed: int) -> _Floats: ...
    def steer(self, by: tuple[float, float, float]) -> _Floats: ...
    def cloud(self, voxel: float) -> _Cloud: ...
    def capture(
        self,
        out: str,
        options: str,
        hang: Callable[[float], object] | None = None,
        progress: _Progress = None,
    ) -> str: ...

def record_background(path: str, out: str, pictures: int, progress: _Progress = None) -> list[str]: ...
def while_released(work: Callable[[], object]) -> bool: ...

@final
class BatchSimulation:
    def __new__(
        cls,
        robots: list[Robot],
        timestep: float | None,
        frame_skip: int,
        origin: tuple[float, ...],
        length: float,
        scenes: list[Scene] | None = None,
        insertion: tuple[float, float] | None = None,
    ) -> BatchSimulation: ...
    def set_robot(self, row: int, robot: Robot) -> None: ...
    def set_scene(self, row: int, scene: Scene) -> None: ...
    def reset(self, rows: list[int], commands: _Floats, payloads: _Floats) -> NDArray[np.bool_]: ...
    def advance(self, commands: _Floats, payloads: _Floats | None = None, forces: _Floats | None = None) -> NDArray[np.bool_]: ...
    def state(self) -> _Floats: ...
    def restore(self, state: _Floats) -> None: ...
    def observe(self, out: NDArray[np.float32], whole: bool, tensions: bool = False) -> None: ...
    def positions(self) -> _Floats: ...
    def quaternions(self) -> _Floats: ...
    def velocities(self) -> _Floats: ...
    def lengths(self) -> _Floats: ...
    def touch(self) -> tuple[NDArray[np.int64], _Floats, _Floats, _Floats]: ...
    def objects(self) -> _Floats: ...
    def tensions(self) -> _Floats: ...
    def clouds(self, rows: list[int], points: int) -> NDArray[np.float32]: ...
    def render(
        self, row: int, width: int, height: int, camera: int, targets: _Floats, radius: float
    ) -> tuple[NDArray[np.uint8], NDArray[np.float32]]: ...

_SampleArrays = tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.uint8]]

@final
class Stream:
    def __new__(
        cls,
        robot: Robot,
        base: bool,
        payload: tuple[float, float] | None,
        points: int,
        voxel: float,
        noise: str | None,
        seed: int,
        index: int,
        stride: int,
        reduction: str | None,
        scene: Scene | None = None,
        vary_obstacles: tuple[float, float] | None = None,
    ) -> Stream: ...
    def find_reduction(self, colors: bool) -> tuple[str, str]: ...
    @property
    def index(self) -> int: ...
    def spec(self) -> str: ...
    def provenance(self) -> str: ...
    def next(self) -> tuple[_SampleArrays, _SampleArrays]: ...

def presets() -> str: ...
def resolve_training(options: str, clouds_in_set: int | None = None) -> tuple[str, str]: ...
def train_settings(changes: str) -> str: ...
def set_reduction(folder: str, colors: bool) -> tuple[str, str]: ...
def reduce(provenance: str, commands: _Floats) -> tuple[NDArray[np.float32], list[int]]: ...
def read_cloud_set(
    folder: str, split: str, normalisation: str | None, reduction: str | None, colors: bool
) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.uint8] | None, str]: ...
def select_points(points: NDArray[np.float32], count: int, corrected: bool) -> tuple[NDArray[np.uintp], NDArray[np.float32]]: ...
def start_noise(prior_deviation: float, prior_cut: float | None, points: int, colors: bool, seed: int) -> NDArray[np.float32]: ...
def velocities(
    model: str, points: NDArray[np.float32], times: NDArray[np.float32], conditions: NDArray[np.float32]
) -> NDArray[np.float32]: ...
def import_clouds(
    folder: str,
    out: str,
    units: str,
    points: int,
    voxel: float | None,
    split: str | None,
    seed: int,
    progress: _Progress = None,
) -> list[str]: ...
def export_rosbag2(file: str, out: str) -> tuple[list[tuple[str, str, int]], int, bool]: ...
def sketch(
    name: str, segments: int, discs: int, tendons: int, length: float, backbone: str, radius: float, servos: str
) -> str: ...
def export_clouds(path: str, format: str, out: str, progress: _Progress = None) -> int: ...
