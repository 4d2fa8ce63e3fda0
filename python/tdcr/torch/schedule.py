"""Learning rate, averaging and divergence of a run, as `tdcr train` has them; and its optimisers."""

import math
import statistics
from collections.abc import Iterable, Sequence

import torch
from torch import nn

from tdcr.errors import MissingPackageError
from tdcr.torch.settings import Settings, matrix_learning_rate

#: Shortest side of a hidden layer's matrix, which Muon moves; those with a shorter one are input and output layers.
HIDDEN = 16

#: Steps in a row for which a diverged loss is above its running level times `spike_factor`.
SPIKE_STEPS = 10

#: Losses, before those of the last SPIKE_STEPS steps, whose median is the running level.
LEVEL_STEPS = 100


def learning_rate_at(settings: Settings, step: int) -> float:
    """Linear warm-up to the learning rate, then half a cosine to the final one; the first step is 1. The authors' procedure is a
    step behind, with the full rate at the first."""
    peak, last, warmup = settings["learning_rate"], settings["final_learning_rate"], settings["warmup_steps"]
    if settings["procedure"] == "authors":
        if step == 1:
            return peak
        step -= 1
    if step <= warmup:
        return peak * step / warmup
    progress = (step - warmup) / (settings["steps"] - warmup)
    return last + 0.5 * (peak - last) * (1 + math.cos(math.pi * progress))


def average_decay_at(settings: Settings, step: int) -> float:
    """Decay of the weights' average: it follows fast at first, so that it is not held at the initial weights; in the authors'
    procedure it is constant."""
    if settings["procedure"] == "authors":
        return settings["average_decay"]
    return min(settings["average_decay"], (1 + step) / (10 + step))


def spike_length(settings: Settings, losses: Sequence[float]) -> int:
    """Losses in a row, up to the last one, above the running level times `spike_factor`: SPIKE_STEPS in a run that diverged."""
    before = losses[max(0, len(losses) - SPIKE_STEPS - LEVEL_STEPS) : max(0, len(losses) - SPIKE_STEPS)]
    if len(before) < SPIKE_STEPS:
        return 0
    limit = settings["spike_factor"] * statistics.median(before)
    length = 0
    for loss in reversed(losses[-SPIKE_STEPS:]):
        if loss <= limit:
            break
        length += 1
    return length


class Optimizers:
    """AdamW, or Muon for the matrices of hidden layers and AdamW for all other weights, on the schedule of a run.

    Muon (Jordan et al. 2024) is PyTorch's, which finds the orthogonal matrix in bfloat16.
    """

    def __init__(self, parameters: Iterable[nn.Parameter], settings: Settings) -> None:
        self.settings = settings
        self.matrix_rate = matrix_learning_rate(settings)
        learned = [p for p in parameters if p.requires_grad]
        hidden = [p for p in learned if self.matrix_rate is not None and p.dim() == 2 and min(p.shape) >= HIDDEN]
        chosen = {id(p) for p in hidden}
        others = [p for p in learned if id(p) not in chosen]
        decay = settings["weight_decay"]
        self.parts: list[torch.optim.Optimizer] = []
        if others:
            self.parts.append(torch.optim.AdamW(others, betas=(0.9, 0.999), eps=1e-8, weight_decay=decay))
        if hidden and not hasattr(torch.optim, "Muon"):
            raise MissingPackageError(f"Muon needs PyTorch 2.9 or later, this is {torch.__version__}; expected optimizer adamw")
        if hidden:
            self.parts.append(torch.optim.Muon(hidden, momentum=0.95, nesterov=True, ns_steps=5, weight_decay=decay))

    def step(self, step: int) -> None:
        """Moves the weights against their gradients."""
        rate = learning_rate_at(self.settings, step)
        for part in self.parts:
            own = rate
            if isinstance(part, torch.optim.Muon) and self.matrix_rate is not None:
                own = self.matrix_rate * (rate / self.settings["learning_rate"])
            for parameters in part.param_groups:
                parameters["lr"] = own
            part.step()
            part.zero_grad(set_to_none=True)

    def state(self) -> list[dict[str, object]]:
        """What a resumed run needs."""
        return [part.state_dict() for part in self.parts]

    def load(self, states: Sequence[dict[str, object]]) -> None:
        """Goes on from a state."""
        for part, state in zip(self.parts, states, strict=True):
            part.load_state_dict(state)
