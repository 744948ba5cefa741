"""Rows that say how persons are seen."""

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
    """Return the row of one person in one truth (or in an evaluation whose sensor distorts)."""
    return {
        "truth": truth,
        "instance_id": view.instance_id,
        **{name: getattr(view, name) for name in (*_PLACED, *_SEEN)},
        "box": _corners(view.box),
        "amodal_box": _corners(view.amodal_box),
    }


def _corners(box: Box | None) -> list[int] | None:
    """Return [x0, y0, x1, y1], end exclusive, of (x, y, width, height)."""
    return None if box is None else [box[0], box[1], box[0] + box[2], box[1] + box[3]]


def no_person(truth: str) -> dict[str, Any]:
    """Return the row of a frame without any person, so that no result omits the frame in silence."""
    return {"truth": truth, "instance_id": 0, **dict.fromkeys((*_PLACED, *_SEEN)), "undefined_reason": "absent"}


def measured_again(row: Mapping[str, Any], truth: GroundTruth) -> dict[str, Any]:
    """Return the row of a person with everything that is measured in pixels taken from another truth of the same scene.

    Args:
        row: any of the columns of `valerie.db.models.PersonView`, and others, which stay.
        truth: as a distorting sensor sees it.
    """
    number = row["instance_id"]
    person = next((person for person in truth.persons if person.instance_id == number), None)
    if person is None:  # absent, or no person at all
        return dict(row)
    measured = view_row("", measure_pixels(person, truth))
    return {**row, **{name: measured[name] for name in _SEEN if name in row}}
