"""tdcr as a solver of cosseratbench, with stand-ins for its classes: beside closed forms, and what it refuses."""

from __future__ import annotations

import importlib
import sys
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest

PLUGIN = Path(__file__).parents[3] / "python/plugins/cosseratbench_tdcr"
RADIUS = 0.02
FREE, PINNED, CLAMPED = (SimpleNamespace(value=value) for value in ("free", "pinned", "clamped"))


@dataclass
class Trajectory:
    """What cosseratbench takes."""

    times: Any
    positions: Any
    directors: Any


class Diverged(FloatingPointError):
    """A motion that broke down."""


@pytest.fixture
def solver(monkeypatch: pytest.MonkeyPatch) -> Any:
    """The solver on stand-ins."""
    modules = {name: ModuleType(name) for name in ("cosseratbench", "cosseratbench.solver", "cosseratbench.trajectory")}
    vars(modules["cosseratbench.solver"]).update(Diverged=Diverged)
    vars(modules["cosseratbench.trajectory"]).update(Trajectory=Trajectory)
    for name, module in modules.items():
        monkeypatch.setitem(sys.modules, name, module)
    monkeypatch.delitem(sys.modules, "cosseratbench_tdcr", raising=False)
    monkeypatch.syspath_prepend(str(PLUGIN))
    yield importlib.import_module("cosseratbench_tdcr").Tdcr()
    sys.modules.pop("cosseratbench_tdcr")


def scenario(
    start: Any, *, tilt: float = 0.0, force: float = 0.0, youngs: float = 1e6, radius: float = 0.02, **other: Any
) -> Any:
    """A rod of 1 m along x, or one that hangs, tilted (rad)."""
    hangs = start is PINNED
    along = np.array([np.sin(tilt), 0.0, -np.cos(tilt)]) if hangs else np.array([1.0, 0.0, 0.0])
    beside = np.array([0.0, 1.0, 0.0])
    rod = SimpleNamespace(
        length=1.0,
        radius=RADIUS,
        area=np.pi * RADIUS**2,
        second_moment_of_area=np.pi * RADIUS**4 / 4.0,
        material=SimpleNamespace(youngs_modulus=youngs, shear_modulus=youngs / 3.0, density=1000.0),
        start=start,
        end=FREE,
        start_motion=None,
        loads=(SimpleNamespace(force=(0.0, 0.0, force), at=SimpleNamespace(value="end")),) if force else (),
        nodes=lambda n: np.linspace(0.0, 1.0, n + 1)[:, None] * along,
        directors=lambda n: np.tile(beside, (n, 1)),
    )
    gravity = (0.0, 0.0, -9.81) if hangs else (0.0, 0.0, 0.0)
    values = {"rods": (rod,), "obstacles": (), "self_contact": False, "duration": 2.0, "quasi_static": not hangs}
    return SimpleNamespace(**values | {"gravity": gravity} | other)


def test_a_cantilever_bends_as_euler_and_bernoulli_say(solver: Any) -> None:
    force = -7.5e-3
    errors = []
    for n in (20, 40):
        found = solver.run(scenario(CLAMPED, force=force), n_elements=n, n_frames=3)
        (nodes,), (directors,) = found.positions, found.directors
        assert nodes.shape == (3, n + 1, 3) and directors.shape == (3, n, 3)
        np.testing.assert_allclose(np.linalg.norm(directors, axis=-1), 1.0)
        np.testing.assert_allclose(np.linalg.norm(np.diff(nodes, axis=1), axis=-1), 1.0 / n, rtol=0.01)
        deflection = force / (3.0 * 1e6 * np.pi * RADIUS**4 / 4.0)
        errors.append(abs(nodes[-1, -1, 2] / deflection - 1.0))
    assert errors[0] < 1.1e-3 and errors[1] < 0.6e-3


def test_a_stiff_pendulum_swings_with_its_period_and_keeps_its_energy(solver: Any) -> None:
    # A straight rod of 1 m about its end: 2 pi sqrt(2 L / (3 g)).
    period = 2.0 * np.pi * np.sqrt(2.0 / (3.0 * 9.81))
    found = solver.run(
        scenario(PINNED, tilt=0.02, youngs=1e9, duration=3.0 * period, self_contact=False), n_elements=6, n_frames=301
    )
    x = found.positions[0][:, -1, 0]
    np.testing.assert_allclose(x, 0.02 * np.cos(2.0 * np.pi * found.times / period), atol=1e-4)


@pytest.mark.parametrize(
    ("other", "said"),
    [
        ({"self_contact": True}, "contact"),
        ({"rods": ()}, "0 rods"),
    ],
)
def test_what_the_chain_does_not_model_is_said(solver: Any, other: dict[str, Any], said: str) -> None:
    with pytest.raises(NotImplementedError, match=said):
        solver.run(scenario(CLAMPED, **other), n_elements=4, n_frames=2)


def test_a_rod_that_is_held_at_both_ends_is_refused(solver: Any) -> None:
    held = scenario(CLAMPED)
    held.rods[0].end = PINNED
    with pytest.raises(NotImplementedError, match="its end pinned"):
        solver.run(held, n_elements=4, n_frames=2)
