"""Rows whose picture shows nothing."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from valerie.analysis.rows.table import EvaluationTable

#: Mean grey level below which a picture is black, and above which it is white, of 255.
BLACK: Final = 2.0
WHITE: Final = 253.0
#: Standard deviation of the grey levels below which a picture is constant.
CONSTANT: Final = 1.0


def picture_faults(table: EvaluationTable) -> dict[str, NDArray[np.bool_]]:
    """Return each fault of pictures with (N,) bool: the rows with such a picture. No row has two."""
    mean = table.numbers("picture_mean")
    black, white = mean < BLACK, mean > WHITE
    constant = (table.numbers("picture_deviation") < CONSTANT) & ~black & ~white
    return {"black": black, "white": white, "constant": constant}
