"""The native module: takes clean arrays; `tdcr` itself is what to use."""

from collections.abc import Callable
from typing import final

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "EquilibriumRows",
    "Loads",
    "Robot",
    "Settler",
    "__version__",
    "follow_rows",
    "jacobian_rows",
    "jvp_rows",
    "set_threads",
    "settle_rows",
    "threads",
    "vjp_rows",
]

__version__: str

_Floats = NDArray[np.float64]
_Vector = tuple[float, float, float]
_Progress = Callable[[int], object] | None

def set_threads(count: int) -> None:
    """Sets the number of threads that this process computes with, from 1 to 1024."""

def threads() -> int:
    """Number of threads that this process computes with."""

@final
class Robot:
    @staticmethod
    def load(name_or_path: str) -> tuple[Robot, list[str]]: ...
    @staticmethod
    def from_json(text: str) -> Robot: ...
    def to_json(self) -> str: ...
    def to_toml(self) -> str: ...
    def to_mjcf(self) -> str: ...
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
    @staticmethod
    def unit_of(parameter: str) -> str: ...
    def with_values(self, names: list[str], values: list[float]) -> Robot: ...

@final
class Loads:
    def __new__(
        cls,
        payload: float,
        offset: _Vector,
        wrenches: list[tuple[int, _Vector, _Vector, bool]],
        line: _Vector,
    ) -> Loads: ...

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

@final
class Settler:
    def __new__(cls, robot: Robot) -> Settler: ...
    def settle(self, command: _Floats, loads: Loads) -> EquilibriumRows: ...
    def follow(self, command: _Floats, loads: Loads) -> EquilibriumRows: ...
    def settle_from(self, command: _Floats, loads: Loads, configuration: _Floats) -> EquilibriumRows: ...

def settle_rows(
    robots: list[Robot],
    commands: _Floats,
    loads: list[Loads],
    payload: _Floats | None = None,
    wrench: _Floats | None = None,
    progress: _Progress = None,
) -> EquilibriumRows: ...
def follow_rows(
    robot: Robot,
    commands: _Floats,
    loads: list[Loads],
    payload: _Floats | None = None,
    wrench: _Floats | None = None,
    progress: _Progress = None,
) -> EquilibriumRows: ...
def jacobian_rows(
    robots: list[Robot],
    commands: _Floats,
    loads: list[Loads],
    payload: _Floats | None,
    wrench: _Floats | None,
    names: list[str],
    raises: bool,
) -> _Floats: ...
def jvp_rows(
    robots: list[Robot],
    commands: _Floats,
    loads: list[Loads],
    payload: _Floats | None,
    wrench: _Floats | None,
    names: list[str],
    rates: _Floats,
    raises: bool,
) -> _Floats: ...
def vjp_rows(
    robots: list[Robot],
    commands: _Floats,
    loads: list[Loads],
    payload: _Floats | None,
    wrench: _Floats | None,
    names: list[str],
    cotangents: _Floats,
    raises: bool,
) -> _Floats: ...

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
        noise: bool,
        seed: int,
        index: int,
        stride: int,
    ) -> Stream: ...
    @property
    def index(self) -> int: ...
    def spec(self) -> str: ...
    def normalisation(self) -> str: ...
    def next(self) -> tuple[_SampleArrays, _SampleArrays]: ...

def presets() -> str: ...
def train_settings(changes: str) -> str: ...
def read_cloud_set(
    folder: str, split: str, normalisation: str | None, colors: bool
) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.uint8] | None, str]: ...
def read_commands(folder: str, split: str) -> NDArray[np.float64]: ...
def start_noise(prior_deviation: float, points: int, colors: bool, seed: int) -> NDArray[np.float32]: ...
def velocities(
    model: str, points: NDArray[np.float32], times: NDArray[np.float32], conditions: NDArray[np.float32]
) -> NDArray[np.float32]: ...
