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
        real_time: Whether a rig in memory keeps to the wall's clock; else it is as fast as it computes.
    """

    rig: Path
    pictures: bool = True
    real_time: bool = True
