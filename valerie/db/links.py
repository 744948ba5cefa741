"""Expressions about what a frame links to, for the columns of queries."""

from __future__ import annotations

from typing import Any

from sqlalchemy import select

from valerie.db.models import Frame, FrameAnnotation
from valerie.rendering.annotations.kinds import AnnotationKind


def velocity_of_frame() -> Any:
    """Digest of the velocities of the frame that a query reads, or NULL, as ``velocity``."""
    return (
        select(FrameAnnotation.product)
        .where(
            FrameAnnotation.run_id == Frame.run_id,
            FrameAnnotation.variant_index == Frame.variant_index,
            FrameAnnotation.camera_index == Frame.camera_index,
            FrameAnnotation.time_index == Frame.time_index,
            FrameAnnotation.kind == AnnotationKind.VELOCITY.value,
        )
        .correlate(Frame)
        .scalar_subquery()
        .label("velocity")
    )
