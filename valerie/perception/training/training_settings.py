"""Settings of a training run."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from valerie.document import Document
from valerie.perception.running.engines.labelling import ALIGNMENT

_Fraction = Annotated[float, Field(ge=0.0, le=1.0)]
_Positive = Annotated[float, Field(gt=0.0)]
_Side = Annotated[int, Field(ge=ALIGNMENT, multiple_of=ALIGNMENT)]


class CropSettings(Document):
    """Crops and augmentations that turn frames into samples.

    Attributes:
        height, width: size of the samples in pixels; multiples of 32.
        scales: each sample draws one: 1 cuts at the resolution at which the function sees the frame, 0.5 at half of it. Both
            together double the range of sizes of people.
        scale_jitter: the scale is also multiplied by a random factor between 1 / this and this.
        person_share: share of samples whose window is placed around a person pixel, if the frame has one.
        flip_share: share of samples that are mirrored.
        exposure_stops: largest change of exposure in either direction, applied to decoded (power 2.2) values.
        contrast, saturation, white_balance: largest relative change of each.
        noise: largest standard deviation of the noise, in picture values (0…255).
        blur_share: share of samples that are slightly blurred.
    """

    height: _Side = 256
    width: _Side = 512
    scales: Annotated[tuple[_Positive, ...], Field(min_length=1)] = (1.0, 0.5)
    scale_jitter: Annotated[float, Field(ge=1.0, le=4.0)] = 1.25
    person_share: _Fraction = 0.5
    flip_share: _Fraction = 0.5
    exposure_stops: Annotated[float, Field(ge=0.0, le=4.0)] = 0.5
    contrast: _Fraction = 0.15
    saturation: _Fraction = 0.3
    white_balance: _Fraction = 0.08
    noise: Annotated[float, Field(ge=0.0, le=64.0)] = 4.0
    blur_share: _Fraction = 0.2


class TrainingSettings(Document):
    """Settings of one training run; on the CPU, equal settings, frames and threads give equal weights, bit for bit.

    Attributes:
        architecture: a name in `valerie.perception.networks.architectures`.
        seed: seed of the first weights, the order of frames and every crop.
        steps: optimiser steps of the whole schedule.
        time_budget_s: None, or seconds after which the schedule ends even if steps remain. The learning rate then follows the
            clock if it is ahead of the steps, and the result is not reproducible.
        batch: samples per step.
        longest_side: None, or pixels to which the function reduces longer frames, in validation as in use; samples are cut
            accordingly.
        class_balance: exponent b: the weight of a class in the cross-entropy is its share of all pixels to the power of −b. 0
            weighs all pixels equally, 1 gives every class the same total weight.
        person_weight: factor on the weight of person pixels.
        void_weight: weight of void pixels, whose class is unknown but which are no persons: each costs −log(1 − p(person)) times
            this. 0 leaves them out, as the metrics do; the network can then label waste bins as persons at no cost.
        learning_rate: highest rate of the schedule; it rises over ``warmup_steps`` and falls as ``(1 − progress) ** 0.9``.
        weight_decay: AdamW's decoupled weight decay.
        keep_norm_statistics: batch normalisation keeps its means and variances in training. For training that starts from a
            trained network: statistics of a few small batches would be worse.
        precision: precision of the forward and backward pass: ``bf16`` autocast, ``fp32``, or ``auto``: bf16 on devices that
            multiply it, otherwise fp32, since emulated bf16 is ten times slower. Weights are always fp32.
        device: ``cpu``, ``cuda``, or ``auto``: cuda if there is one.
        loader_threads: threads that cut samples; no effect on the result.
        checkpoint_every: steps between checkpoints.
        validate_every: steps between validations on (at most 64) held-out frames.
        crops: crops of the samples.
    """

    architecture: str
    seed: Annotated[int, Field(ge=0)] = 0
    steps: Annotated[int, Field(ge=1)] = 6000
    time_budget_s: _Positive | None = None
    batch: Annotated[int, Field(ge=2)] = 16
    longest_side: Annotated[int, Field(ge=ALIGNMENT)] | None = None
    class_balance: _Fraction = 0.0
    person_weight: _Positive = 3.0
    void_weight: Annotated[float, Field(ge=0.0)] = 0.0
    learning_rate: _Positive = 2e-3
    weight_decay: Annotated[float, Field(ge=0.0)] = 1e-2
    warmup_steps: Annotated[int, Field(ge=0)] = 100
    keep_norm_statistics: bool = False
    precision: Literal["auto", "bf16", "fp32"] = "auto"
    device: Literal["auto", "cpu", "cuda"] = "auto"
    loader_threads: Annotated[int, Field(ge=1, le=64)] = 4
    checkpoint_every: Annotated[int, Field(ge=1)] = 500
    validate_every: Annotated[int, Field(ge=1)] = 1000
    crops: CropSettings = CropSettings()
