"""What one says of the teleoperator."""

from dataclasses import dataclass
from pathlib import Path

from lerobot.teleoperators import TeleoperatorConfig


@TeleoperatorConfig.register_subclass("tdcr")
@dataclass(kw_only=True)
class TdcrTeleopConfig(TeleoperatorConfig):
    """Keys that move the tip, or a file of commands.

    Attributes:
        step: How far a key moves the tip (m).
        keys: The file that keys are read from, stdin where there is none: `lerobot-record` reads the keys of its own terminal,
            unless there is an X display. A pipe (`mkfifo`) gives those of another one.
        commands: A table (CSV) with columns c0, c1, ..., as `tdcr plan` and `tdcr reach` write: a row for each frame, from the
            first one again after the last. Keys are not read then.
    """

    step: float = 0.002
    keys: Path | None = None
    commands: Path | None = None
