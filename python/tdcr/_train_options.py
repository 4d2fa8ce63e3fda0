"""Options of training, written from `learn/src/options/mod.rs` by
`UPDATE_OPTIONS=1 cargo test --release --test cli python_options`.
"""

from collections.abc import Sequence
from typing import Any, Literal, TypedDict

from tdcr.data import PathLike
from tdcr.robot import Robot


class TrainOptions(TypedDict, total=False):
    """Options of :func:`tdcr.train`: those of ``tdcr train``; None is the default."""

    net: Literal["mlp", "hybrid"] | None
    """Network: each point on its own, or with features of the cloud around it [default: mlp]"""

    preset: Literal["quick", "laptop", "paper"] | None
    """Set of defaults, for the options that list one per preset [default: quick]"""

    width: int | None
    """Features per layer [default: quick 96, laptop 128, paper 512]"""

    depth: int | None
    """Layers [default: quick 6, laptop 6, paper 6]"""

    embedding: int | None
    """Features of the embedding of time and command [default: quick 128, laptop 128, paper 256]"""

    condition_blocks: int | None
    """Residual blocks that a command passes through, once per cloud, on its way to the embedding [default: quick 0, laptop 0,
    paper 0]"""

    octaves: int | None
    """Octaves of the Fourier features of the points' positions [default: quick 6, laptop 6, paper 0]"""

    time_features: Literal["plain", "late"] | None
    """Features of the flow time that the network sees: half of them of the logarithm of the noise that is left, so that its
    last hundredths differ (late), or the paper's (plain) [default: quick late, laptop late, paper plain]"""

    colors: bool | None
    """Learn the colours of the points beside their positions [default: quick no, laptop no, paper yes]"""

    color_weight: float | None
    """Weight of the colours' error beside the positions' [default: 0.05]"""

    steps: int | None
    """Optimiser steps [default: quick 5500, laptop 25000, paper 500 epochs]"""

    clouds: int | None
    """Clouds per step [default: quick 128; laptop 128; paper 8, hybrid 32]"""

    points: int | None
    """Points per cloud and step, or all that a cloud has [default: quick 128, laptop 128, paper 20000]"""

    precision: Literal["float32", "bfloat16"] | None
    """Operand type of the network's matrix products: bfloat16 has 8 significant bits. It is many times faster on a processor
    with a matrix unit (AMX), and faster on AMD's with AVX-512 BF16. Sums are float32 in either [default: bfloat16 on such a
    processor if the width is a multiple of 32, else float32]"""

    optimizer: Literal["adamw", "muon"] | None
    """Optimiser [default: quick muon, laptop muon, paper adamw]"""

    learning_rate: float | None
    """Learning rate after warm-up; Muon's own follows in proportion [default: quick 0.02; laptop 0.02; paper 0.0003, hybrid
    0.0008]"""

    warmup: int | None
    """Steps of warm-up, at most a tenth of all [default: quick 500; laptop 500; paper 1000, hybrid 4000]"""

    validate_every: int | None
    """Steps between validations [default: quick 550, laptop 2500, paper 5000]"""

    patience: int | None
    """End the run after so many validations without a better one [default: take all steps]"""

    coupling: str | None
    """How noise is coupled to the points of a cloud: independent, or optimal-transport[:K], matched within K points [default:
    independent]"""

    time_exponent: float | None
    """Flow times are Beta(ALPHA, 1): 1 is uniform, above it they are mostly near the data [default: 3.0]"""

    late_times: float | None
    """Share of the flow times that are drawn near the data instead, with 1 - t log-uniform from 0.003 to 0.15 [default: quick
    0.5, laptop 0.5, paper 0]"""

    prior_cut: float | None
    """Where the noise that the flow starts from is cut off, in its standard deviations; 0: nowhere [default: quick 2.5, laptop
    2.5, paper 0]"""

    refinement_steps: int | None
    """Steps of the refinement, at most a third of ``steps``: a copy of the network learns on the ends of its own flow, and
    takes its place in the last evaluation of a prediction; 0: none [default: quick 1500, laptop 4000, paper 0]"""

    surface_prior: Robot | PathLike | dict[str, Any] | None
    """Start the flow from the simulated surface of this robot (as ``tdcr collect --robot``) under the same command, not from
    noise: for a model of the robot that the data show, which needs few samples then"""

    symmetry: Literal["auto", "none"] | None
    """Learn one representative of all commands that the robot's symmetries make alike, such as permuted tendons, where robot,
    base and cameras have them (auto), or every command (none) [default: quick auto, laptop auto, paper none]"""

    prior_deviation: float | None
    """Standard deviation of the noise that the flow starts from, in units of the data's scale [default: 0.5; 0.005 about a
    simulated surface]"""

    init: PathLike | None
    """Start from the weights of this model, which has the same shape, robot and normalisation: to continue a run with other
    settings [default: random weights]"""

    normalisation_from: PathLike | None
    """Normalise commands and points as this model does, not by the data set's own ranges. Needed with ``init`` to continue
    from simulated to recorded clouds, or on a set that has grown. Commands must be in the model's units"""

    seed: int | None
    """Seed of weights, noise and subsets [default: 0]"""

    layers: Literal["residual", "pvcnn"] | None
    """Layers of the context network [default: quick residual, laptop residual, paper pvcnn]"""

    channels: Sequence[int] | None
    """Features of the three stages [default: 80,112,112]"""

    resolutions: Sequence[int] | None
    """Voxels per edge in the three stages [default: 24,16,8]"""

    blocks: int | None
    """Point-voxel blocks per stage [default: 2]"""

    context: int | None
    """Features of a point's context [default: 64]"""
