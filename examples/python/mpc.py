"""Moves the tip of a robot that swings across, at once: in open loop it rings, under a horizon of its motion it does not.

The tip of a hanging robot in motion rests on one side; from now on it is to be 36 mm away. Both controllers give a command every
40 ms, and know the path beforehand, so the horizon begins early. The model of both lacks the payload of the second run.

    python examples/python/mpc.py mpc.png
"""

import sys
from pathlib import Path
from typing import Any

import numpy as np

import tdcr

ROBOT = Path(__file__).resolve().parents[1] / "hanging-2m.toml"
FROM, TO = np.array([[0.018, 0.0, 0.331], [-0.018, 0.0, 0.331]])


def step(controller: str, payload: float) -> tdcr.Tracking:
    """The tip rests for half a second, and is to be elsewhere from then on."""
    rows = np.array([[0.0, *FROM], [0.5, *FROM], [0.5 + 1e-6, *TO], [2.5, *TO]])
    return tdcr.track(
        ROBOT,
        rows,
        controller=controller,
        approach=1.0,
        period=0.04,
        rate=0.5,
        payload=payload,
        timestep=0.002,
    )


def response(run: tdcr.Tracking) -> tuple[Any, Any]:
    """Time since the step (s), and the part of the way that the tip has come."""
    return run.times - 0.5, (run.tips - FROM) @ (TO - FROM) / np.sum((TO - FROM) ** 2)


def main() -> None:
    """Prints by how much the tip goes too far, and draws where a file is named."""
    runs = {}
    for payload in (0.0, 0.02):
        for controller in ("inverse", "moving-mpc"):
            run = step(controller, payload)
            time, part = runs[payload, controller] = response(run)
            off = np.linalg.norm(run.tips - TO, axis=1) > 0.05 * np.linalg.norm(TO - FROM)
            overshoot, settled = 100 * max(part.max() - 1, 0.0), time[off][-1] + 0.04
            print(f"{1e3 * payload:2.0f} g, {controller:10}: overshoot {overshoot:4.1f} %, settled to 5 % after {settled:.2f} s")
    if len(sys.argv) > 1:
        import matplotlib.pyplot as plt

        figure, both = plt.subplots(1, 2, figsize=(9, 3.6), sharey=True, layout="constrained")
        for axes, payload in zip(both, (0.0, 0.02), strict=True):
            axes.plot([-0.5, 0, 0, 2], [0, 0, 36, 36], "k", linewidth=1, label="target")
            for controller in ("inverse", "moving-mpc"):
                time, part = runs[payload, controller]
                axes.plot(time, 36 * part, ".-", label=controller)
            axes.set(xlabel="time (s)", title=f"payload that no model has: {1e3 * payload:.0f} g", xlim=(-0.3, 2))
        both[0].set(ylabel="way of the tip (mm)")
        both[0].legend()
        figure.savefig(sys.argv[1], dpi=150)


if __name__ == "__main__":
    main()
