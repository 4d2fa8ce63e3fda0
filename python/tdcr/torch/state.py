"""A run on disk: the state that it is resumed from, and its log."""

import io
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Self

import torch
from torch import Tensor

from tdcr._files import write_whole
from tdcr.errors import TrainError

#: Version of the state's layout.
FORMAT = 1

#: Steps between two rows of the log; there is one more at each validation.
STEPS_PER_ROW = 10


@dataclass
class History:
    """What happened at each step."""

    #: Loss of every step taken.
    losses: list[float] = field(default_factory=list)
    #: Norm of the gradient of every step taken, before clipping.
    norms: list[float] = field(default_factory=list)
    #: Step and mean distance (normalised units squared) of every validation.
    validations: list[tuple[int, float]] = field(default_factory=list)

    def write_log(self, path: Path, rate: Callable[[int], float], area: float) -> None:
        """Writes the columns of `tdcr train`'s log.csv; `rate` is the learning rate of a step (the first is 1), `area` the
        square of the data's scale (m²)."""
        validated = dict(self.validations)
        lines = ["step,loss,gradient_norm,learning_rate,validation_cd"]
        start = 0
        for step in range(1, len(self.losses) + 1):
            if step % STEPS_PER_ROW and step not in validated:
                continue
            loss, norm = (sum(values[start:step]) / (step - start) for values in (self.losses, self.norms))
            cd = f"{validated[step] * area:.6e}" if step in validated else ""
            lines.append(f"{step},{loss:.6e},{norm:.6e},{rate(step):.6e},{cd}")
            start = step
        write_whole(path, ("\n".join(lines) + "\n").encode())


@dataclass
class Best:
    """The averaged weights with the smallest validation distance so far."""

    step: int
    distance: float
    weights: dict[str, Tensor]


@dataclass
class RunState:
    """Everything that a run needs to be resumed as if it had never stopped."""

    #: What tells the run from others: shape, settings, data, initial weights.
    identity: dict[str, Any]
    step: int
    network: dict[str, Tensor]
    average: dict[str, Tensor]
    optimizers: list[dict[str, Any]]
    best: Best | None
    history: History

    def save(self, path: Path) -> None:
        """Writes the state, whole or not at all."""
        content = {"format": FORMAT, **vars(self), "history": asdict(self.history)}
        content["best"] = None if self.best is None else vars(self.best)
        buffer = io.BytesIO()
        torch.save(content, buffer)
        write_whole(path, buffer.getvalue())

    @classmethod
    def load(cls, path: Path, identity: dict[str, Any]) -> Self:
        """Reads the state of the run `identity`, on the CPU.

        Raises:
            tdcr.errors.TrainError: where the file is no state, or that of another run; it says which value differs.
        """
        try:
            content = torch.load(path, map_location="cpu", weights_only=True)
            if content.pop("format") != FORMAT:
                raise TrainError(f"{path}: a state of another version of tdcr")
            best = content.pop("best")
            history = History(**content.pop("history"))
            state = cls(best=None if best is None else Best(**best), history=history, **content)
        except TrainError:
            raise
        except Exception as error:  # torch raises what its unpickler raises
            raise TrainError(f"{path}: not the state of a run: {error}") from error
        difference = first_difference("", state.identity, identity)
        if difference:
            raise TrainError(f"{path} cannot be resumed: {difference}; choose another folder, or remove this one")
        return state


def first_difference(path: str, found: Any, expected: Any) -> str | None:
    """The first value in which two plain values differ, in words."""
    if isinstance(found, dict) and isinstance(expected, dict):
        for key in [*expected, *(key for key in found if key not in expected)]:
            inner = first_difference(f"{path}.{key}" if path else key, found.get(key), expected.get(key))
            if inner:
                return inner
        return None
    return None if found == expected else f"{path} is {found}, expected {expected}"
