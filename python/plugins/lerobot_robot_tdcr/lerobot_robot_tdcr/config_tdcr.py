"""What one says of the robot."""

from dataclasses import dataclass
from pathlib import Path

from lerobot.robots import RobotConfig


@RobotConfig.register_subclass("tdcr")
@dataclass(kw_only=True)
class TdcrRobotConfig(RobotConfig):
    """A rig of tdcr.

    Attributes:
        rig: Its file.
        pictures: Whether its cameras are looked through: each look takes as long as they take.
        currents: Whether observations have the currents of the servos. `lerobot-rollout` hands a policy no more than positions,
            so that one which was trained with currents does not run there (LeRobot 0.6).
        hold: How long the robot holds its pose while LeRobot does something else (s), as encoding an episode. The tension is
            released then.
        real_time: Whether a rig in memory keeps to the wall's clock; else it is as fast as it computes.
    """

    rig: Path
    pictures: bool = True
    currents: bool = False
    hold: float = 300.0
    real_time: bool = True
