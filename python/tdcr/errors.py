"""What can go wrong: one tree of exceptions, under :class:`TdcrError`.

Messages say what was found, where, and what would be right. An input that is refused is a ``ValueError`` too, a computation
without a result a ``RuntimeError``.
"""

from __future__ import annotations


class TdcrError(Exception):
    """Base of all errors of this package."""


class InputError(TdcrError, ValueError):
    """An argument has the wrong shape, type or value."""


class ArgumentError(InputError, TypeError):
    """An argument that is not known: a ``TypeError`` too, as of any function that is called with one."""


class RobotError(InputError):
    """A robot is unknown, or its file or dictionary does not describe one."""


class CommandError(InputError):
    """A command has the wrong number of entries, or one out of its tendon's range."""


class LoadsError(InputError):
    """A load is not finite, or acts on a disc that the robot does not have."""


class SceneError(InputError):
    """A scene's file or an obstacle does not describe one, or a scene has no such obstacle."""


class ContactError(InputError):
    """A question that is not solved among obstacles: a start inside one, or loads that are moments or turn with their disc."""


class ParameterError(InputError):
    """A parameter is unknown, the robot does not have it, or two that are named together stand for the same numbers."""


class NotSettledError(TdcrError, RuntimeError):
    """There is no equilibrium where one was sought."""


class PlanError(TdcrError, RuntimeError):
    """No motion was found from the start to the goal, or the robot may not be at one of them."""


class SensitivityError(TdcrError, RuntimeError):
    """An equilibrium has no derivatives: the robot has not settled, or is on the brink of instability."""


class DynamicsError(TdcrError, RuntimeError):
    """A motion cannot be computed, or it diverged."""


class DataError(TdcrError, RuntimeError):
    """A data set cannot be read, written, or used."""


class TrainError(TdcrError, RuntimeError):
    """Training cannot start, or diverged; or a model does not fit its use."""


class RigError(TdcrError, RuntimeError):
    """A rig's file does not describe one, a part of it fails, or something made it release the tension."""


class SweepError(TdcrError, RuntimeError):
    """A condition of a sweep could not be computed, as its worker died again and again."""


class MissingPackageError(TdcrError, ImportError):
    """An optional package is not installed."""
