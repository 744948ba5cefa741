"""The plain index of a data set: one Parquet row per person of a frame, with where its files are and what is known."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, Final

import pyarrow as pa
import pyarrow.parquet as pq

from valerie.errors import InvalidInput

#: The columns that every index has, with what they hold; parameters follow, one column per path.
COLUMNS: Final[tuple[tuple[str, pa.DataType, str], ...]] = (
    ("name", pa.string(), "of the frame: city_sequence_frame"),
    ("split", pa.string(), "train, val …"),
    ("picture", pa.string(), "path of the picture below the data set"),
    ("label_ids", pa.string(), "path of the label ids; empty where that format was not asked for"),
    ("width", pa.int32(), "of the picture, pixels"),
    ("height", pa.int32(), "of the picture, pixels"),
    ("run_id", pa.string(), "the run that the frame is from"),
    ("frame_id", pa.string(), "(run, variant, camera, time)"),
    ("variant_index", pa.int64(), "of the run's parameter space"),
    ("camera", pa.string(), "its name"),
    ("time_index", pa.int32(), "in the frame's sequence"),
    ("time_s", pa.float64(), "when the frame is taken, seconds"),
    ("sensor", pa.string(), "the sensor setting"),
    ("instance_id", pa.int32(), "of the person; empty where the frame shows none"),
    ("character", pa.string(), "who is seen"),
    ("pixel_area", pa.int64(), "visible pixels"),
    ("pixel_area_percent", pa.float64(), "per cent of all pixels"),
    ("pixel_area_amodal", pa.int64(), "pixels of the person alone, within the image"),
    ("occlusion_rate", pa.float64(), "0…1"),
    ("truncation_rate", pa.float64(), "0…1"),
    ("distance_m", pa.float64(), "from the optical centre"),
    ("depth_m", pa.float64(), "along the optical axis"),
    ("sun_azimuth_deg", pa.float64(), "clockwise from north"),
    ("sun_elevation_deg", pa.float64(), "above the horizon"),
    ("road_friction", pa.float64(), "peak friction of new tyres on the road at 50 km/h"),
    ("bearing_deg", pa.float64(), "from the optical axis, positive to the right"),
    ("aspect_deg", pa.float64(), "heading against the line of sight; 0 faces the camera"),
    ("irradiance", pa.float64(), "light that arrives on the body, 1 = clear noon sun; where the run asked for it"),
    ("shadow_share", pa.float64(), "of the visible body, 0…1; where the run asked for it"),
    ("contrast", pa.float64(), "to the surrounding ring, −1…1; where the run asked for it"),
    ("box", pa.list_(pa.int32()), "x0, y0, x1, y1 of the visible pixels, end exclusive"),
    ("amodal_box", pa.list_(pa.int32()), "likewise, of the whole person within the image"),
    ("undefined_reason", pa.string(), "why nothing of the person is seen"),
)


def write_index(path: Path, rows: Iterable[Mapping[str, Any]], parameters: Mapping[str, pa.DataType]) -> int:
    """Write the index; returns its number of rows.

    Args:
        path: of the file.
        rows: column to value; what a row lacks is empty.
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
