"""The tasks of the environments that are registered."""

from __future__ import annotations

from tdcr.envs.obstructed import Insert, ReachObstacle
from tdcr.envs.push import Push
from tdcr.envs.tasks import Payload, Reach, ReachGoal, ReachGoalDense, Shape, Task, Track

TASKS: dict[str, type[Task]] = {
    "reach": Reach,
    "reach_goal": ReachGoal,
    "reach_goal_dense": ReachGoalDense,
    "reach_obstacle": ReachObstacle,
    "insert": Insert,
    "push": Push,
    "shape": Shape,
    "payload": Payload,
    "track": Track,
}
"""Tasks by name."""
