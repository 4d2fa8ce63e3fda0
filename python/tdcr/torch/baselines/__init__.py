"""The methods that the paper compares with, trained on the same data sets and scored by the same evaluator.

    python -m tdcr.torch.baselines vsm --data data --out vsm
    python -m tdcr.torch.baselines predict --model vsm --data data --out vsm.npz
    tdcr eval --predictions vsm.npz --data data

See the guide *The paper's baselines*. They are for comparison: no other part of the package uses them.
"""

from tdcr.torch.baselines._method import Method, Settings, Training
from tdcr.torch.baselines._model import BaselineModel, write_predictions
from tdcr.torch.baselines._registry import METHODS, method
from tdcr.torch.baselines._run import Run
from tdcr.torch.baselines.captured import Pictures

__all__ = ["METHODS", "BaselineModel", "Method", "Pictures", "Run", "Settings", "Training", "method", "write_predictions"]
