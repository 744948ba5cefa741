# SPDX-License-Identifier: Apache-2.0
"""Poses."""

from __future__ import annotations

from typing import Any


def matrix_of(pose: Any) -> Any:
    """Return a (4, 4) array as Blender's matrix."""
    from mathutils import Matrix

    return Matrix(pose.tolist())
