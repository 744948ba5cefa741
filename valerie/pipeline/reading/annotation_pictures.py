"""Annotations as pictures."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from valerie.rendering.annotations.boxes import EDGES, Boxes
from valerie.rendering.annotations.flow import FlowMap
from valerie.rendering.annotations.joints import LIMBS, OUTSIDE, VISIBLE, Joints
from valerie.rendering.annotations.normals import Normals
from valerie.scene.graph.model import JOINTS

#: Colours of a box's edges at its back and sides, and at its front (towards its heading).
_REST, _FRONT = (86, 180, 233), (240, 228, 66)
_EDGES_IN_FRONT: Final = 4
#: Colours of the limbs in the middle, on the left and on the right side; hidden limbs are darker.
_LIMB_COLOURS: Final = ((240, 228, 66), (86, 180, 233), (230, 159, 0))


def paint_normals(normals: Normals) -> NDArray[np.uint8]:
    """Paint normals: x, y and z of the world from −1…1 as red, green and blue; black where there is no surface."""
    picture: NDArray[np.uint8] = np.rint((normals.vectors() + 1.0) * 127.5).astype(np.uint8)
    picture[~normals.defined] = 0
    return picture


def paint_flow(flow: FlowMap) -> NDArray[np.uint8]:
    """Paint flow: direction as hue (red to the right, yellow-green downwards), length as saturation up to the longest.

    White is no motion, grey is undefined (colour wheel after S. Baker et al., "A database and evaluation methodology for
    optical flow", IJCV 92, 2011, doi:10.1007/s11263-010-0390-2, in HSV).
    """
    x, y = np.nan_to_num(flow.vectors[..., 0]), np.nan_to_num(flow.vectors[..., 1])
    length = np.hypot(x, y)
    longest = max(float(length.max(initial=0.0)), 1e-6)
    turn = (np.arctan2(y, x) / (2.0 * np.pi)) % 1.0
    sector = (turn[..., None] * 6.0 + np.array([5.0, 3.0, 1.0])) % 6.0
    absorbed = np.clip(np.minimum(sector, 4.0 - sector), 0.0, 1.0) * (length / longest)[..., None]
    picture: NDArray[np.uint8] = np.rint(255.0 * (1.0 - absorbed)).astype(np.uint8)
    picture[~flow.defined] = 128
    return picture


def paint_boxes(boxes: Boxes, width: int, height: int) -> tuple[NDArray[np.uint8], NDArray[np.bool_]]:
    """Paint the edges of the boxes of all visible instances: (H, W, 3) uint8 colours, and (H, W) bool where they are."""
    canvas = Image.new("RGB", (width, height))
    draw = ImageDraw.Draw(canvas)
    # Farther boxes first, so that nearer ones stay in front.
    nearest_last = np.argsort(boxes.camera_centres[:, 2])
    for i in nearest_last.tolist():
        if not boxes.pixel_areas[i]:
            continue
        corners = boxes.projected_corners[i]
        for k, (a, b) in enumerate(EDGES):
            line = (*corners[a].tolist(), *corners[b].tolist())
            # A corner just in front of the camera's plane is far outside the image.
            if np.isfinite(line).all() and np.abs(line).max() < 8 * max(width, height):
                draw.line(
                    line, fill=_FRONT if k >= len(EDGES) - _EDGES_IN_FRONT else _REST, width=max(1, height // 500)
                )
    picture = np.asarray(canvas, np.uint8)
    strokes: NDArray[np.bool_] = picture.max(axis=2) > 0
    return picture, strokes


def paint_joints(joints: Joints, width: int, height: int) -> tuple[NDArray[np.uint8], NDArray[np.bool_]]:
    """Paint the skeletons of all persons with a joint in the image: (H, W, 3) uint8 colours, and (H, W) bool where they are.

    Left limbs are blue, right ones orange. A limb with a joint that is not visible is darker, and such joints have no dot.
    """
    canvas = Image.new("RGB", (width, height))
    draw = ImageDraw.Draw(canvas)
    for i in np.argsort(joints.camera_places[:, 0, 2]).tolist():
        pixels, visibility = joints.pixels[i], joints.visibility[i]
        if not (visibility != OUTSIDE).any():
            continue
        size = max(1, round(float(np.ptp(pixels[np.isfinite(pixels[:, 1]), 1])) / 90))
        for a, b in LIMBS:
            line = (*pixels[a].tolist(), *pixels[b].tolist())
            if not np.isfinite(line).all() or np.abs(line).max() > 8 * max(width, height):
                continue
            side = 1 if JOINTS[b].startswith("left") else 2 if JOINTS[b].startswith("right") else 0
            both = visibility[a] == VISIBLE and visibility[b] == VISIBLE
            shade = _LIMB_COLOURS[side] if both else tuple(value * 2 // 5 for value in _LIMB_COLOURS[side])
            draw.line(line, fill=shade, width=size)
        for (x, y), flag in zip(pixels.tolist(), visibility.tolist(), strict=True):
            if flag == VISIBLE:
                draw.ellipse((x - size, y - size, x + size, y + size), fill=(255, 255, 255))
    picture = np.asarray(canvas, np.uint8)
    strokes: NDArray[np.bool_] = picture.max(axis=2) > 0
    return picture, strokes
