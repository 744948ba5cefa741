"""Base of all read models, and their fields derived from columns of the long table."""

from __future__ import annotations

from dataclasses import fields, is_dataclass
from typing import Annotated, Any, Final

from pydantic import BaseModel, ConfigDict, Field, create_model, model_validator

from valerie.measures import Measure, Source, measure_of, measures_from

#: Names that the examples of several models and parameters share.
RUN_ID: Final = str(measure_of("run_id").example)
FRAME_ID: Final = str(measure_of("frame_id").example)
FUNCTION: Final = str(measure_of("function").example)
DIGEST: Final = "5f0c3a9be1d24c7788a6e0f1b2c3d4e5"
NUMERIC_CLASS: Final = "raster-llvmpipe-mesa-22.3.6"
CAMERAS: Final = ["camera-1", "camera-2", "camera-3"]
ASSIGNMENT: Final = {"scene.person-1.pos.x": 3.5, "scene.person-1.pos.y": 5.0}
UNITS: Final = {"scene.person-1.pos.x": "m", "scene.person-1.pos.y": "m"}

Digest = Annotated[str, Field(examples=[DIGEST])]
NextCursor = Annotated[str | None, Field(description="cursor of the next page; null on the last", examples=["WzVd"])]


class Read(BaseModel):
    """Base of all read models; fields are filled from rows by attribute."""

    model_config = ConfigDict(from_attributes=True)


class _Measured(Read):
    @model_validator(mode="before")
    @classmethod
    def _beside_fields(cls, row: object) -> object:
        """Merge a dataclass's ``measures`` with its fields."""
        if not is_dataclass(row) or not hasattr(row, "measures"):
            return row
        return {**{field.name: getattr(row, field.name) for field in fields(row)}, **row.measures}


def measured(*sources: Source) -> Any:
    """Return a base class with one field for each measure from ``sources``."""
    measures: Any = {measure.name: _field(measure) for measure in measures_from(*sources)}
    return create_model("Measured", __base__=_Measured, **measures)


def _field(measure: Measure) -> tuple[Any, Any]:
    kind: Any = measure.type.python
    if measure.required:
        return kind, Field(description=measure.description, examples=[measure.example])
    return kind | None, Field(default=None, description=measure.description, examples=[measure.example])
