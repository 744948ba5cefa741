"""The columns of the long table, which has one row per person, frame, sensor setting and function.

All other code with such columns takes them from here: Arrow and SQL tables, REST models and their examples, plot axes,
selections, the index of an exported data set, and the labels of reports and of the dashboard. A new measure of a person needs
an entry here, the code that computes it, and a higher revision of the products that hold it. `valerie.db.migrate` adds its
column to existing databases.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Final

from valerie.errors import UnknownName

#: A value in a row; None if it is empty.
Cell = str | bool | int | float | None
#: Values of measures by name. A mapping, since measures are data: a new one is an entry of `MEASURES`, not a field.
Measures = Mapping[str, Cell]
#: A row of the long table: its measures, and a column for each parameter that its run varies.
TableRow = dict[str, Cell]
#: Values of any row by column.
Row = Mapping[str, Cell]


#: Columns of the numeric classes that made a row, in runs that accept several.
CLASS_COLUMNS: Final = ("render_class", "truth_class", "infer_class")


class ColumnType(StrEnum):
    """Type of a column's values; all but `NAME` are names of Arrow types."""

    NAME = "name"  # text with few different values
    TEXT = "string"
    INT32 = "int32"
    INT64 = "int64"
    FLOAT = "float64"

    @property
    def python(self) -> type[str] | type[int] | type[float]:
        """The Python type of one value."""
        if self in (ColumnType.NAME, ColumnType.TEXT):
            return str
        return float if self is ColumnType.FLOAT else int


class Source(StrEnum):
    """Origin of a column's values."""

    FRAME = "frame"
    """Subject of the row: run, frame, sensor, person."""
    PIXELS = "pixels"
    """The ground truth of one picture; measured again if the sensor distorts."""
    PLACE = "place"
    """Position of the person relative to the camera."""
    LIGHT = "light"
    """The annotation ``light``; empty in runs that do not request it."""
    CONDITIONS = "conditions"
    """The frame's time, light and weather."""
    FUNCTION = "function"
    """The function under test."""
    PICTURE = "picture"
    """The picture given to the function; empty for uploaded predictions."""
    PERSON_SCORE = "person score"
    """Score of the function on the person."""
    FRAME_SCORE = "frame score"
    """Score of the function on the whole frame."""


#: Sources that describe a person, independent of any function.
OF_PERSON: Final = (Source.PLACE, Source.PIXELS, Source.LIGHT)
#: Sources of the values that depend on a function.
OF_FUNCTION: Final = (Source.FUNCTION, Source.PICTURE, Source.PERSON_SCORE, Source.FRAME_SCORE)
#: Sources of the values that do not depend on a function.
WITHOUT_FUNCTION: Final = tuple(source for source in Source if source not in OF_FUNCTION)


@dataclass(frozen=True, slots=True)
class Measure:
    """One column of the long table.

    Attributes:
        name: the column's name in every table.
        title: title for users, in lower case.
        description: definition for users.
        example: a value for documentation.
        unit: unit of the shown number, which is multiplied by ``scale``.
        scale: factor from the column's unit to the shown one. Rates are shown in per cent.
        digits: decimals of a shown number.
        required: True if every row of the long table has a value. A new measure is not required, since rows from before lack it.
        low, high: bounds of the values, in the column's unit; None if unbounded.
        bin_width: width of the bins of pACC over this column, in the column's unit; None if the report does not plot it. Only for
            measures that do not depend on a function.
        is_tested: True if findings test it as an explanation of pACC. Redundant measures are not tested: they would hide each
            other.
        is_queried: True if error models are fitted over it by default.
    """

    name: str
    type: ColumnType
    source: Source
    title: str
    description: str
    example: str | int | float | None
    unit: str = ""
    scale: float = 1.0
    digits: int = 0
    required: bool = False
    low: float | None = None
    high: float | None = None
    bin_width: float | None = None
    is_tested: bool = False
    is_queried: bool = False

    @property
    def is_number(self) -> bool:
        """Return True if the values are numbers."""
        return self.type.python is not str

    def text(self, value: float) -> str:
        """Return a value as text for users: ``17.09 m``, ``5.2 %``."""
        return self._with_unit(f"{value * self.scale:,.{self.digits}f}")

    def range_text(self, low: float, high: float) -> str:
        """Return a range as text for users: ``25–30 m``."""
        return self._with_unit(f"{low * self.scale:g}–{high * self.scale:g}")

    def _with_unit(self, number: str) -> str:
        return number + (self.unit if self.unit == "°" else f" {self.unit}" if self.unit else "")


def _rate(
    name: str,
    source: Source,
    title: str,
    description: str,
    example: float,
    *,
    bin_width: float | None = None,
    is_tested: bool = False,
    is_queried: bool = False,
) -> Measure:
    """Return the measure of a share, 0…1 in tables and in per cent for users."""
    return Measure(
        name, ColumnType.FLOAT, source, title, description, example,
        unit="%", scale=100.0, digits=1, low=0.0, high=1.0, bin_width=bin_width, is_tested=is_tested, is_queried=is_queried,
    )  # fmt: skip


def _angle(name: str, source: Source, title: str, description: str, example: float) -> Measure:
    return Measure(name, ColumnType.FLOAT, source, title, description, example, unit="°", digits=1)


def _grey(name: str, title: str, description: str, example: float) -> Measure:
    return Measure(name, ColumnType.FLOAT, Source.PICTURE, title, description, example, digits=1, low=0.0, high=255.0)


def _count(
    name: str, source: Source, title: str, description: str, example: int, *, unit: str = "", required: bool = False
) -> Measure:
    return Measure(name, ColumnType.INT64, source, title, description, example, unit=unit, required=required, low=0)


def _label(
    name: str, source: Source, title: str, description: str, example: str | None, *, required: bool = False
) -> Measure:
    return Measure(name, ColumnType.NAME, source, title, description, example, required=required)


#: All measures in the order of the long table.
MEASURES: Final = (
    _label("run_id", Source.FRAME, "run", "id of the run", "r1ng219w3v1ks", required=True),
    Measure(
        "variant_index", ColumnType.INT64, Source.FRAME, "variant", "index of the variant in the run's parameter space",
        5, required=True,
    ),
    Measure(
        "frame_id", ColumnType.TEXT, Source.FRAME, "frame", "id of the frame: run, variant, camera, time",
        "r1ng219w3v1ks.5.0.0", required=True,
    ),
    _label("camera", Source.FRAME, "camera", "name of the camera", "camera-1", required=True),
    _label("character", Source.FRAME, "pedestrian", "character of the person", "yellow-shirt"),
    _label("sensor", Source.FRAME, "sensor", "name of the sensor setting", "default", required=True),
    _label(
        "function", Source.FUNCTION, "function", "name of the function under test", "deeplabv3plus-small", required=True
    ),
    Measure(
        "instance_id", ColumnType.INT32, Source.FRAME, "person",
        "label id × 1000 + n; empty if the frame shows no person", 24001,
    ),
    Measure(
        "distance_m", ColumnType.FLOAT, Source.PLACE, "distance",
        "Euclidean distance from the optical centre to the point on the ground between the person's feet",
        17.09, unit="m", digits=2, low=0.0, bin_width=5.0, is_tested=True, is_queried=True,
    ),
    Measure(
        "depth_m", ColumnType.FLOAT, Source.PLACE, "depth",
        "depth of the same point along the optical axis, negative behind the camera", 17.0, unit="m", digits=2,
    ),
    _angle(
        "bearing_deg", Source.PLACE, "bearing",
        "angle from the optical axis to the same point, −180…180, positive to the right", 4.6,
    ),
    _angle(
        "aspect_deg", Source.PLACE, "aspect",
        "heading of the person relative to the line of sight, −180…180: 0 faces the camera, ±180 shows the back", -1.9,
    ),
    _rate(
        "occlusion_rate", Source.PIXELS, "occlusion",
        "share of the person's pixels within the image that other objects hide: 1 − visible pixels / pixels of the "
        "person rendered alone", 0.0519, bin_width=0.05, is_tested=True, is_queried=True,
    ),
    _rate(
        "truncation_rate", Source.PIXELS, "truncation", "share of the person that lies beyond the image border", 0.0,
        is_tested=True,
    ),
    _count("pixel_area", Source.PIXELS, "visible pixel area", "visible pixels of the person", 2190, unit="pixels"),
    Measure(
        "pixel_area_percent", ColumnType.FLOAT, Source.PIXELS, "pixel area",
        "visible pixels of the person as a share of all pixels of the image, in per cent",
        0.4225, unit="% of the image", digits=3, low=0.0, high=100.0, bin_width=0.05, is_tested=True,
        is_queried=True,
    ),
    _count(
        "pixel_area_amodal", Source.PIXELS, "amodal pixel area",
        "pixels of the person rendered alone, within the image", 2310, unit="pixels",
    ),
    Measure(
        "irradiance", ColumnType.FLOAT, Source.LIGHT, "light on the body",
        "light that arrives on the visible body; 1 is a clear noon sun; 0.89 to 1.62 times a path tracer's (95 % of persons)",
        0.71, unit="of a clear noon sun", digits=2, low=0.0, bin_width=0.1, is_tested=True, is_queried=True,
    ),
    _rate(
        "shadow_share", Source.LIGHT, "body in shadow",
        "share of the visible body in shadow; empty without a sun", 0.13, bin_width=0.1, is_tested=True,
    ),
    Measure(
        "contrast", ColumnType.FLOAT, Source.LIGHT, "contrast to the surroundings",
        "Michelson contrast of the visible body to the ring of pixels around it, −1…1; negative for a darker body",
        0.22, unit="Michelson", digits=2, low=-1.0, high=1.0, bin_width=0.1, is_tested=True, is_queried=True,
    ),
    Measure(
        "time_s", ColumnType.FLOAT, Source.CONDITIONS, "time",
        "time of the frame from the start of its sequence; 0 in a run without time",
        0.0, unit="s", digits=2, bin_width=0.5,
    ),
    _angle(
        "sun_azimuth_deg", Source.CONDITIONS, "sun azimuth",
        "azimuth of the sun, clockwise from north, also for a sun by time and place", 140.0,
    ),
    _angle(
        "sun_elevation_deg", Source.CONDITIONS, "sun elevation",
        "elevation of the sun above the horizon, negative after sunset", 35.0,
    ),
    Measure(
        "road_friction", ColumnType.FLOAT, Source.CONDITIONS, "road friction",
        "peak friction coefficient of new tyres on this road in this weather, at 50 km/h", 0.85, digits=2, low=0.0,
    ),
    _grey("picture_mean", "mean grey level", "mean grey level of the picture given to the function, 0…255", 96.4),
    _grey(
        "picture_deviation", "spread of the grey levels",
        "standard deviation of the grey levels of the picture given to the function", 41.7,
    ),
    _rate(
        "black_share", Source.PICTURE, "black pixels",
        "share of the pixels of the picture given to the function that are 0 in all channels", 0.002,
    ),
    _rate(
        "white_share", Source.PICTURE, "white pixels",
        "share of the pixels of the picture given to the function that are 255 in all channels", 0.013,
    ),
    _count("tp", Source.PERSON_SCORE, "person pixels found", "pixels of the person that are predicted as person", 1980,
           required=True),
    _count("fn", Source.PERSON_SCORE, "person pixels missed", "pixels of the person that are predicted as anything else",
           210, required=True),
    _rate(
        "pacc", Source.PERSON_SCORE, "pACC",
        "share of the person's visible pixels that are predicted as person: tp / (tp + fn)", 0.9041,
    ),
    _rate(
        "pacc_empty", Source.PERSON_SCORE, "pACC without the person",
        "share of the same pixels that are predicted as person in the scene without movables; empty if "
        "backgrounds are not inferred", 0.0,
    ),
    _label(
        "undefined_reason", Source.PIXELS, "why pACC is undefined",
        "reason why the person has no pACC: absent, outside the image or fully hidden; empty if pACC is defined", None,
    ),
    _rate(
        "precision", Source.FRAME_SCORE, "precision",
        "share of the frame's pixels predicted as person that show a person; empty if there are none",
        0.8646,
    ),
    _rate(
        "iou", Source.FRAME_SCORE, "IoU",
        "intersection over union of the class person in the frame; empty if it is in neither truth nor prediction",
        0.792,
    ),
    _rate(
        "pixel_accuracy", Source.FRAME_SCORE, "pixel accuracy",
        "share of the frame's labelled pixels that are correct, over the classes that the function is judged by", 0.9413,
    ),
    _rate(
        "miou", Source.FRAME_SCORE, "mIoU",
        "mean IoU over the classes in the frame's truth that the function is judged by", 0.6122,
    ),
    _rate("fwiou", Source.FRAME_SCORE, "fwIoU", "mean IoU with each class weighted by its pixels in the truth", 0.9011),
    _rate(
        "macc", Source.FRAME_SCORE, "mAcc",
        "mean recall over the classes in the frame's truth that the function is judged by", 0.6904,
    ),
    _count("fp", Source.FRAME_SCORE, "false person pixels",
           "pixels of the frame that are predicted as person but show none; repeated in each of its rows", 310,
           required=True),
)  # fmt: skip
#: The measures by their names.
BY_NAME: Final = {measure.name: measure for measure in MEASURES}


def measure_of(name: str) -> Measure:
    """Return the measure of a column.

    Raises:
        UnknownName: there is no such column.
    """
    if name not in BY_NAME:
        raise UnknownName("column", name, BY_NAME)
    return BY_NAME[name]


def measures_from(*sources: Source) -> tuple[Measure, ...]:
    """Return the measures from these sources, in the order of the long table."""
    return tuple(measure for measure in MEASURES if measure.source in sources)


def names_from(*sources: Source) -> tuple[str, ...]:
    """Return the names of the measures from these sources, in the order of the long table."""
    return tuple(measure.name for measure in measures_from(*sources))
