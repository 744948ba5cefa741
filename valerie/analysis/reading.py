"""The words of a report that are the same in every report: what it claims, and how its numbers are to be read."""

from __future__ import annotations

from typing import Final

STATEMENT: Final = (
    "This report is evidence to support a safety argument. It is not a statement of compliance with any standard, "
    "and it says nothing about situations, scenes or sensors that were not varied here."
)
_PACC: Final = (
    "Share of the visible pixels of a pedestrian that the function calls person: tp / (tp + fn). It is the recall of "
    "one class: a function that calls everything person reaches 100 %. Precision and IoU of the frame stand beside it."
)
_MEANS: Final = "The mean weighs every person in every frame the same; pooled counts weigh every pixel the same."
_UNDEFINED: Final = (
    "A pedestrian without a visible pixel has no pACC. It is counted with its reason, never as 0, never left out."
)
_DETECTED: Final = "Share of pedestrians with a defined pACC that reaches the threshold, with Wilson's 95 % interval."
_OCCLUSION: Final = (
    "1 − visible pixels / pixels of the pedestrian rendered alone with the same camera. What the image border cuts is "
    "measured apart."
)
_DISTANCE: Final = "From the optical centre to the point on the ground between the pedestrian's feet."
_INTERVALS: Final = (
    "Bootstrap over situations. A situation is everything that was varied except which pedestrian it is; cameras, "
    "functions and pedestrians of one situation are drawn together. The intervals speak of situations like the ones "
    "that were rendered, not of the street outside. Wilson's intervals take persons as independent, and are "
    "a little too narrow where situations repeat."
)
#: Term and explanation, in reading order.
READING: Final = (
    ("pACC", _PACC),
    ("mean, pooled", _MEANS),
    ("undefined", _UNDEFINED),
    ("detected", _DETECTED),
    ("occlusion", _OCCLUSION),
    ("distance", _DISTANCE),
    ("95 % intervals", _INTERVALS),
)
