"""The page on which an environment shows its robot."""

from __future__ import annotations

import time
from typing import Any

from tdcr.envs.episodes import Episodes
from tdcr.envs.rig_world import RigWorld
from tdcr.viewing import Viewer, view


class Window:
    """A page that is opened with the first thing to show. Copies and pickles have none yet.

    Attributes:
        viewer: The page; ``None`` as long as nothing was shown.
    """

    def __init__(self) -> None:
        self.viewer: Viewer | None = None
        self._next = 0.0

    def __getstate__(self) -> dict[str, Any]:
        return {"viewer": None, "_next": 0.0}

    def show(self, episodes: Episodes, frames: float) -> None:
        """Shows the first row, at most ``frames`` times a second: what comes sooner waits."""
        if self.viewer is None:
            self.viewer = _open(episodes)
        world = episodes.world
        if isinstance(world, RigWorld):
            self.viewer.show(world.commands[0])
        else:
            targets, radius = episodes.balls(0)
            self.viewer._native.show_row(world.simulation, 0, targets, radius)
        now = time.monotonic()
        time.sleep(max(0.0, self._next - now))
        self._next = max(now, self._next) + 1.0 / frames

    def close(self) -> None:
        """Ends the page."""
        if self.viewer is not None:
            self.viewer.close()
            self.viewer = None


def _open(episodes: Episodes) -> Viewer:
    return view(episodes.world.robot, browser=True)
