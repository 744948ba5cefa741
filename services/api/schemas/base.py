"""Base of all read models, and their fields from the columns of the long table."""

from __future__ import annotations

from datetime import datetime
from typing import Annotated, Any, Final

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, create_model

from valerie.measures import Measure, Source, measure_of, measures_from
from valerie.runs.moments import in_utc

Moment = Annotated[datetime, AfterValidator(in_utc)]

#: Names that the examples of several models and parameters share.
RUN_ID: Final = str(measure_of("run_id").example)
FRAME_ID: Final = str(measure_of("frame_id").example)
FUNCTION: Final = str(measure_of("function").example)
DIGEST: Final = "5f0c3a9be1d24c7788a6e0f1b2c3d4e5"
NUMERIC_CLASS: Final = "raster-llvmpipe-mesa-22.3.6"
CAMERAS: Final = ["camera-1", "camera-2", "camera-3"]
ASSIGNMENT: Final = {"scene.person-1.pos.x": 3.5, "scene.person-1.pos.y": 5.0}

Digest = Annotated[str, Field(examples=[DIGEST])]
NextCursor = Annotated[str | None, Field(description="cursor of the next page; null on the last", examples=["WzVd"])]


class Read(BaseModel):
    """Base of all read models; fields are filled from rows by attribute."""

    model_config = ConfigDict(from_attributes=True)


def measured(*sources: Source) -> Any:
    """Return a base class with one field for each measure from ``sources``."""
    fields: dict[str, Any] = {measure.name: _field(measure) for measure in measures_from(*sources)}
    return create_model("Measured", __base__=Read, **fields)


def _field(measure: Measure) -> tuple[Any, Any]:
    kind: Any = measure.type.python
    optional: dict[str, Any] = {} if measure.required else {"default": None}
    field = Field(description=measure.description, examples=[measure.example], **optional)
    return (kind if measure.required else kind | None, field)
