"""Tendon-driven continuum robots: simulate, differentiate, see, learn.

>>> import tdcr
>>> robot = tdcr.Robot("2m")
>>> settled = tdcr.settle(robot, [0.034, 0.007, 0.001, 0.026, 0.015, 0.019], payload=0.02)
>>> settled.converged
True

SI units throughout: metres, kilograms, seconds, newtons, radians; quaternions are (w, x, y, z); the world's z axis points up.
Arrays may be of any library that NumPy understands. Errors are of the tree in :mod:`tdcr.errors`.
"""

from tdcr import errors, inverse
from tdcr._tdcr import __version__, set_threads, threads
from tdcr.errors import TdcrError
from tdcr.inverse import calibrate
from tdcr.loads import Loads, Wrench
from tdcr.robot import Robot
from tdcr.sensitivity import jacobian, jvp, vjp
from tdcr.statics import Equilibria, Equilibrium, Settler, follow, settle, settle_batch
from tdcr.sweeps import sweep
from tdcr.tendon_friction import FrictionPath
from tdcr.vision import Cloud, View, cloud, clouds, render
from tdcr.dynamics import Motion, Motions, State, rollout, simulate
from tdcr.dynamics_gradient import Linearisation, RolloutGradients, linearise, rollout_vjp
from tdcr.moving_robot import MovingRobot

__all__ = [
    "Cloud",
    "Equilibria",
    "Equilibrium",
    "FrictionPath",
    "Linearisation",
    "Loads",
    "Motion",
    "Motions",
    "MovingRobot",
    "Robot",
    "RolloutGradients",
    "Settler",
    "State",
    "TdcrError",
    "View",
    "Wrench",
    "__version__",
    "calibrate",
    "cloud",
    "clouds",
    "errors",
    "follow",
    "inverse",
    "jacobian",
    "jvp",
    "linearise",
    "render",
    "rollout",
    "rollout_vjp",
    "set_threads",
    "settle",
    "settle_batch",
    "simulate",
    "sweep",
    "threads",
    "vjp",
]
