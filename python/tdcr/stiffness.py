"""How stiff robots are where they settle."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from tdcr import _tdcr
from tdcr._arrays import Floats
from tdcr.loads import Loads
from tdcr.robot import RobotLike
from tdcr.scene import Scene
from tdcr.statics import Rows


def smallest_stiffness(
    robot: RobotLike | Sequence[RobotLike],
    commands: Any,
    payload: Any = None,
    *,
    wrench: Any = None,
    loads: Loads | Sequence[Loads] | None = None,
    scene: Scene | Sequence[Scene] | None = None,
) -> Floats:
    """Stiffness of the softest mode where each row settles, as ``tdcr settle`` prints it.

    It is the smallest eigenvalue of the energy's Hessian by the joints' turns, the stiffness of contacts included, on those turns
    that keep the commanded lengths of taut inextensible tendons. Under moments and forces that turn with their disc it is the
    smallest real part of the eigenvalues of the moments' Jacobian, which is no measure of stability. It takes several times as
    long as settling.

    Args:
        robot, commands, payload, wrench, loads, scene: As of :func:`settle_batch`.

    Returns:
        Shape (rows,) (N m/rad): above 0 where the equilibrium is stable, infinite where commanded lengths leave the joints no
        freedom, not a number where the robot does not settle.

    Raises:
        CommandError, LoadsError, ContactError, InputError: As of :func:`settle_batch`.
    """
    rows = Rows.of(robot, commands, payload, wrench, loads, scene)
    return _tdcr.smallest_stiffness_rows(rows.argument(), rows.maybe_scenes())
