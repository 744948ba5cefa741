"""Names and products of frames."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Final

from valerie.errors import InvalidInput

#: Regular expressions of the ids of a run or a study, and that of a frame.
ID: Final = r"^[0-9A-Za-z][0-9A-Za-z_-]{0,31}$"
FRAME_ID: Final = ID.removesuffix("$") + r"\.[0-9]{1,18}\.[0-9]{1,4}\.[0-9]{1,6}$"


@dataclass(frozen=True, slots=True, order=True)
class FrameKey:
    """The name of a frame. As text, ``run.variant.camera.time``, it is the frame id in URLs, tables and commands.

    Attributes:
        run_id: the run.
        variant: index in the run's parameter space.
        camera: index in the run's cameras.
        time: index in the run's sequence.
    """

    run_id: str
    variant: int
    camera: int
    time: int = 0

    @classmethod
    def parse(cls, text: str, *, field: str = "frame") -> FrameKey:
        """Read a frame id.

        Raises:
            InvalidInput: not a frame id.
        """
        if re.fullmatch(FRAME_ID, text) is None:
            raise InvalidInput("not a frame id", field=field, value=text, limit="run.variant.camera.time")
        run_id, variant, camera, time = text.split(".")
        return cls(run_id, int(variant), int(camera), int(time))

    def __str__(self) -> str:
        return f"{self.run_id}.{self.variant}.{self.camera}.{self.time}"


@dataclass(frozen=True, slots=True)
class FrameProducts:
    """The digests of the products of a frame that do not depend on sensors or functions.

    Attributes:
        background: the image without movables.
        layer: the rectangle of it that the movables change.
        truth: the ground truth.
        velocity: velocities of the pixels; None if the run does not need them.
        scan: the frame as a rolling shutter reads it; None if no sensor has one.
    """

    background: str
    layer: str
    truth: str
    velocity: str | None = None
    scan: str | None = None

    @property
    def required(self) -> tuple[str, str, str]:
        """Background, layer and truth, which every frame has."""
        return self.background, self.layer, self.truth
