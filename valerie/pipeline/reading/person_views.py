"""Rows about the visibility of persons."""

from __future__ import annotations

from typing import Final

from valerie.db.measured import SEEN, SeenPerson
from valerie.measures import Source, names_from
from valerie.rendering.base import GroundTruth, Rectangle
from valerie.rendering.visibility import ABSENT, Visibility, measure_pixels

_PIXELS: Final = names_from(Source.PIXELS)
#: Row of a frame without persons, so that no result silently omits the frame.
NO_PERSON: Final = SeenPerson(0, {**dict.fromkeys(SEEN), "undefined_reason": ABSENT}, None, None)


def seen_person(view: Visibility) -> SeenPerson:
    """Return the row of one person in one truth."""
    measures = {name: getattr(view, name) for name in SEEN}
    return SeenPerson(view.instance_id, measures, _corners(view.box), _corners(view.amodal_box))


def _corners(box: Rectangle | None) -> list[int] | None:
    """Return [x0, y0, x1, y1], end exclusive."""
    return None if box is None else [box.x, box.y, box.x + box.width, box.y + box.height]


def measured_again(person: SeenPerson, truth: GroundTruth) -> SeenPerson:
    """Return a person with all pixel measures taken from another truth of the same scene.

    Args:
        person: the person in the frame's own truth; its other measures stay.
        truth: the truth that a distorting sensor sees.
    """
    shown = next((shown for shown in truth.persons if shown.instance_id == person.instance_id), None)
    if shown is None:  # absent, or no person at all
        return person
    view = seen_person(measure_pixels(shown, truth))
    pixels = {name: view.measures[name] for name in _PIXELS}
    return SeenPerson(person.instance_id, {**person.measures, **pixels}, view.box, view.amodal_box)
