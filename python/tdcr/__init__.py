"""Tendon-driven continuum robots: simulate, differentiate, see, learn.

>>> import tdcr
>>> robot = tdcr.Robot("2m")
>>> settled = tdcr.settle(robot, [0.034, 0.007, 0.001, 0.026, 0.015, 0.019], payload=0.02)
>>> settled.converged
True

SI units throughout: metres, kilograms, seconds, newtons, radians; quaternions are (w, x, y, z); the world's z axis points up.
Arrays may be of any library that NumPy understands. Errors are of the tree in :mod:`tdcr.errors`.
"""

from tdcr import errors, inverse, metrics
from tdcr._tdcr import __version__
from tdcr._threads import set_threads, threads
from tdcr._train_options import TrainOptions
from tdcr.bags import Bag, export_rosbag2
from tdcr.collecting import collect, export_clouds, import_clouds, merge
from tdcr.contact import Contacts
from tdcr.contact_law import Compliant, Impedance
from tdcr.data import Dataset, Normalisation, Sample, Split, data_view
from tdcr.dynamics import Motion, Motions, State, rollout, simulate
from tdcr.dynamics_gradient import (
    Linearisation,
    RolloutGradients,
    RolloutRates,
    RolloutTangents,
    linearise,
    rollout_jvp,
    rollout_vjp,
)
from tdcr.errors import TdcrError
from tdcr.inverse import calibrate
from tdcr.learning import Run, demo, distill, train
from tdcr.loads import Loads, Wrench
from tdcr.moving_robot import MovingRobot
from tdcr.objects import Hinge, Objects, Slider
from tdcr.obstacles import Obstacle
from tdcr.planning import Deployment, Plan, follow_the_leader, plan
from tdcr.predictor import ExtrapolationWarning, Prediction, Predictor, Reached
from tdcr.recordings import RecordingCalibration, calibrate_recording
from tdcr.rerun_logs import log_to_rerun
from tdcr.rig import Rig
from tdcr.robot import Robot
from tdcr.robot_parameters import Parameter, Parameters, parameters
from tdcr.scene import Scene
from tdcr.scene_gradient import SceneGradients, base_jacobian, obstacle_jacobian, scene_vjp
from tdcr.scoring import compare, evaluate
from tdcr.sensitivity import jacobian, jvp, vjp
from tdcr.starting import new
from tdcr.statics import Equilibria, Equilibrium, Settler, follow, settle, settle_batch
from tdcr.stiffness import smallest_stiffness
from tdcr.stream import Stream
from tdcr.studies import merge_study, study
from tdcr.sweeps import sweep
from tdcr.tendon_friction import FrictionPath
from tdcr.tracking import Tracking, track
from tdcr.viewing import Viewer, view
from tdcr.vision import Cloud, View, cloud, clouds, render

__all__ = [
    "Bag",
    "Cloud",
    "Compliant",
    "Contacts",
    "Dataset",
    "Deployment",
    "Equilibria",
    "Equilibrium",
    "ExtrapolationWarning",
    "FrictionPath",
    "Hinge",
    "Impedance",
    "Linearisation",
    "Loads",
    "Motion",
    "Motions",
    "MovingRobot",
    "Normalisation",
    "Objects",
    "Obstacle",
    "Parameter",
    "Parameters",
    "Plan",
    "Prediction",
    "Predictor",
    "Reached",
    "RecordingCalibration",
    "Rig",
    "Robot",
    "RolloutGradients",
    "RolloutRates",
    "RolloutTangents",
    "Run",
    "Sample",
    "Scene",
    "SceneGradients",
    "Settler",
    "Slider",
    "Split",
    "State",
    "Stream",
    "TdcrError",
    "Tracking",
    "TrainOptions",
    "View",
    "Viewer",
    "Wrench",
    "__version__",
    "base_jacobian",
    "calibrate",
    "calibrate_recording",
    "cloud",
    "clouds",
    "collect",
    "compare",
    "data_view",
    "demo",
    "distill",
    "errors",
    "evaluate",
    "export_clouds",
    "export_rosbag2",
    "follow",
    "follow_the_leader",
    "import_clouds",
    "inverse",
    "jacobian",
    "jvp",
    "linearise",
    "log_to_rerun",
    "merge",
    "merge_study",
    "metrics",
    "new",
    "obstacle_jacobian",
    "parameters",
    "plan",
    "render",
    "rollout",
    "rollout_jvp",
    "rollout_vjp",
    "scene_vjp",
    "set_threads",
    "settle",
    "settle_batch",
    "simulate",
    "smallest_stiffness",
    "study",
    "sweep",
    "threads",
    "track",
    "train",
    "view",
    "vjp",
]
