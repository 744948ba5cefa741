"""Rows of the visibility of persons."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from valerie.rendering.base import GroundTruth
from valerie.rendering.visibility import Box, Visibility, measure_pixels


def view_row(truth: str, view: Visibility) -> dict[str, Any]:
    """The row of one person in one truth (or in an evaluation whose sensor distorts)."""
    return {
        "truth": truth,
        "instance_id": view.instance_id,
        "pixel_area": view.pixel_area,
        "pixel_area_percent": view.pixel_area_percent,
        "pixel_area_amodal": view.pixel_area_amodal,
        "occlusion_rate": view.occlusion_rate,
        "truncation_rate": view.truncation_rate,
        "distance_m": view.distance_m,
        "depth_m": view.depth_m,
        "bearing_deg": view.bearing_deg,
        "aspect_deg": view.aspect_deg,
        "box": _corners(view.box),
        "amodal_box": _corners(view.amodal_box),
        "undefined_reason": view.undefined_reason,
    }


def _corners(box: Box | None) -> list[int] | None:
    """(x, y, width, height) to [x0, y0, x1, y1], end exclusive."""
    return None if box is None else [box[0], box[1], box[0] + box[2], box[1] + box[3]]


def no_person(truth: str) -> dict[str, Any]:
    """A frame without any person still has its row, so that it is missing from no result in silence."""
    return {
        "truth": truth,
        "instance_id": 0,
        "pixel_area": 0,
        "pixel_area_percent": 0.0,
        "pixel_area_amodal": 0,
        "occlusion_rate": None,
        "truncation_rate": None,
        "distance_m": None,
        "depth_m": None,
        "bearing_deg": None,
        "aspect_deg": None,
        "box": None,
        "amodal_box": None,
        "undefined_reason": "absent",
    }


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
    kept = ("truth", "distance_m", "depth_m", "bearing_deg", "aspect_deg")
    return {name: measured[name] if name in measured and name not in kept else value for name, value in row.items()}
