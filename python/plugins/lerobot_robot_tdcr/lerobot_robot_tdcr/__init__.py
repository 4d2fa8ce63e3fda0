"""A rig of `tdcr`, simulated or real, as a robot of LeRobot, and keys that steer its tip as a teleoperator.

    pip install ./python/plugins/lerobot_robot_tdcr
    lerobot-record --robot.type=tdcr --robot.rig=rig.toml --teleop.type=tdcr ...

LeRobot finds both by the package's name. Actions are commands of the tendons (m, `tendon0.pos`, ...), observations the commands
that the servos' places stand for, with `--robot.currents=true` their currents (A, `tendon0.current`, ...), and the pictures of
the rig's cameras by serial numbers.
"""

from .config_tdcr import TdcrRobotConfig
from .config_tdcr_teleop import TdcrTeleopConfig
from .tdcr_robot import TdcrRobot
from .tdcr_teleop import TdcrTeleop

__all__ = ["TdcrRobot", "TdcrRobotConfig", "TdcrTeleop", "TdcrTeleopConfig"]
