"""Leads the tip of a robot that is not as its model says along a circle, and draws it.

The robot is a plant written here, three methods on top of ``tdcr.Settler``: it bears 20 g that the controller does not know of,
and its first spool pulls a tenth too much. A robot on the desk would take its place.

    python examples/python/tracking.py tracking.png
"""

import sys
from pathlib import Path
from typing import Any

import numpy as np

import tdcr

ROBOT = Path(__file__).resolve().parents[1] / "hanging-2m.toml"
SPOOL = 1.1


class Plant:
    """A robot at rest under its last command."""

    def __init__(self, robot: tdcr.Robot, start: Any) -> None:
        self.settler = tdcr.Settler(robot)
        self.command(start)

    def period(self) -> float:
        """Time between commands (s)."""
        return 0.05

    def measure(self) -> dict[str, Any]:
        """What is seen of the tip (m), and the tensions (N)."""
        return {"tip": self.now.tip, "tensions": self.now.tensions}

    def command(self, command: Any) -> None:
        """Follows a command (m); the first tendon is pulled too far."""
        pulled = np.array(command)
        pulled[0] = max(0.0, 0.085 - SPOOL * (0.085 - pulled[0]))
        self.now = self.settler.follow(pulled, payload=0.02)


def main() -> None:
    """Tracks, prints, and draws where a file is named."""
    robot = tdcr.Robot(ROBOT)
    start = robot.mean_command
    for controller in ("inverse", "resolved-rate", "mpc"):
        run = tdcr.track(robot, "circle", plant=Plant(robot, start), start=start, controller=controller, approach=5.0)
        print(f"{controller:14} RMS error {1e3 * run.summary['rms_error']:6.3f} mm, {run.summary['rms_error_percent']:.3f} %")
        if controller == "resolved-rate":
            payload = run.estimates[-1, run.unknowns.index("payload")]
            print(f"{'':14} estimated payload {1e3 * payload:.1f} g of 20")
    if len(sys.argv) > 1:
        import matplotlib.pyplot as plt

        figure, axes = plt.subplots(figsize=(5, 5))
        on_path = run.times >= 0
        axes.plot(*(1e3 * run.targets[on_path, :2].T), "k", label="target")
        axes.plot(*(1e3 * run.tips[on_path, :2].T), "--", label=controller)
        axes.set(xlabel="x (mm)", ylabel="y (mm)", aspect="equal")
        axes.legend()
        figure.savefig(sys.argv[1], dpi=150)


if __name__ == "__main__":
    main()
