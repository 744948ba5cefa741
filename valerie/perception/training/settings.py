"""What a training run can be told."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

from valerie.perception.running.engines.labelling import ALIGNMENT

_Fraction = Annotated[float, Field(ge=0.0, le=1.0)]
_Positive = Annotated[float, Field(gt=0.0)]
_Side = Annotated[int, Field(ge=ALIGNMENT, multiple_of=ALIGNMENT)]


class CropSettings(BaseModel):
    """How samples are cut from frames and disturbed.

    Attributes:
        height, width: of the samples, pixels; multiples of 32.
        scales: each sample picks one: 1 cuts at the resolution at which the function sees the frame, 0.5 from half of it, so that
            the network knows people of twice the range of sizes.
        scale_jitter: the scale is further multiplied by a factor between 1 / this and this.
        person_share: share of samples that are placed so that they hold a person pixel, where the frame has one.
        flip_share: share of samples that are mirrored.
        exposure_stops: largest change of exposure in either direction, applied to decoded (power 2.2) values.
        contrast, saturation, white_balance: largest relative change of each.
        noise: largest standard deviation of the noise, in picture values (0…255).
        blur_share: share of samples that are slightly blurred.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

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


class TrainingSettings(BaseModel):
    """One training run; on the CPU, equal settings, frames and threads give equal weights, bit for bit.

    Attributes:
        architecture: name of an architecture.
        seed: of the first weights, the order of frames and every crop.
        steps: optimiser steps of the whole schedule.
        time_budget_s: None; or seconds of training after which the schedule ends even if steps are left: the learning
            rate then follows the clock where that is ahead, and the result is not reproducible.
        batch: samples per step.
        longest_side: None; or pixels to which the function reduces longer frames, in validation as in use; samples are cut
            accordingly.
        class_balance: exponent b of the classes' weights in the cross-entropy, which go with their share of all pixels to the
            power of −b: 0 weighs all alike, 1 gives every class the same weight in all.
        person_weight: by which the weight of person pixels is further multiplied.
        void_weight: of void pixels, whose class is unknown but which are no persons: each costs −log(1 − p(person)) times this. 0
            leaves them out, as the metrics do; a network that never hears of waste bins is free to call them persons.
        learning_rate: highest; rises over ``warmup_steps`` and falls as ``(1 − progress) ** 0.9``.
        weight_decay: AdamW's, decoupled.
        keep_norm_statistics: batch normalisation works with the means and variances that it has, in training as in use, and they
            stay. For going on from a trained network: those of a few small batches would be worse.
        precision: of the forward and backward pass: ``bf16`` autocast or ``fp32``. Weights are always fp32.
        device: ``cpu``, ``cuda``, or ``auto``: cuda where there is one.
        loader_threads: threads that cut samples; the result does not depend on it.
        checkpoint_every: steps between checkpoints.
        validate_every: steps between validations on (at most 64) held-out frames.
        crops: how samples are made.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

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
    precision: Literal["bf16", "fp32"] = "bf16"
    device: Literal["auto", "cpu", "cuda"] = "auto"
    loader_threads: Annotated[int, Field(ge=1, le=64)] = 4
    checkpoint_every: Annotated[int, Field(ge=1)] = 500
    validate_every: Annotated[int, Field(ge=1)] = 1000
    crops: CropSettings = CropSettings()
