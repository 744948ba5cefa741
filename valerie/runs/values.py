"""The field types of a spec."""

from __future__ import annotations

from typing import Annotated

from pydantic import BeforeValidator, Field, StrictBool, StrictFloat, StrictInt, StrictStr, StringConstraints

from valerie.parameters.quantities import to_unit

#: A number, or a text of a number and a unit.
Quantity = StrictInt | StrictFloat | StrictStr
#: A number; a text may state it in per cent.
Share = Annotated[float, BeforeValidator(lambda value: to_unit(value, "").number if isinstance(value, str) else value)]
#: A value of any parameter; numbers may be quantities.
Scalar = StrictBool | StrictInt | StrictFloat | StrictStr
Name = Annotated[str, StringConstraints(strict=True, min_length=1, max_length=200)]
Text = Annotated[str, StringConstraints(strict=True, max_length=10_000)]
Count = Annotated[int, Field(strict=True, ge=1, le=10**12)]
