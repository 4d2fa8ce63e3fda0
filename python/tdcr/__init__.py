"""Tendon-driven continuum robots: simulate, differentiate, see, learn.

>>> import tdcr
>>> robot = tdcr.Robot("2m")
>>> settled = tdcr.settle(robot, [0.034, 0.007, 0.001, 0.026, 0.015, 0.019], payload=0.02)
>>> settled.converged
True

SI units throughout: metres, kilograms, seconds, newtons, radians; quaternions are (w, x, y, z); the world's z axis points up.
Arrays may be of any library that NumPy understands. Errors are of the tree in :mod:`tdcr.errors`.
"""

from tdcr import errors, metrics
from tdcr._tdcr import __version__, set_threads, threads
from tdcr.collecting import collect, merge
from tdcr.data import Dataset, Normalisation, Sample, Split
from tdcr.errors import TdcrError
from tdcr.learning import Run, distill, train
from tdcr.loads import Loads, Wrench
from tdcr.predictor import Clouds, ExtrapolationWarning, Predictor
from tdcr.robot import Robot
from tdcr.scoring import evaluate
from tdcr.sensitivity import jacobian, jvp, vjp
from tdcr.statics import Equilibria, Equilibrium, Settler, follow, settle, settle_batch

__all__ = [
    "Clouds",
    "Dataset",
    "Equilibria",
    "Equilibrium",
    "ExtrapolationWarning",
    "Loads",
    "Normalisation",
    "Predictor",
    "Robot",
    "Run",
    "Sample",
    "Settler",
    "Split",
    "TdcrError",
    "Wrench",
    "__version__",
    "collect",
    "distill",
    "errors",
    "evaluate",
    "follow",
    "jacobian",
    "jvp",
    "merge",
    "metrics",
    "set_threads",
    "settle",
    "settle_batch",
    "threads",
    "train",
    "vjp",
]
