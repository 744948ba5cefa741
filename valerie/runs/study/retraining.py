"""The settings of a training against what a validation found, and of the rounds of validation and training."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from valerie.document import Document


class RetrainSettings(Document):
    """Size of the training set and length of the training.

    Attributes:
        frames: to render, at least; rounded up to whole sites.
        sites: to spread them over.
        broad_share: share of the frames that are drawn anywhere, so that the function forgets nothing.
        width, height: of the frames, pixels.
        held_out_frames: for the figures on the function's card; 0 leaves them out.
        steps, learning_rate, batch, seed: of the training; everything else stays as in the training before.
        first_seed: first site seed; None: after those that the function has seen.
        targeted: False draws all frames anywhere: the control that a targeted set is measured against.
    """

    frames: Annotated[int, Field(ge=1, le=100_000)] = 120
    sites: Annotated[int, Field(ge=1, le=1000)] = 8
    broad_share: Annotated[float, Field(ge=0.0, lt=1.0)] = 0.5
    width: Annotated[int, Field(ge=32, le=8192)] = 960
    height: Annotated[int, Field(ge=32, le=8192)] = 540
    held_out_frames: Annotated[int, Field(ge=0, le=10_000)] = 20
    steps: Annotated[int, Field(ge=1)] = 300
    learning_rate: Annotated[float, Field(gt=0)] = 3e-4
    batch: Annotated[int, Field(ge=2)] = 8
    seed: Annotated[int, Field(ge=0)] = 0
    first_seed: int | None = None
    targeted: bool = True


class Rounds(Document):
    """The rounds of a validation flow: verify, find failures, train on them, verify the new version.

    Attributes:
        most: largest number of trainings.
        search: variants that look for failures before each training.
        training: settings of each; the seed grows by 1 from round to round.
    """

    most: Annotated[int, Field(strict=True, ge=1, le=100)] = 2
    search: Annotated[int, Field(strict=True, ge=8, le=100_000)] = 64
    training: RetrainSettings = RetrainSettings()
