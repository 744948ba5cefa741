"""The base class and the field types of all parts of a spec."""

from __future__ import annotations

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field, StrictBool, StrictFloat, StrictInt, StrictStr, StringConstraints

#: A number, or a text of a number and a unit.
Quantity = StrictInt | StrictFloat | StrictStr
#: A value of any parameter; numbers may be quantities.
Scalar = StrictBool | StrictInt | StrictFloat | StrictStr
Name = Annotated[str, StringConstraints(strict=True, min_length=1, max_length=200)]
Text = Annotated[str, StringConstraints(strict=True, max_length=10_000)]
Count = Annotated[int, Field(strict=True, ge=1, le=10**12)]


class Document(BaseModel):
    """Base class of all parts of a spec."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)
