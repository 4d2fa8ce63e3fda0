"""Gymnasium environments of tendon-driven continuum robots.

>>> import gymnasium, tdcr.envs
>>> env = gymnasium.make("tdcr/Reach2m-v0")
>>> envs = gymnasium.make_vec("tdcr/Reach2m-v0", num_envs=64)

Importing this module registers them. In one line, ``gymnasium.make("tdcr.envs:tdcr/Reach2m-v0")`` imports it by itself.

============================== =====================================================================================
``tdcr/Reach2m-v0``            the tip to a point; dense reward
``tdcr/ReachGoal2m-v0``        the same with goals in the observation; sparse reward, for HER
``tdcr/ReachGoal2mDense-v0``   the same, dense
``tdcr/ReachObstacle2m-v0``    the tip to a point among obstacles that are drawn for each episode
``tdcr/Insert2m-v0``           the robot into a bent tube, also by moving its base
``tdcr/Push2m-v0``             an object on a table to a place
``tdcr/Shape2m-v0``            the whole robot to a shape: poses of the discs, or a point cloud (``target="cloud"``)
``tdcr/Payload2m-v0``          the tip to a point with an unknown payload
``tdcr/Track2m-v0``            the tip along a path
============================== =====================================================================================

Each is there for ``2m``, ``3m`` and ``5m``; see :class:`TendonRobotEnv` for what they take.
"""

from __future__ import annotations

from tdcr.errors import MissingPackageError

try:
    import gymnasium
except ImportError as error:
    raise MissingPackageError("tdcr.envs needs Gymnasium, which is not installed: pip install gymnasium") from error

from tdcr.envs.all_tasks import TASKS
from tdcr.envs.environment import TendonRobotEnv, TendonRobotGoalEnv
from tdcr.envs.tasks import Task
from tdcr.envs.vector import TendonRobotVectorEnv

__all__ = ["TASKS", "Task", "TendonRobotEnv", "TendonRobotGoalEnv", "TendonRobotVectorEnv", "register"]

_IDS = {
    "Reach{}": "reach",
    "ReachGoal{}": "reach_goal",
    "ReachGoal{}Dense": "reach_goal_dense",
    "ReachObstacle{}": "reach_obstacle",
    "Insert{}": "insert",
    "Push{}": "push",
    "Shape{}": "shape",
    "Payload{}": "payload",
    "Track{}": "track",
}


def register() -> None:
    """Registers the environments with Gymnasium. Importing this module does so; to do it again changes nothing."""
    for name, task in _IDS.items():
        env = "TendonRobotGoalEnv" if TASKS[task].goal_based else "TendonRobotEnv"
        for robot in ("2m", "3m", "5m"):
            id = f"tdcr/{name.format(robot)}-v0"
            if id not in gymnasium.registry:
                gymnasium.register(
                    id=id,
                    entry_point=f"tdcr.envs.environment:{env}",
                    vector_entry_point="tdcr.envs.vector:TendonRobotVectorEnv",
                    kwargs={"task": task, "robot": robot},
                )


register()
