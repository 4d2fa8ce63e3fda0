"""Training in PyTorch: the networks, data, sampler and trainer of `tdcr train`, on GPUs and on several of them.

PyTorch is an optional dependency: ``pip install tdcr[torch]``. See the guide *Training in PyTorch*.
"""

try:
    import torch as _torch  # noqa: F401
except ImportError as error:
    raise ImportError("tdcr.torch needs PyTorch, which is not installed: pip install tdcr[torch]") from error

from .data import CloudSet, SetSamples, StreamSamples
from .flow import FlowPath, Sampler, integrate, loss
from .model import Model, write_predictions
from .networks import Hybrid, Mlp, network
from .ranks import distributed
from .settings import Preset, Settings, preset
from .trainer import Trainer

__all__ = [
    "CloudSet",
    "FlowPath",
    "Hybrid",
    "Mlp",
    "Model",
    "Preset",
    "Sampler",
    "SetSamples",
    "Settings",
    "StreamSamples",
    "Trainer",
    "distributed",
    "integrate",
    "loss",
    "network",
    "preset",
    "write_predictions",
]
