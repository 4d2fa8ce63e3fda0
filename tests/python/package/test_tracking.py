"""Tips led along paths: of simulated robots, and of plants in Python."""

from __future__ import annotations

import importlib.util
import json
import os
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import tdcr
from tdcr.errors import InputError

EXAMPLES = Path(__file__).resolve().parents[3] / "examples"
HANGING = tdcr.Robot({**tdcr.Robot("2m").to_dict(), "gravity": [0.0, 0.0, 9.81]})


class Settling:
    """A robot at rest, written here: it settles under its last command, and bears a payload that nobody knows of."""

    def __init__(self, payload: float = 0.01) -> None:
        self.settler = tdcr.Settler(HANGING)
        self.payload = payload
        self.now: tdcr.Equilibrium | None = None
        self.commands: list[Any] = []

    def period(self) -> float:
        return 0.05

    def measure(self) -> dict[str, Any]:
        if self.now is None:
            return {}
        return {"tip": self.now.tip, "tensions": self.now.tensions, "lengths": None}

    def command(self, command: Any) -> None:
        self.commands.append(command)
        self.now = self.settler.follow(command, payload=self.payload)


def test_a_plant_of_ones_own_is_led_along_a_circle() -> None:
    plant = Settling()
    run = tdcr.track(HANGING, "circle", plant=plant, duration=4.0, approach=2.0)
    assert run.summary["stopped"] is None
    on_path = run.times >= 0.0
    errors = np.linalg.norm(run.tips[on_path] - run.targets[on_path], axis=1)
    assert np.sqrt(np.mean(errors**2)) == pytest.approx(run.summary["rms_error"])
    assert run.summary["rms_error_percent"] < 0.1
    assert run.estimates[-1, run.unknowns.index("payload")] == pytest.approx(0.01, abs=1e-3)
    # The last period has no command any more.
    np.testing.assert_array_equal(plant.commands, run.commands[:-1])


def test_what_a_plant_raises_is_raised_again() -> None:
    class Broken(Settling):
        def command(self, command: Any) -> None:
            raise ZeroDivisionError("the bus is off")

    with pytest.raises(ZeroDivisionError, match="the bus is off"):
        tdcr.track(HANGING, "circle", plant=Broken(), duration=1.0)


def test_plants_that_are_none_are_refused() -> None:
    with pytest.raises(InputError, match="methods period, measure and command"):
        tdcr.track(HANGING, "circle", plant=object())  # type: ignore[arg-type]
    with pytest.raises(InputError, match="payload: these are of simulated robots"):
        tdcr.track(HANGING, "circle", plant=Settling(), payload=0.01)

    class Short(Settling):
        def measure(self) -> dict[str, Any]:
            return {"tip": [0.0, 0.0]}

    with pytest.raises(InputError, match="a tip of 2 numbers; expected 3"):
        tdcr.track(HANGING, "circle", plant=Short(), duration=1.0)


def test_a_simulated_robot_is_led_as_by_the_command_line(tmp_path: Path) -> None:
    HANGING.save(tmp_path / "robot.toml")
    report = tmp_path / "page.html"
    run = tdcr.track(HANGING, "circle", duration=6.0, payload=0.01, delay=0.1, noise=1e-4, seed=3, report=report)
    arguments = ["track", "--robot", str(tmp_path / "robot.toml"), "--path", "circle", "--duration", "6", "--payload", "0.01"]
    arguments += ["--delay", "0.1", "--noise", "1e-4", "--seed", "3", "--json"]
    command = [os.environ.get("TDCR", "tdcr"), *arguments]
    printed = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    assert json.loads(printed) == run.summary
    # The closed loop learns of the delay from its first steps on the path.
    assert run.open_loop is not None and run.open_loop[:, 1].max() > 2.0 * run.summary["largest_error"]
    assert run.summary["rms_error_open_loop"] > 5.0 * run.summary["rms_error"]
    assert "Estimated payload" in report.read_text()


def test_a_model_may_have_obstacles_and_trials_may_learn() -> None:
    turned = [0.5**0.5, 0.5**0.5, 0.0, 0.0]
    post = tdcr.Obstacle.cylinder("post", 0.005, 0.1, position=[0.025, 0.0, 0.25], orientation=turned)
    scene = tdcr.Scene([post])
    known = tdcr.track(HANGING, "circle", duration=4.0, controller="mpc", scene=scene).summary
    unknown = tdcr.track(HANGING, "circle", duration=4.0, controller="mpc", truth_scene=scene).summary
    assert known["rms_error"] < 1e-4 and unknown["rms_error"] > 10 * known["rms_error"]
    (plain,) = known["trials"]
    assert plain == known["rms_error"]
    trials = tdcr.track(HANGING, "circle", duration=4.0, gain_error=0.1, backlash=1e-4, trials=2).summary["trials"]
    assert len(trials) == 2 and trials[1] < 0.8 * trials[0]
    with pytest.warns(UserWarning, match="the model of moving-mpc has no obstacles"):
        short = {"duration": 0.2, "approach": 0.2, "timestep": 0.01}
        tdcr.track(HANGING, "circle", controller="moving-mpc", scene=scene, **short)
    with pytest.raises(InputError, match="trials is 0; expected 1 to 1000"):
        tdcr.track(HANGING, "circle", trials=0)
    with pytest.raises(InputError, match="truth_scene: these are of simulated robots"):
        tdcr.track(HANGING, "circle", plant=Settling(), truth_scene=scene)


def test_rows_are_a_path_in_time() -> None:
    tip = tdcr.settle(HANGING, [0.02, 0.02, 0.02, 0.015, 0.024, 0.024]).tip
    rows = [[0.0, *tip], [1.0, tip[0] + 0.005, tip[1], tip[2]]]
    run = tdcr.track(HANGING, rows, approach=1.0, controller="mpc")
    assert run.times[-1] == pytest.approx(1.0)
    np.testing.assert_allclose(run.targets[-1], rows[1][1:], atol=1e-12)
    with pytest.raises(InputError, match="times that ascend"):
        tdcr.track(HANGING, [rows[1], rows[0]])


def test_clouds_of_cameras_and_of_a_plant_of_ones_own_lead_the_tip(tmp_path: Path) -> None:
    run = tdcr.track(HANGING, "circle", duration=1.0, approach=1.0, payload=0.01, noise="d435")
    assert run.summary["stopped"] is None
    # 1.7 while the payload is still being learned; a circle of twice the time has less than 1.5.
    assert run.summary["rms_error_percent"] < 2.0
    assert np.isnan(run.tensions).all()

    class Seen(Settling):
        def measure(self) -> dict[str, Any]:
            if self.now is None:
                return {}
            return {"cloud": tdcr.cloud(HANGING, self.now).points[::40].astype(float)}

    # Slow enough for the rate of the commands.
    run = tdcr.track(HANGING, "circle", plant=Seen(), duration=2.0, approach=1.0)
    assert run.summary["stopped"] is None
    assert run.summary["rms_error_percent"] < 0.6
    with pytest.raises(InputError, match="noise: "):
        tdcr.track(HANGING, "circle", noise="d415")
    with pytest.raises(InputError, match="noise: these are of simulated robots"):
        tdcr.track(HANGING, "circle", plant=Settling(), noise="d435")


def test_a_rig_is_led_along_a_circle_as_on_the_command_line() -> None:
    with tdcr.Rig(EXAMPLES / "rig-sim.toml") as rig:
        run = tdcr.track(rig.robot, "circle", plant=rig, duration=1.0, approach=1.0, payload=0.02)
        assert not rig.engaged
        with pytest.raises(InputError, match="truth, start: these are of simulated robots"):
            tdcr.track(rig.robot, "circle", plant=rig, truth="2m", start=rig.robot.mean_command)
    assert run.summary["stopped"] is None
    assert run.summary["rms_error_percent"] < 1.5
    assert run.summary["rms_error_open_loop"] is None
    assert run.open_loop is None


def test_the_model_of_a_rig_has_its_scene_unless_another_is_given(tmp_path: Path) -> None:
    whole = (EXAMPLES / "rig-sim.toml").read_text().replace("paper-robot.toml", str(EXAMPLES / "paper-robot.toml"))
    scene = '[scene]\nfile = "wall.toml"\nclearance = 0.004\n\n[motion]'
    (tmp_path / "rig.toml").write_text(whole.replace("[motion]", scene, 1))
    wall = '[[obstacle]]\nname = "wall"\nbox = { size = [0.02, 2.0, 2.0] }\nposition = [0.04, 0.0, 0.0]\n'
    (tmp_path / "wall.toml").write_text(wall)
    with tdcr.Rig(tmp_path / "rig.toml") as rig:
        # It begins 2 cm behind the wall's face; the rate is refused after that, and before anything moves.
        path = {"plant": rig, "centre": (0.02, 0.0, 0.325), "rate": 0.5}
        with pytest.raises(InputError, match="out of reach of robot"):
            tdcr.track(rig.robot, "circle", **path)
        with pytest.raises(InputError, match="the rate is 0.5 m/s"):
            tdcr.track(rig.robot, "circle", scene=tdcr.Scene([]), **path)


def test_a_horizon_of_the_motion_does_not_ring() -> None:
    spec = importlib.util.spec_from_file_location("mpc", EXAMPLES / "python/mpc.py")
    mpc = importlib.util.module_from_spec(spec)  # type: ignore[arg-type]
    spec.loader.exec_module(mpc)  # type: ignore[union-attr]
    overshoot = {name: mpc.response(mpc.step(name, 0.0))[1].max() - 1.0 for name in ("inverse", "moving-mpc")}
    assert overshoot["inverse"] > 0.08 and 0.0 < overshoot["moving-mpc"] < 0.05
