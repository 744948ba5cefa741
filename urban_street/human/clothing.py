"""Patterns: garments cut in the rest pose from MakeHuman's ``helper-tights``, which fit the body like a second skin.

A pattern is cut along hems and eased (moved off the body). Its limbs are widened to tubes and its trunk to a hanging barrel.
Then it is posed with the body's own skinning weights and settled as cloth (`drape`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from urban_street.human import data, drape, surface
from urban_street.human.body import Body
from urban_street.human.pose import Posed
from urban_street.human.surface import Indices, Points

_ARM: Final = ("upperarm", "lowerarm", "hand", "thumb", "index", "middle", "ring", "pinky")
_LEG: Final = ("thigh", "calf", "foot", "ball")
TRUNK, LEFT, RIGHT = 0, 1, 2


@dataclass(frozen=True, slots=True)
class Cut:
    """The cut of a garment.

    Attributes:
        kind: ``top`` (trunk and arms), ``trousers`` or ``skirt`` (one tube around both legs).
        upper: the upper end. Trousers and skirt: share of the way from the hip joints (0) to the navel's joint (1). Top: metres
            along the neck from its base.
        lower: the lower end. Trousers and skirt: metres above the sole. Top: share of the way from the crotch (0) to the waist
            (1).
        sleeve: share of the arm that sleeves cover: 1 to the elbow, 2 to the wrist.
        ease: distance between body and cloth, metres.
        hang: 0 follows the trunk … 1 hangs from its widest place.
        tube: radii, metres, of the sleeve or trouser leg by place along the limb (0 root, 1 elbow or knee, 2 wrist or ankle);
            for a skirt, its additional distance from the body by place from the waist (0) to the hem (1).
        fabric: properties of the cloth.
    """

    kind: Literal["top", "trousers", "skirt"]
    upper: float
    lower: float
    sleeve: float = 2.0
    ease: float = 0.012
    hang: float = 0.0
    tube: Mapping[float, float] = field(default_factory=dict)
    fabric: drape.Fabric = field(default_factory=drape.Fabric)


@dataclass(frozen=True, slots=True, eq=False)
class Cloth:
    """A garment on a posed body.

    Attributes:
        points: (V, 3) posed vertices, metres.
        rest: (V, 3) the pattern in the rest pose.
        weights: (V, bones) skinning weights.
        faces: (F, 3).
        regions: (V,) 0 trunk, 1 left limb, 2 right limb (trousers have no trunk: each half belongs to its leg).
    """

    points: Points
    rest: Points
    weights: Points
    faces: Indices
    regions: Indices


@dataclass(frozen=True, slots=True, eq=False)
class SecondSkin:
    """``helper-tights``, subdivided once: (V, 3) rest positions, (V, bones) weights, (F, 4) quads."""

    rest: Points
    weights: Points
    quads: Indices


def second_skin(body: Body) -> SecondSkin:
    """Return the tight surface from which garments and shoes are cut."""
    mapped = _tights()
    return SecondSkin(mapped.matrix @ body.vertices, mapped.matrix @ data.rig().weights, mapped.faces)


def share(weights: Points, names: tuple[str, ...], side: str = "") -> Points:
    """Return the sum of the weights, (V,), of the bones whose names start with one of ``names`` and end with ``side``."""
    columns = [b.startswith(names) and b.endswith(side) for b in data.rig().bones]
    total: Points = weights[:, columns].sum(axis=1)
    return total


def beyond_hems(cut: Cut, body: Body, points: Points, weights: Points) -> tuple[Points, ...]:
    """Return the signed distances, metres, of (V, 3) rest points to each hem; positive outside the garment."""
    arms = share(weights, _ARM)
    if cut.kind != "top":
        hips, navel = body.head("thigh_l")[2], body.head("spine_02")[2]
        waist = hips + cut.upper * (navel - hips)
        # a waistband sits higher at the back
        tilted = points[:, 2] + 0.08 * (points[:, 1] - body.head("pelvis")[1])
        return (
            np.where(arms > 0.5, 1.0, tilted - waist),
            np.where(arms > 0.5, 1.0, _sole(body) + cut.lower - points[:, 2]),
        )
    hem = _crotch(body) + cut.lower * (body.head("spine_02")[2] - _crotch(body))
    neck, head = body.head("neck_01"), body.head("head")
    axis = surface.normalize(surface.normalize(head - neck) + np.array([0.0, 0.1, 0.0]))
    reach = body.head("neck_01") + cut.upper * axis
    along = np.zeros(len(points))
    for side in ("l", "r"):
        own = share(weights, _ARM, side) > 0.5
        along[own] = limb_place(body, "arm", side, points[own])[0]
    length = np.linalg.norm(body.tail("lowerarm_l") - body.head("lowerarm_l"))
    return (
        np.where(arms > 0.5, -1.0, hem - points[:, 2]),
        np.where(arms > 0.5, -1.0, (points - reach) @ axis),
        np.where(arms > 0.5, (along - cut.sleeve) * length, -1.0),
    )


def limb_place(body: Body, limb: Literal["arm", "leg"], side: str, points: Points) -> tuple[Points, Points]:
    """Return the places of points along a limb, and the nearest points on its axis.

    Returns:
        (V,) 0 at the root, 1 at the elbow or knee, 2 at the wrist or ankle, continued on both ends; (V, 3) axis points.
    """
    first, second = (f"upperarm_{side}", f"lowerarm_{side}") if limb == "arm" else (f"thigh_{side}", f"calf_{side}")
    root, joint, end = body.head(first), body.head(second), body.tail(second)
    upper, lower = joint - root, end - joint
    t_upper = (points - root) @ upper / (upper @ upper)
    t_lower = (points - joint) @ lower / (lower @ lower)
    on_upper = root + t_upper[:, None] * upper
    on_lower = joint + t_lower[:, None] * lower
    bisector = surface.normalize(surface.normalize(upper) + surface.normalize(lower))
    beyond = (points - joint) @ bisector
    blend = np.clip(beyond / 0.12 + 0.5, 0.0, 1.0)  # blended over 12 cm, so that the axis has no kink
    return (1 - blend) * t_upper + blend * (1 + t_lower), (1 - blend)[:, None] * on_upper + blend[:, None] * on_lower


@dataclass(frozen=True, slots=True, eq=False)
class Pattern:
    """A cut garment that is not on a body yet.

    Attributes:
        rest, weights, faces, regions: as in `Cloth`.
        pinned: (V,) bool, the vertices that hold the garment up.
    """

    rest: Points
    weights: Points
    faces: Indices
    regions: Indices
    pinned: NDArray[np.bool_]


def wear(cut: Cut, body: Body, posed: Posed, under: tuple[Cloth, ...] = ()) -> Cloth:
    """Cut a garment, put it on the posed body over the other garments, and let it settle."""
    return put_on(cut, cut_out(cut, body), second_skin(body), posed, under)


def put_on(cut: Cut, pattern: Pattern, skin: SecondSkin, posed: Posed, under: tuple[Cloth, ...] = ()) -> Cloth:
    """Put a pattern on the posed body over the other garments, and let it settle."""
    start = posed.apply(pattern.rest, pattern.weights)
    obstacle = _obstacle(cut, skin, posed, under)
    points = drape.settle(start, pattern.rest, pattern.faces, pattern.pinned, pattern.regions, obstacle, cut.fabric)
    return Cloth(points, pattern.rest, pattern.weights, pattern.faces, pattern.regions)


def cut_out(cut: Cut, body: Body) -> Pattern:
    """Cut a garment in the rest pose."""
    skin = _drape_skin(body) if cut.kind == "skirt" else second_skin(body)
    rest, weights, faces = skin.rest, skin.weights, surface.triangles(skin.quads)
    for hem in range(len(beyond_hems(cut, body, rest, weights))):
        piece = surface.clip(faces, beyond_hems(cut, body, rest, weights)[hem])
        rest, weights, faces = piece.matrix @ rest, piece.matrix @ weights, piece.faces
    regions = _regions(cut, rest, weights)
    rest = _ease(cut, body, rest, weights, faces, regions)
    return Pattern(rest, weights, faces, regions, _pinned(cut, body, rest, weights))


def covered(cut: Cut, body: Body, points: Points, weights: Points, margin: float) -> NDArray[np.bool_]:
    """Return a mask, (V,), of the body's rest points under the garment, at least ``margin`` metres from every hem."""
    return np.asarray(np.max(beyond_hems(cut, body, points, weights), axis=0) < -margin)


def _ease(cut: Cut, body: Body, rest: Points, weights: Points, faces: Indices, regions: Indices) -> Points:
    smooth = surface.neighbours(faces, len(rest))
    normals = surface.vertex_normals(rest, faces)
    for _ in range(6):
        normals = surface.normalize(smooth @ normals)
    eased = rest + cut.ease * normals
    if cut.hang > 0.0:
        eased = _hang(cut, body, eased, share(weights, _ARM))
    if cut.kind == "skirt":
        return surface.even_edges(_flare(cut, body, eased), faces)
    if cut.tube:
        for side, region in (("l", LEFT), ("r", RIGHT)):
            own = regions == region
            eased[own] = _tube(cut, body, side, eased[own], weights[own])
    for _ in range(4):  # smooth the transitions that hang and tube leave, without shrinking
        eased = eased + 0.5 * (smooth @ eased - eased)
        eased = eased - 0.52 * (smooth @ eased - eased)
    return surface.even_edges(eased, faces)


def _tube(cut: Cut, body: Body, side: str, points: Points, weights: Points) -> Points:
    """Widen a limb's cloth to at least the tube's radius."""
    along, axis = limb_place(body, "arm" if cut.kind == "top" else "leg", side, points)
    radius = np.interp(along, list(cut.tube), list(cut.tube.values()))
    offset = points - axis
    reach = np.linalg.norm(offset, axis=1)
    wide = np.maximum(reach, radius)
    # Near the trunk, the limb's cloth merges into the trunk's.
    fade = np.clip((along - min(cut.tube)) / 0.35, 0.0, 1.0) * share(weights, _ARM if cut.kind == "top" else _LEG)
    widened: Points = axis + offset * ((1 - fade) + fade * wide / np.maximum(reach, 1e-6))[:, None]
    return widened


def _flare(cut: Cut, body: Body, points: Points) -> Points:
    """Let a skirt stand out from the body by the distance of its tube, with folds that deepen towards the hem."""
    top, bottom = points[:, 2].max(), points[:, 2].min()
    place = (top - points[:, 2]) / (top - bottom)
    offset = points[:, :2] - body.head("pelvis")[:2]
    reach = np.linalg.norm(offset, axis=1)
    out = np.interp(place, list(cut.tube), list(cut.tube.values())) if cut.tube else np.zeros(len(points))
    angle = np.arctan2(offset[:, 1], offset[:, 0])
    out = out * (1.0 + 0.45 * np.sin(9.0 * angle + 0.7 * np.sin(2.0 * angle)))  # godets form folds
    flared = points.copy()
    flared[:, :2] += offset / np.maximum(reach, 1e-6)[:, None] * out[:, None]
    return flared


def _hang(cut: Cut, body: Body, points: Points, arms: Points) -> Points:
    """Let the trunk's cloth hang from its widest place above, instead of following waist and back."""
    trunk = arms < 0.3
    centre = body.head("spine_02")[:2]
    offset = points[:, :2] - centre
    angle = np.arctan2(offset[:, 1], offset[:, 0])
    reach = np.linalg.norm(offset, axis=1)
    low, high = points[trunk, 2].min(), body.head("upperarm_l")[2] - 0.10
    rows, columns = 28, 48
    row = np.clip((points[:, 2] - low) / (high - low), 0.0, 1.0) * (rows - 1)
    column = (angle / (2 * np.pi) % 1.0) * columns
    inside = trunk & (points[:, 2] < high)
    where = np.round(row[inside]).astype(int), np.round(column[inside]).astype(int) % columns
    total, number = np.zeros((rows, columns)), np.zeros((rows, columns))
    np.add.at(total, where, reach[inside])
    np.add.at(number, where, 1.0)
    mode: tuple[Literal["nearest"], Literal["wrap"]] = ("nearest", "wrap")
    blur = ndimage.gaussian_filter(total, (1.0, 1.2), mode=mode)
    profile = blur / np.maximum(ndimage.gaussian_filter(number, (1.0, 1.2), mode=mode), 1e-6)
    widest = np.maximum.accumulate(profile[::-1], axis=0)[::-1]  # from the chest downwards
    widest = ndimage.gaussian_filter(widest, (1.5, 2.0), mode=mode)
    lowest = ndimage.map_coordinates(widest, [row, column], order=1, mode="grid-wrap")
    fade = cut.hang * np.clip((high - points[:, 2]) / 0.10, 0.0, 1.0) * np.clip((0.3 - arms) / 0.2, 0.0, 1.0)
    radius = np.maximum(reach, (1 - fade) * reach + fade * lowest)
    hanging = points.copy()
    hanging[:, :2] = centre + offset * (radius / np.maximum(reach, 1e-6))[:, None]
    return hanging


def _regions(cut: Cut, rest: Points, weights: Points) -> Indices:
    if cut.kind == "skirt":
        arms = share(weights, _ARM)
        return np.where(arms > 0.5, LEFT, TRUNK).astype(np.int64)
    if cut.kind == "trousers":
        left, right = share(weights, _LEG, "_l"), share(weights, _LEG, "_r")
        return np.where(left + 1e-6 * -rest[:, 0] > right, LEFT, RIGHT).astype(np.int64)
    left, right = share(weights, _ARM, "_l"), share(weights, _ARM, "_r")
    return np.where(left > 0.5, LEFT, np.where(right > 0.5, RIGHT, TRUNK)).astype(np.int64)


def _obstacle(cut: Cut, skin: SecondSkin, posed: Posed, under: tuple[Cloth, ...]) -> drape.Obstacle:
    points = posed.apply(skin.rest, skin.weights)
    parts = [drape.outside_normals(points, skin.quads, _regions(cut, skin.rest, skin.weights))]
    parts += [drape.outside_normals(c.points, c.faces, _regions(cut, c.rest, c.weights)) for c in under]
    return drape.Obstacle(
        np.concatenate([p.points for p in parts]),
        np.concatenate([p.normals for p in parts]),
        np.concatenate([p.regions for p in parts]),
    )


def _pinned(cut: Cut, body: Body, rest: Points, weights: Points) -> NDArray[np.bool_]:
    """Return the vertices that hold the garment up: the waistband, or neck and shoulder seams."""
    hems = beyond_hems(cut, body, rest, weights)
    if cut.kind != "top":
        return hems[0] > -0.03
    return hems[1] > -0.025


def _sole(body: Body) -> float:
    return float(body.vertices[np.unique(data.base_mesh().groups["body"].quads), 2].min())


def _crotch(body: Body) -> float:
    """Return the height of the lowest point of the trunk between the legs."""
    rows = np.unique(data.base_mesh().groups["body"].quads)
    points = body.vertices[rows]
    middle = (np.abs(points[:, 0]) < 0.01) & (np.abs(points[:, 1] - body.head("pelvis")[1]) < 0.05)
    return float(points[middle, 2].min())


def _drape_skin(body: Body) -> SecondSkin:
    """Return ``helper-skirt``: a tube around both legs from the waist to the ankles."""
    mapped = _subdivided("helper-skirt")
    return SecondSkin(mapped.matrix @ body.vertices, mapped.matrix @ data.rig().weights, mapped.faces)


def _tights() -> surface.Mapped:
    return _subdivided("helper-tights")


@lru_cache(maxsize=2)
def _subdivided(group: str) -> surface.Mapped:
    mesh = data.base_mesh()
    once = surface.subdivide(mesh.groups[group].quads, len(mesh.vertices))
    small = surface.compact(once.faces, once.matrix.shape[0])
    return surface.Mapped((small.matrix @ once.matrix).tocsr(), small.faces)
