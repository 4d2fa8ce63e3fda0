"""The training run of a baseline: steps, validations by the Chamfer distance, files.

What a step sees follows from the seed, its number and the kind of device, so a run of a number of steps that is resumed equals
one that was not interrupted. One that ends by the clock takes as many steps as there is time for.
"""

import copy
import json
import math
import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn

from tdcr.errors import InputError, TrainError
from tdcr.torch.baselines._method import Method, Settings, Training
from tdcr.torch.baselines._model import FILE, BaselineModel
from tdcr.torch.baselines.captured import Pictures
from tdcr.torch.batch import STEP, VALIDATION, chamfer, generator
from tdcr.torch.data import CloudSet
from tdcr.torch.files import locked
from tdcr.torch.state import STEPS_PER_ROW, Best, History, RunState
from tdcr.torch.trainer import Diverged, Interrupted, Monitor, to_cpu

#: Seconds after which losses are read, interruptions noticed and the clock is looked at, where steps take long.
SECONDS_PER_LOOK = 2.0


def refuse_pictures(kind: type[Method], pictures: Pictures) -> None:
    """Refuses pictures that a method does not learn from, and none of what it learns from."""
    if kind.learns_from == "clouds":
        raise InputError(f"{kind.name} learns from clouds, expected no masks and frames")
    if kind.learns_from == "masks" and pictures.frames is not None:
        raise InputError(f"{kind.name} learns from masks alone, expected no frames")
    if kind.learns_from == "colours" and pictures.frames is None:
        raise InputError(f"{kind.name} learns from colours too, expected the frames beside their masks")


@dataclass
class BaselineState(RunState):
    """Everything that a run needs to be resumed as if it had never stopped; it averages no weights."""

    #: Sizes of the method's networks and of the best ones.
    shape: dict[str, Any]
    best_shape: dict[str, Any] | None
    #: Learning rate of every step taken.
    rates: list[float]
    #: Time taken, by the clock and of all processors (s).
    seconds: float
    processor_seconds: float


class Run:
    """A run of a method on a data set, in a folder: `model.safetensors` (the best validated weights), `state.pt`, `log.csv`."""

    def __init__(
        self,
        kind: type[Method],
        folder: str | Path,
        out: str | Path,
        settings: Settings,
        *,
        pictures: Pictures | None = None,
        device: torch.device | str = "cpu",
        monitor: Monitor | None = None,
        tell: Callable[[str], None] = lambda text: None,
        interrupted: Callable[[], bool] = lambda: False,
    ) -> None:
        """Reads the data set. `pictures` are of its samples, for a method that learns from them, in place of rendered ones.
        `interrupted` is asked every ten steps, or every two seconds where steps take long.

        Raises:
            tdcr.errors.TdcrError: for whatever is wrong with the data set.
        """
        self.began, self.processors_began = time.monotonic(), processor_time()
        self.kind, self.out, self.settings, self.device = kind, Path(out), settings, torch.device(device)
        self.monitor, self.interrupted = monitor, interrupted
        if settings.precision == "tf32" and self.device.type != "cuda":
            raise InputError("precision is 'tf32', which a GPU alone has; expected 'float32' or 'bfloat16'")
        if pictures is not None:
            refuse_pictures(kind, pictures)
        training, validation = (CloudSet.read(folder, split) for split in ("train", "val"))
        self.identity = json.loads(
            json.dumps(
                {
                    "method": kind.name,
                    "settings": asdict(settings),
                    "data": [training.fingerprint(), validation.fingerprint()],
                    **({} if pictures is None else {"pictures": pictures.fingerprint()}),
                }
            )
        )
        self.validation = validation.to(self.device)
        self.training = Training(Path(folder), training.to(self.device), settings, self.device, tell, pictures)
        self.step, self.history, self.rates = 0, History(), list[float]()
        self.best: Best | None = None
        self.best_shape: dict[str, Any] | None = None
        self.seconds_before, self.processors_before = 0.0, 0.0
        #: Losses and norms of the last steps on the device, not yet in the history.
        self.recent: list[tuple[Tensor, Tensor]] = []

    @property
    def seconds(self) -> float:
        """Time that the run took, with its interrupted parts (s)."""
        return self.seconds_before + time.monotonic() - self.began

    @property
    def processor_seconds(self) -> float:
        """Time of all processors (s)."""
        return self.processors_before + processor_time() - self.processors_began

    def run(self) -> BaselineModel:
        """Takes the steps that are left; returns the method with the best validation distance.

        Raises:
            tdcr.torch.trainer.Interrupted: as asked; the state is saved.
            tdcr.torch.trainer.Diverged: where the loss is not finite.
            tdcr.errors.TrainError: where the folder holds another run, or another process works in it.
        """
        with locked(self.out), products(self.settings, self.device):
            method, optimizer = self.begin()
            if self.monitor:
                self.monitor.begin(self.settings.steps or 0, self.step)
            progress, looked = self.progress(), time.monotonic()
            # Also a run whose time went by before its first step has a model.
            while progress < 1.0 or self.best is None:
                self.take_step(method, optimizer, progress)
                after = self.progress()
                validated = after >= 1.0 or self.due(after) > self.due(progress)
                recent = time.monotonic() - looked < SECONDS_PER_LOOK
                if not validated and self.step % STEPS_PER_ROW and recent:
                    progress = after
                    continue
                stop, looked = self.gather(), time.monotonic()
                if validated:
                    self.validate(method)
                if validated or stop:
                    self.save(method, optimizer)
                progress = self.progress()
                if stop and progress < 1.0:
                    raise Interrupted
            return self.model()

    def progress(self) -> float:
        """Part of the run that is done, from 0 to 1."""
        settings = self.settings
        by_steps = 0.0 if settings.steps is None else self.step / settings.steps
        by_clock = 0.0 if settings.minutes is None else self.seconds / (60 * settings.minutes)
        return min(1.0, max(by_steps, by_clock))

    def due(self, progress: float) -> int:
        """Validations that are due in this part of the run."""
        return math.floor(progress * self.settings.validations + 1e-9)

    def begin(self) -> tuple[Method, torch.optim.Optimizer]:
        """The method and its optimiser, new or from the state in the folder."""
        state = self.read_state()
        torch.manual_seed(self.settings.seed)
        if state is None:
            method = self.kind.start(self.training).to(self.device)
        else:
            method = self.kind(**state.shape).to(self.device)
            method.load_state_dict(state.network)
        optimizer = method.optimizer(self.settings)
        for group in optimizer.param_groups:
            group.setdefault("initial_lr", group["lr"])
        if state is not None:
            optimizer.load_state_dict(state.optimizers[0])
            self.step, self.history, self.rates = state.step, state.history, state.rates
            self.best, self.best_shape = state.best, state.best_shape
            self.seconds_before, self.processors_before = state.seconds, state.processor_seconds
        method.prepare(self.training)
        return method, optimizer

    def read_state(self) -> BaselineState | None:
        """The state in the folder, of this run."""
        path, model = self.out / "state.pt", self.out / FILE
        if path.exists():
            return BaselineState.load(path, self.identity)
        if model.exists():
            raise TrainError(
                f"{model} is a model without the state.pt of its run, and would be overwritten: choose another folder, "
                "or move it away"
            )
        return None

    def take_step(self, method: Method, optimizer: torch.optim.Optimizer, progress: float) -> None:
        """One step of the optimiser."""
        self.step += 1
        rate = method.rate(progress)
        for group in optimizer.param_groups:
            group["lr"] = rate * group["initial_lr"]
        numbers = generator(self.device, self.settings.seed, STEP, self.step)
        method.train()
        optimizer.zero_grad()
        with self.autocast():
            loss = method.loss(self.training, self.step, numbers)
        torch.autograd.backward(loss)
        norm = nn.utils.clip_grad_norm_(
            method.parameters(), math.inf if self.settings.clip_norm is None else self.settings.clip_norm
        )
        optimizer.step()
        method.stepped(self.training, self.step, progress)
        self.recent.append((loss.detach(), norm.detach()))
        self.rates.append(rate * self.settings.learning_rate)

    def autocast(self) -> torch.autocast:
        """Products in bfloat16 where the settings ask for it."""
        return torch.autocast(self.device.type, torch.bfloat16, enabled=self.settings.precision == "bfloat16")

    def gather(self) -> bool:
        """Brings the losses and norms of the last steps into the history; whether the run is asked to stop.

        Raises:
            tdcr.torch.trainer.Diverged: where one is not finite.
        """
        pairs = torch.stack([torch.stack(pair).double() for pair in self.recent]).tolist()
        self.recent.clear()
        for loss, norm in pairs:
            k = len(self.history.losses) + 1
            if not (math.isfinite(loss) and math.isfinite(norm)):
                raise Diverged(
                    f"the loss of step {k} is {loss}, its gradient's norm {norm}: training diverged. Choose a learning rate "
                    f"below {self.settings.learning_rate}, in another folder"
                )
            self.history.losses.append(loss)
            self.history.norms.append(norm)
        if self.monitor:
            self.monitor.advance(self.step, sum(loss for loss, _ in pairs) / len(pairs))
        return self.interrupted()

    def validate(self, method: Method) -> None:
        """Mean Chamfer distance of clouds of the validation split; the best weights are kept."""
        mean = self.distance(method)
        self.history.validations.append((self.step, mean))
        # The first validated weights are kept whatever their clouds are.
        if self.best is None or mean < self.best.distance:
            self.best = Best(self.step, mean, to_cpu(method.state_dict()))
            self.best_shape = json.loads(json.dumps(method.shape()))
        if self.monitor:
            area = self.training.scale**2
            self.monitor.validated(self.step, self.history.losses[-1], mean * area)

    @torch.no_grad()
    def distance(self, method: Method) -> float:
        """Mean Chamfer distance (the data's units squared) between clouds of the validation split and predictions.

        Random numbers depend on the seed alone, so that validations compare.
        """
        method.eval()
        clouds, settings = self.validation, self.settings
        count = min(settings.validation_clouds, len(clouds))
        points = min(settings.validation_points, clouds.points_per_cloud)
        which = [k * len(clouds) // count for k in range(count)]
        predicted = method.points(clouds.conditions[which], points, which)
        total = 0.0
        for cloud, found in zip(which, predicted, strict=True):
            numbers = generator(self.device, settings.seed, VALIDATION, cloud)
            subset = torch.randperm(clouds.points_per_cloud, generator=numbers, device=self.device)[:points]
            total += chamfer(found.float(), clouds.rows[cloud, subset])
        return total / count

    def save(self, method: Method, optimizer: torch.optim.Optimizer) -> None:
        """Writes model, log and state."""
        if self.best is not None:
            self.model().save(self.out / FILE)
        self.history.write_log(self.out / "log.csv", lambda step: self.rates[step - 1], self.training.scale**2)
        state = BaselineState(
            identity=self.identity,
            step=self.step,
            network=to_cpu(method.state_dict()),
            average={},
            optimizers=[copy.deepcopy(optimizer.state_dict())],
            best=self.best,
            history=self.history,
            shape=json.loads(json.dumps(method.shape())),
            best_shape=self.best_shape,
            rates=self.rates,
            seconds=self.seconds,
            processor_seconds=self.processor_seconds,
        )
        state.save(self.out / "state.pt")

    def model(self) -> BaselineModel:
        """The best validated weights so far."""
        assert self.best is not None and self.best_shape is not None
        method = self.kind(**self.best_shape)
        method.load_state_dict(self.best.weights)
        return BaselineModel(
            method=method.eval(),
            settings=self.settings,
            provenance=self.training.clouds.provenance,
            step=self.best.step,
            validation_distance=self.best.distance,
            seconds=self.seconds,
            processor_seconds=self.processor_seconds,
        )


def processor_time() -> float:
    """Time of all processors that this process and those it has waited for took (s)."""
    taken = os.times()
    return taken.user + taken.system + taken.children_user + taken.children_system


@contextmanager
def products(settings: Settings, device: torch.device) -> Iterator[None]:
    """Matrix products of float32 numbers as the settings have them, within the block."""
    before = torch.get_float32_matmul_precision()
    if device.type == "cuda":
        torch.set_float32_matmul_precision("high" if settings.precision == "tf32" else "highest")
    try:
        yield
    finally:
        torch.set_float32_matmul_precision(before)
