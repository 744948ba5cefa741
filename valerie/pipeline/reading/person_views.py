"""Rows of the visibility of persons."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from valerie.measures import Source, names_from
from valerie.rendering.base import GroundTruth
from valerie.rendering.visibility import Box, Visibility, measure_pixels

#: Columns of `valerie.db.models.PersonView` that are measured in the picture.
_SEEN: Final = (*names_from(Source.PIXELS), "box", "amodal_box")
_PLACED: Final = names_from(Source.PLACE)


def view_row(truth: str, view: Visibility) -> dict[str, Any]:
    """The row of one person in one truth (or in an evaluation whose sensor distorts)."""
    return {
        "truth": truth,
        "instance_id": view.instance_id,
        **{name: getattr(view, name) for name in (*_PLACED, *_SEEN)},
        "box": _corners(view.box),
        "amodal_box": _corners(view.amodal_box),
    }


def _corners(box: Box | None) -> list[int] | None:
    """(x, y, width, height) to [x0, y0, x1, y1], end exclusive."""
    return None if box is None else [box[0], box[1], box[0] + box[2], box[1] + box[3]]


def no_person(truth: str) -> dict[str, Any]:
    """A frame without any person still has its row, so that it is missing from no result in silence."""
    return {"truth": truth, "instance_id": 0, **dict.fromkeys((*_PLACED, *_SEEN)), "undefined_reason": "absent"}


def measured_again(row: Mapping[str, Any], truth: GroundTruth) -> dict[str, Any]:
    """The row of one person with everything that is measured in pixels taken from another truth of the same scene.

    Args:
        row: any of the columns of `valerie.db.models.PersonView`, and others, which stay.
        truth: as a distorting sensor sees it.
    """
    person = next((one for one in truth.persons if one.instance_id == row["instance_id"]), None)
    if person is None:  # absent, or nobody at all
        return dict(row)
    measured = view_row("", measure_pixels(person, truth))
    return {**row, **{name: measured[name] for name in _SEEN if name in row}}
