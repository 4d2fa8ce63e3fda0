"""Leads the tip of a robot along a circle by what depth cameras see of it, and by nothing else.

The robot is a plant written here: it bears 20 g that nobody knows of, and is seen as D435 cameras would see it. With a rig in
its place (``plant=tdcr.Rig("rig.toml")``) the same call leads the robot on the desk.

    python examples/python/visual_servoing.py
"""

from pathlib import Path
from typing import Any

import tdcr

ROBOT = Path(__file__).resolve().parents[1] / "hanging-2m.toml"


class Seen:
    """A robot at rest under its last command, of which cameras give clouds."""

    def __init__(self, robot: tdcr.Robot, start: Any) -> None:
        self.robot, self.settler, self.pictures = robot, tdcr.Settler(robot), 0
        self.command(start)

    def period(self) -> float:
        """Time between commands (s)."""
        return 0.1

    def measure(self) -> dict[str, Any]:
        """What the cameras see (m)."""
        self.pictures += 1
        cloud = tdcr.cloud(self.robot, self.now, voxel=0.004, noise="d435", index=self.pictures)
        return {"cloud": cloud.points[::4].astype(float)}

    def command(self, command: Any) -> None:
        """Follows a command (m)."""
        self.now = self.settler.follow(command, payload=0.02)


def main() -> None:
    """Tracks, and prints."""
    robot = tdcr.Robot(ROBOT)
    start = robot.mean_command
    run = tdcr.track(robot, "circle", plant=Seen(robot, start), start=start, duration=4.0, approach=2.0)
    payload = run.estimates[-1, run.unknowns.index("payload")]
    print(f"by clouds alone: tip told, payload {1e3 * payload:.1f} g of 20; stopped: {run.summary['stopped']}")
    simulated = tdcr.track(robot, "circle", duration=4.0, approach=2.0, payload=0.02, noise="d435")
    print(f"against the truth of a simulated robot: {simulated.summary['rms_error_percent']:.2f} % of the length")


if __name__ == "__main__":
    main()
