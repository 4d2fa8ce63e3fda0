"""A rig of `tdcr`, simulated or real, as a robot of LeRobot: `--robot.type=tdcr --robot.rig=rig.toml`.

    pip install ./python/plugins/lerobot_robot_tdcr
    lerobot-record --robot.type=tdcr --robot.rig=rig.toml ...

LeRobot finds it by its name. Actions are commands of the tendons (m, `tendon0.pos`, ...), observations the commands that the
servos' places stand for, their currents (A, `tendon0.current`, ...) and the pictures of the rig's cameras by serial numbers.
"""

from .config_tdcr import TdcrRobotConfig
from .tdcr_robot import TdcrRobot

__all__ = ["TdcrRobot", "TdcrRobotConfig"]
