"""Training in PyTorch: the networks, data, sampler and trainer of `tdcr train`, on GPUs and on several of them.

PyTorch is an optional dependency: ``pip install ".[torch]"``. See the guide *Training in PyTorch*.
"""

from tdcr.errors import MissingPackageError

try:
    import torch as _torch  # noqa: F401
except ImportError as error:
    raise MissingPackageError("tdcr.torch needs PyTorch, which is not installed: pip install torch safetensors") from error

from tdcr.torch.data import CloudSet, SetSamples, StreamSamples, find_reduction
from tdcr.torch.flow import FlowPath, Sampler, integrate, loss
from tdcr.torch.functions import rollout, settle
from tdcr.torch.model import Model, write_predictions
from tdcr.torch.networks import Hybrid, Mlp, network
from tdcr.torch.pvcnn import PvcnnHybrid
from tdcr.torch.ranks import distributed
from tdcr.torch.settings import Preset, Settings, preset
from tdcr.torch.trainer import Trainer

__all__ = [
    "CloudSet",
    "FlowPath",
    "Hybrid",
    "Mlp",
    "Model",
    "Preset",
    "PvcnnHybrid",
    "Sampler",
    "SetSamples",
    "Settings",
    "StreamSamples",
    "Trainer",
    "distributed",
    "find_reduction",
    "integrate",
    "loss",
    "network",
    "preset",
    "rollout",
    "settle",
    "write_predictions",
]
