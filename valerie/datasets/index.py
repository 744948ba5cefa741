"""The index of a data set: one Parquet row per person of a frame, with its measures and the paths of its files."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Final

import pyarrow as pa
import pyarrow.parquet as pq

from valerie.errors import InvalidInput
from valerie.measures import WITHOUT_FUNCTION, Cell, measures_from

#: A row of an index: `COLUMNS`, and a column for each parameter of the run.
IndexRow = dict[str, Cell | list[int]]
_BOX: Final = pa.list_(pa.int32())
#: The columns that only an index has.
_OF_FILES: Final = (
    ("name", pa.string(), "name of the frame: city_sequence_frame"),
    ("split", pa.string(), "train, val …"),
    ("picture", pa.string(), "path of the picture below the data set"),
    ("label_ids", pa.string(), "path of the label ids; empty without the format cityscapes"),
    ("width", pa.int32(), "width of the picture, pixels"),
    ("height", pa.int32(), "height of the picture, pixels"),
    ("time_index", pa.int32(), "place of the frame in its sequence"),
    ("box", _BOX, "x0, y0, x1, y1 of the visible pixels, end exclusive"),
    ("amodal_box", _BOX, "box of the person rendered alone, within the image"),
)
#: The columns of every index and their meaning. The parameters follow, one column per path.
COLUMNS: Final[tuple[tuple[str, pa.DataType, str], ...]] = (
    *_OF_FILES,
    *(
        (
            measure.name,
            pa.type_for_alias("string" if not measure.is_number else measure.type.value),
            measure.description,
        )
        for measure in measures_from(*WITHOUT_FUNCTION)
    ),
)


def write_index(path: Path, rows: Iterable[IndexRow], parameters: Mapping[str, pa.DataType]) -> int:
    """Write the index, and return its number of rows.

    Args:
        rows: column to value; missing values are empty.
        parameters: path to Arrow type of the parameters' columns.

    Raises:
        InvalidInput: a value does not fit its column.
    """
    fields = [pa.field(name, dtype, metadata={"description": text}) for name, dtype, text in COLUMNS]
    schema = pa.schema([*fields, *(pa.field(name, dtype) for name, dtype in parameters.items())])
    try:
        table = pa.Table.from_pylist([dict(row) for row in rows], schema=schema)
    except (pa.ArrowInvalid, pa.ArrowTypeError) as error:
        raise InvalidInput(f"a value does not fit its column ({error})", field="index") from error
    pq.write_table(table, path, compression="zstd")
    return int(table.num_rows)
