"""The training loop of action-conditioned flow matching (paper, Alg. tdcr-training), on one device or on several.

What step k sees follows from the seed, k and the kind of device: the batch of a data set is the same for any number of
ranks, each of which takes every R-th cloud of it, so a run on several devices is that on one but for rounding. A run that is
resumed is one that was not interrupted, bit for bit on the same devices as far as PyTorch's kernels are deterministic.
"""

import copy
import json
import math
from collections.abc import Callable
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import Protocol

import torch
from torch import Tensor, nn
from torch import distributed as dist
from torch.nn.parallel import DistributedDataParallel

from tdcr.errors import InputError, TrainError
from tdcr.torch.batch import VALIDATION, chamfer, draw, generator
from tdcr.torch.data import CloudSet, StreamWindow
from tdcr.torch.files import locked
from tdcr.torch.flow import NORMALISED, FlowPath, Sampler, integrate, loss, reach_of
from tdcr.torch.layers import Shape
from tdcr.torch.model import Model
from tdcr.torch.ranks import group
from tdcr.torch.schedule import SPIKE_STEPS, Optimizers, average_decay_at, learning_rate_at, spike_length
from tdcr.torch.settings import Settings, complete
from tdcr.torch.state import STEPS_PER_ROW, Best, History, RunState


class Monitor(Protocol):
    """Who watches a run; rank 0 tells it."""

    def begin(self, steps: int, taken: int) -> None:
        """The run starts, with `taken` of its steps taken."""

    def advance(self, step: int, loss: float) -> None:
        """Some steps were taken, with this mean loss."""

    def validated(self, step: int, loss: float, cd: float) -> None:
        """The averaged weights were validated: mean Chamfer distance `cd` (m²)."""


class Interrupted(Exception):
    """The run was asked to stop. It is resumed by starting it again."""


class Diverged(TrainError):
    """The loss is not finite, or leapt and stayed high; the last good state is on disk."""


class Trainer:
    """A training run of any module that maps points (B, N, C), flow times (B,) and conditions (B, D) to velocities (B, N, C).

    C is 3, or 6 where the clouds have colours; see :func:`tdcr.torch.distributed` for several devices. Rank 0 alone keeps the
    average of the weights, validates it, and writes the folder: `model.safetensors`, `state.pt`, `log.csv`.
    """

    def __init__(
        self,
        network: nn.Module,
        training: CloudSet | StreamWindow,
        validation: CloudSet,
        settings: Settings,
        out: str | Path,
        *,
        shape: Shape | None = None,
        device: torch.device | str = "cpu",
        monitor: Monitor | None = None,
        interrupted: Callable[[], bool] = lambda: False,
    ) -> None:
        """`shape` is that of one of `tdcr`'s networks, which makes the model's file readable for `tdcr`; a network of one's
        own has none. `interrupted` is asked every ten steps.

        Raises:
            tdcr.errors.InputError: where settings, clouds and ranks do not fit together.
        """
        self.rank, self.ranks = group()
        self.device = torch.device(device)
        self.out, self.shape, self.monitor, self.interrupted = Path(out), shape, monitor, interrupted
        # No step looks at more points than a cloud has, and no validation at a cloud twice.
        self.settings = complete(
            {
                **settings,
                "points": min(settings["points"], training.points_per_cloud),
                "validation_clouds": min(settings["validation_clouds"], len(validation)),
                "validation_points": min(settings["validation_points"], validation.points_per_cloud),
            }
        )
        if self.settings["clouds"] % self.ranks:
            raise InputError(f"clouds is {self.settings['clouds']}, expected a multiple of the {self.ranks} ranks")
        #: Whether clouds are drawn without replacement: those of a set, in the authors' procedure.
        self.epochs = self.settings["procedure"] == "authors" and isinstance(training, CloudSet)
        if isinstance(training, CloudSet) and self.epochs and self.settings["clouds"] > len(training):
            raise InputError(
                f"clouds is {self.settings['clouds']}, expected at most the {len(training)} clouds of the training set, which "
                "the authors' procedure draws without replacement"
            )
        if training.condition_dim != validation.condition_dim:
            raise InputError(
                f"conditions of dimension {validation.condition_dim} in validation, {training.condition_dim} in training"
            )
        self.provenance = training.provenance
        # Known of a stream is what its normalisation says.
        self.reach = reach_of(training.rows) if isinstance(training, CloudSet) else NORMALISED
        self.area = float(self.provenance["normalisation"]["scale"]) ** 2
        self.network = network.to(self.device)
        self.training, self.validation = training.to(self.device), validation.to(self.device)
        self.optimizers = Optimizers(self.network.parameters(), self.settings)
        identity = {
            "shape": shape and dict(shape),
            "settings": self.settings,
            "data": [training.fingerprint(), validation.fingerprint()],
            "initial": fingerprint(self.network),
        }
        self.identity = json.loads(json.dumps(identity))
        self.average = copy.deepcopy(self.network) if self.rank == 0 else None
        self.step, self.history = 0, History()
        self.best: Best | None = None
        #: Losses and norms of the last steps on the device, not yet in the history.
        self.recent: list[tuple[Tensor, Tensor]] = []

    def run(self) -> Model | None:
        """Takes the steps that are left; returns the network with the best validation distance, on rank 0, else None.

        Raises:
            Interrupted: as asked; the state is saved.
            Diverged: where the loss leaps or is not finite.
            tdcr.errors.TrainError: where the folder holds another run, or another process works in it.
        """
        with ExitStack() as stack:
            if self.rank == 0:
                stack.enter_context(locked(self.out))
            self.resume()
            parallel = self.network
            if self.ranks > 1:
                gpu = [self.device] if self.device.type == "cuda" else None
                parallel = DistributedDataParallel(self.network, device_ids=gpu)
            if self.monitor and self.rank == 0:
                self.monitor.begin(self.settings["steps"], self.step)
            due = False
            while not self.finished():
                self.take_step(parallel)
                validated = self.step % self.settings["validate_every"] == 0 or self.step == self.settings["steps"]
                if not validated and self.step % STEPS_PER_ROW:
                    continue
                stop = self.gather()
                if validated:
                    self.validate()
                due = due or validated or stop
                # What is in the middle of a leap of the loss is not saved.
                if due and (self.finished() or spike_length(self.settings, self.history.losses) == 0):
                    self.save()
                    due = False
                if stop and not self.finished():
                    raise Interrupted
            return self.model()

    def finished(self) -> bool:
        """Whether all steps are taken, or `patience` is exhausted."""
        patience = self.settings["patience"]
        if self.step >= self.settings["steps"]:
            return True
        if patience is None or not self.history.validations:
            return False
        distances = [distance for _, distance in self.history.validations]
        return len(distances) - 1 - distances.index(min(distances)) >= patience

    def take_step(self, parallel: nn.Module) -> None:
        """One step of the optimiser and of the average."""
        self.step += 1
        settings = self.settings
        clouds = self.training.at_step(self.step)
        # The batch of a data set is shared among the ranks; of a stream's window, each holds a share.
        x, t, c, target = draw(clouds, settings, self.step, self.rank, self.ranks, epochs=self.epochs)
        self.network.train()
        with self.autocast():
            velocities = parallel(x, t, c)
        error = loss(velocities.float(), target, settings["color_weight"])
        torch.autograd.backward(error)
        norm = nn.utils.clip_grad_norm_(self.network.parameters(), settings["clip_norm"])
        self.optimizers.step(self.step)
        self.recent.append((error.detach(), norm.detach()))
        if self.average is not None:
            follow(self.average, self.network, average_decay_at(settings, self.step))

    def autocast(self) -> torch.autocast:
        """Mixed precision where the settings ask for it: products in bfloat16, weights and sums in float32."""
        return torch.autocast(self.device.type, torch.bfloat16, enabled=self.settings["precision"] == "bfloat16")

    def gather(self) -> bool:
        """Brings the losses and norms of the last steps into the history, the same on all ranks; whether any rank is asked to
        stop.

        Raises:
            Diverged: where the loss leaps or is not finite.
        """
        numbers = torch.stack([torch.stack(pair).double() for pair in self.recent])
        # Norms are those of the mean gradient, the same on all ranks.
        numbers = torch.cat([numbers.flatten(), numbers.new_tensor([float(self.interrupted())])])
        if self.ranks > 1:
            dist.all_reduce(numbers)
        *values, stops = (numbers / self.ranks).tolist()
        self.recent.clear()
        losses, norms = values[::2], values[1::2]
        taken = len(self.history.losses)
        for k, (mean, norm) in enumerate(zip(losses, norms, strict=True), taken + 1):
            if not (math.isfinite(mean) and math.isfinite(norm)):
                raise Diverged(f"the loss of step {k} is {mean}, its gradient's norm {norm}: training diverged{self.advice()}")
            self.history.losses.append(mean)
            self.history.norms.append(norm)
            if spike_length(self.settings, self.history.losses) == SPIKE_STEPS:
                factor = self.settings["spike_factor"]
                raise Diverged(
                    f"the loss of step {k} is {mean:.3e}, for {SPIKE_STEPS} steps above {factor} times its level: training "
                    f"diverged{self.advice()}"
                )
        if self.monitor and self.rank == 0:
            self.monitor.advance(self.step, sum(losses) / len(losses))
        return bool(stops > 0)

    def advice(self) -> str:
        """What to do about a divergence."""
        kept = f"; {self.out / 'state.pt'} is the last good state" if self.history.validations else ""
        return f"{kept}. Choose a learning rate below {self.settings['learning_rate']}, in another folder (--out)"

    def validate(self) -> None:
        """Validates the averaged weights, on rank 0, and tells the others."""
        found = torch.zeros(1, dtype=torch.float64, device=self.device)
        if self.average is not None:
            found[0] = self.distance(self.average)
        if self.ranks > 1:
            dist.broadcast(found, 0)
        mean = found.item()
        if not math.isfinite(mean):
            raise Diverged(f"the validation distance at step {self.step} is {mean}: training diverged{self.advice()}")
        self.history.validations.append((self.step, mean))
        if self.average is not None and (self.best is None or mean < self.best.distance):
            self.best = Best(self.step, mean, to_cpu(self.average.state_dict()))
        if self.monitor and self.rank == 0:
            self.monitor.validated(self.step, self.history.losses[-1], mean * self.area)

    @torch.no_grad()
    def distance(self, network: nn.Module) -> float:
        """Mean Chamfer distance (normalised units squared) between clouds and their predictions. Noise and subsets of points
        depend on the seed alone, so that validations compare."""
        network.eval()
        settings, clouds = self.settings, self.validation
        count, points = settings["validation_clouds"], settings["validation_points"]
        sampler, path = Sampler.of(settings), FlowPath.of(settings)
        total = 0.0
        for cloud in (k * len(clouds) // count for k in range(count)):
            numbers = generator(self.device, settings["seed"], VALIDATION, cloud)
            noise = path.prior((1, points, clouds.rows.shape[-1]), numbers)
            subset = torch.randperm(clouds.points_per_cloud, generator=numbers, device=self.device)[:points]
            with self.autocast():
                predicted = integrate(network, noise, clouds.conditions[cloud : cloud + 1], sampler, reach=self.reach)
            total += chamfer(predicted[0, :, :3], clouds.rows[cloud, subset, :3])
        return total / count

    def save(self) -> None:
        """Writes model, log and state, on rank 0; the others wait for it."""
        if self.average is not None:
            model = self.model()
            if model is not None:
                model.save(self.out / "model.safetensors")
            self.history.write_log(self.out / "log.csv", partial(learning_rate_at, self.settings), self.area)
            state = RunState(
                identity=self.identity,
                step=self.step,
                network=to_cpu(self.network.state_dict()),
                average=to_cpu(self.average.state_dict()),
                optimizers=self.optimizers.state(),
                best=self.best,
                history=self.history,
            )
            state.save(self.out / "state.pt")
        if self.ranks > 1:
            dist.barrier()

    def resume(self) -> None:
        """Goes on from the state in the folder, if there is one: rank 0 reads it and hands it to the others."""
        found = [self.read_state() if self.rank == 0 else None]
        if self.ranks > 1:
            dist.broadcast_object_list(found)
        state = found[0]
        if state is None:
            return
        self.network.load_state_dict(state.network)
        self.optimizers.load(state.optimizers)
        self.step, self.history = state.step, state.history
        if self.average is not None:
            self.average.load_state_dict(state.average)
            self.best = state.best

    def read_state(self) -> RunState | None:
        """The state in the folder, of this run."""
        path, model = self.out / "state.pt", self.out / "model.safetensors"
        if path.exists():
            return RunState.load(path, self.identity)
        if model.exists():
            raise TrainError(
                f"{model} is a model without the state.pt of its run, and would be overwritten: choose another folder, "
                "or move it away"
            )
        return None

    def model(self) -> Model | None:
        """The best averaged weights so far; None before the first validation, and on other ranks than 0."""
        if self.best is None:
            return None
        network = copy.deepcopy(self.network).cpu()
        network.load_state_dict(self.best.weights)
        return Model(
            network=network.eval(),
            shape=self.shape,
            colors=self.validation.rows.shape[-1] > 3,
            provenance=self.provenance,
            settings=self.settings,
            step=self.best.step,
            validation_distance=self.best.distance,
            reach=self.reach,
        )


@torch.no_grad()
def follow(average: nn.Module, network: nn.Module, decay: float) -> None:
    """Moves the average towards the network's weights; buffers are copied."""
    kept: list[Tensor] = list(average.parameters())
    new: list[Tensor] = list(network.parameters())
    torch._foreach_lerp_(kept, new, 1 - decay)
    for old, current in zip(average.buffers(), network.buffers(), strict=True):
        old.copy_(current)


def to_cpu(state: dict[str, Tensor]) -> dict[str, Tensor]:
    """A copy of a state dict, on the CPU."""
    return {name: value.detach().cpu().clone() for name, value in state.items()}


def fingerprint(network: nn.Module) -> str:
    """A hash of all weights."""
    parts = [value.detach().float().cpu().flatten() for value in network.state_dict().values()]
    rows = torch.cat(parts)[None, :, None] if parts else torch.zeros(1, 1, 1)
    return CloudSet(torch.zeros(1, 0), rows, {}).fingerprint()
