"""Things that people carry: bags, an umbrella, a phone. They are fitted to the dressed body, since straps lie on clothes."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from urban_street.human import data, fabrics, stances, surface, textures
from urban_street.human.aids import COLLAR_RING
from urban_street.human.body import Body
from urban_street.human.pose import Posed
from urban_street.human.postures import hips
from urban_street.human.surface import Indices, Points, normalize

#: Positions, normals, texture coordinates, faces.
Piece = tuple[Points, Points, Points, Indices]

#: Distance from shoulder joint to crotch of the body for which the sizes below are made, metres.
_TORSO: Final = 0.57
_PARTS: Final[Mapping[str, tuple[str, ...]]] = {
    "shoulder-bag": ("carried-shoulder-bag",),
    "backpack": ("carried-backpack",),
    "shopping-bag": ("carried-shopping-bag",),
    "umbrella": ("carried-canopy", "carried-shaft"),
}


#: Parts that belong to a pose.
_OF_POSE: Final[Mapping[str, tuple[str, ...]]] = {
    "phone": ("carried-phone",),
    "crutches": ("carried-crutches",),
    "cane": ("carried-cane",),
    "box": ("carried-box",),
    "dog": ("carried-leash",),
}


def parts(carries: str, pose: str) -> tuple[str, ...]:
    """Return the parts of a carried thing that a stance shows."""
    return _PARTS.get(carries, ()) + _OF_POSE.get(pose, ())


def takes_a_hand(carries: str) -> bool:
    """Return True if the carried thing changes the pose of an arm."""
    return carries in {"umbrella", "shopping-bag"}


def paints(
    bag: textures.Colour, umbrella: textures.Colour
) -> dict[str, tuple[Callable[[], textures.TextureCanvas], float]]:
    """Return painter and roughness of each part."""
    return {
        "carried-shoulder-bag": (partial(fabrics.bag, bag, 41), 0.5),
        "carried-backpack": (partial(fabrics.bag, bag, 42), 0.75),
        "carried-shopping-bag": (partial(fabrics.paper, (196, 160, 112), 43), 0.9),
        "carried-canopy": (partial(fabrics.canopy, umbrella, 44), 0.6),
        "carried-shaft": (partial(fabrics.plain, (30, 30, 32), 45), 0.4),
        "carried-phone": (partial(fabrics.plain, (14, 14, 16), 46), 0.2),
        "carried-crutches": (partial(fabrics.plain, (120, 124, 130), 47), 0.35),
        "carried-cane": (partial(fabrics.plain, (78, 48, 26), 48), 0.35),
        "carried-box": (partial(fabrics.cardboard, (176, 134, 88), 49), 0.9),
        "carried-leash": (partial(fabrics.plain, (120, 26, 26), 50), 0.7),
    }


def build(carries: str, pose: str, body: Body, posed: Posed, clothes: Points, ground: float) -> dict[str, Piece]:
    """Return all parts in the posed body's frame.

    Args:
        carries: one of `urban_street.human.stances.CARRIED` except ``own``.
        pose: one of `POSES`.
        body, posed: the body and the places of its bones.
        clothes: (V, 3) points of all clothes.
        ground: height of the ground, metres.
    """
    size = float(body.head("upperarm_l")[2] - body.head("thigh_l")[2]) / _TORSO
    pieces: dict[str, Piece] = {}
    if carries == "backpack":
        pieces["carried-backpack"] = _backpack(body, posed, clothes, size)
    elif carries == "shoulder-bag":
        pieces["carried-shoulder-bag"] = _shoulder_bag(body, posed, clothes, size)
    elif carries == "shopping-bag":
        pieces["carried-shopping-bag"] = _shopping_bag(_grip(body, posed, "l"), ground)
    elif carries == "umbrella":
        side = stances.umbrella_side(pose)
        head = _moved(posed, "head", body.tail("head"))
        pieces["carried-canopy"], pieces["carried-shaft"] = _umbrella(_grip(body, posed, side), head)
    return pieces | {part: _of_pose(part, body, posed, clothes, ground) for part in _OF_POSE.get(pose, ())}


def _of_pose(part: str, body: Body, posed: Posed, clothes: Points, ground: float) -> Piece:
    if part == "carried-phone":
        return _phone(body, posed)
    right = _grip(body, posed, "r")
    if part == "carried-crutches":
        return _joined([_crutch(body, posed, side, ground) for side in "lr"])
    if part == "carried-cane":
        foot = np.array([right[0] + 0.03, right[1] + 0.10, ground])
        hook = right + np.array([[-0.02, -0.055, -0.016], [0.0, -0.03, 0.0], [0.0, 0.02, 0.006], [0.0, 0.055, -0.004]])
        return _joined(
            [
                _tube(np.stack([*hook, right + [0.0, 0.068, -0.04]]), 0.011),
                _rod(foot, right + [0.0, 0.066, -0.03], 0.0095),
            ]
        )
    if part == "carried-box":
        return _cardboard_box(right, _grip(body, posed, "l"), clothes)
    middle = hips(posed.transforms, body)
    ring = np.array([middle[0], middle[1], ground]) + COLLAR_RING
    along = np.linspace(0.0, 1.0, 25)[:, None]
    slack = right + along * (ring - right) - np.array([0.0, 0.0, 0.30]) * along * (1.0 - along)
    hand = right + np.array([[-0.004, -0.05, -0.05], [0.0, -0.035, 0.0], [0.0, 0.0, 0.005], [0.0, 0.03, 0.0]])
    return _ribbon(np.concatenate([hand, slack[2:]]), right + [0.3, 0.0, 0.4], 0.016, 0.004)


def _crutch(body: Body, posed: Posed, side: str, ground: float) -> Piece:
    """Return an elbow crutch: a shaft below the hand, a grip, and a tube with a cuff behind the forearm."""
    grip = _grip(body, posed, side)
    outwards = 1.0 if side == "r" else -1.0
    elbow, wrist = (_moved(posed, f"{bone}_{side}", body.head(f"{bone}_{side}")) for bone in ("lowerarm", "hand"))
    foot = np.array([grip[0] + outwards * 0.04, grip[1] + 0.14, ground])
    along = normalize(elbow - wrist)
    ahead = normalize(np.array([0.0, 1.0, 0.0]) - along[1] * along)
    cuff = wrist + 0.80 * (elbow - wrist)
    neck = grip + np.array([0.0, 0.058, 0.015])
    back = cuff - 0.068 * ahead
    shaft = _tube(np.stack([foot, neck, neck + 0.25 * (back - neck) + 0.02 * along, back]), 0.0105, rounds=1)
    across = normalize(np.cross(along, ahead))
    angle = np.radians(np.linspace(-130.0, 130.0, 19))[:, None]
    ring = cuff + 0.064 * (np.sin(angle) * across - np.cos(angle) * ahead)
    return _joined(
        [
            shaft,
            _rod(foot, foot + 0.05 * normalize(grip - foot), 0.018),
            _rod(grip - [0.0, 0.055, -0.004], neck, 0.0165),
            _ribbon(ring, cuff, 0.055, 0.006),
        ]
    )


def _cardboard_box(right: Points, left: Points, clothes: Points) -> Piece:
    """Return a large box between two hands, clear of the chest. It hides the lower part of the face's view of the way."""
    middle = 0.5 * (right + left)
    wide = 0.5 * float(np.linalg.norm(right - left)) - 0.012
    half = np.array([wide, 0.72 * wide, 0.78 * wide])
    near = clothes[(np.abs(clothes[:, 0] - middle[0]) < 0.6 * wide) & (np.abs(clothes[:, 2] - middle[2]) < half[2])]
    chest = float(near[:, 1].max()) if len(near) else middle[1] - half[1]
    ahead = max(middle[1] + 0.3 * half[1], chest + half[1] + 0.01)
    return _box(np.array([middle[0], ahead, middle[2] + 0.35 * half[2]]), half)


def _tube(path: Points, radius: float, *, rounds: int = 2, sides: int = 10) -> Piece:
    """Return a round bar along a path with rounded corners."""
    even = _smooth_path(_smooth_path(path, 32, 0), 32, 2 * rounds)
    along = normalize(np.gradient(even, axis=0))
    side = normalize(np.cross(along, [0.35, 0.2, 0.0] if abs(along[0, 2]) > 0.8 else [0.0, 0.0, 1.0]))
    angle = np.arange(sides) / sides * 2.0 * np.pi
    rings = even[:, None] + radius * (
        np.cos(angle)[:, None] * side[:, None] + np.sin(angle)[:, None] * np.cross(along, side)[:, None]
    )
    ids = np.arange(rings.shape[0] * sides).reshape(-1, sides)
    faces = np.concatenate([surface.strip(ids[k], ids[k + 1])[:, ::-1] for k in range(len(ids) - 1)])
    uvs = np.stack([np.tile(angle, len(ids)), np.repeat(np.linspace(0.0, 1.0, len(ids)), sides)], axis=1)
    return _outwards(rings.reshape(-1, 3), faces, uvs)


def _moved(posed: Posed, bone: str, point: Points) -> Points:
    matrix = posed.transforms[data.rig().bones.index(bone)]
    points_there: Points = point @ matrix[:3, :3].T + matrix[:3, 3]
    return points_there


def _grip(body: Body, posed: Posed, side: str) -> Points:
    """Return the middle of the grip of a closed hand, (3,)."""
    _, palm = stances.hand_axes(body, side)
    knuckles = np.mean([body.head(f"{finger}_01_{side}") for finger in ("index", "middle", "ring", "pinky")], axis=0)
    return _moved(posed, f"hand_{side}", knuckles + 0.028 * palm)


def _trunk(body: Body, posed: Posed, clothes: Points, size: float) -> Points:
    """Return points of the clothes on the trunk, in the chest's rest frame."""
    matrix = posed.transforms[data.rig().bones.index("spine_03")]
    local = (clothes - matrix[:3, 3]) @ matrix[:3, :3]
    reach = abs(float(body.head("upperarm_l")[0])) + 0.03 * size
    keep = (np.abs(local[:, 0]) < reach) & (local[:, 2] > body.head("thigh_l")[2] - 0.1 * size)
    points: Points = local[keep]
    return points


def _around(flat: Points, start: float, end: float, count: int, off: float) -> Points:
    """Return (count, 2) places ``off`` outside the convex hull of (V, 2) points, by angle in degrees about its middle."""
    hull = ConvexHull(flat)
    corners = flat[hull.vertices]
    middle = 0.5 * (corners.min(axis=0) + corners.max(axis=0))
    angle = np.radians(np.linspace(start, end, count))
    ways = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    facing = ways @ hull.equations[:, :2].T
    distance = -(hull.equations[:, 2] + hull.equations[:, :2] @ middle)
    radius = np.where(facing > 1e-9, distance / np.maximum(facing, 1e-9), np.inf).min(axis=1)
    return np.asarray(middle + (radius + off)[:, None] * ways)


def _backpack(body: Body, posed: Posed, clothes: Points, size: float) -> Piece:
    trunk = _trunk(body, posed, clothes, size)
    shoulder = float(body.head("upperarm_l")[2])
    pieces = []
    level = shoulder - 0.17 * size
    behind = trunk[(np.abs(trunk[:, 0]) < 0.06) & (np.abs(trunk[:, 2] - level) < 0.12)][:, 1].min()
    depth, height = 0.085 * size, 0.23 * size
    centre = np.array([0.0, behind - 0.85 * depth, level - 0.02])
    pieces.append(_pillow(centre, np.array([0.15 * size, depth, height]), 0.42))
    pocket = centre + np.array([0.0, -0.75 * depth, -0.09 * size])
    pieces.append(_pillow(pocket, np.array([0.11 * size, 0.045 * size, 0.11 * size]), 0.42))
    for side in (-1.0, 1.0):
        x = side * 0.105 * size
        slab = trunk[(np.abs(trunk[:, 0] - x) < 0.03) & (np.abs(trunk[:, 2] - shoulder + 0.07 * size) < 0.15 * size)]
        over = _around(slab[:, 1:], 170.0, -35.0, 26, 0.004)
        path = np.column_stack([np.full(len(over), x), over])
        ring = trunk[np.abs(trunk[:, 2] - path[-1, 2]) < 0.035]
        start = np.degrees(np.arctan2(path[-1, 1] - ring[:, 1].mean(), x))
        flank = _around(ring[:, :2], start, start - side * 150.0, 20, 0.004)
        down = np.linspace(path[-1, 2], path[-1, 2] - 0.12 * size, len(flank))
        path = np.concatenate([path, np.column_stack([flank, down])[5:]])
        pieces.append(_ribbon(_smooth_path(path, 60, 6), trunk.mean(axis=0), 0.045 * size, 0.008))
    return _placed(posed, "spine_03", _joined(pieces))


def _shoulder_bag(body: Body, posed: Posed, clothes: Points, size: float) -> Piece:
    trunk = _trunk(body, posed, clothes, size)
    hip = float(body.head("thigh_l")[2])
    shoulder = np.array([-0.085 * size, 0.0, float(body.head("upperarm_l")[2]) + 0.05])
    side = trunk[np.abs(trunk[:, 2] - hip) < 0.06]
    rim = np.array([float(side[:, 0].max()) + 0.01, float(side[:, 1].mean()) - 0.03, hip + 0.03 * size])
    down = normalize((rim - shoulder) * np.array([1.0, 0.0, 1.0]))
    across = np.array([down[2], 0.0, -down[0]])
    slab = trunk[np.abs((trunk - shoulder) @ across) < 0.028]
    flat = np.column_stack([(slab - shoulder) @ down, slab[:, 1]])
    flat = np.concatenate([flat, [[(rim - shoulder) @ down, rim[1] + 0.05], [(rim - shoulder) @ down, rim[1] - 0.05]]])
    loop = _around(flat, 0.0, 360.0, 60, 0.004)
    path = shoulder * np.array([1.0, 0.0, 1.0]) + loop[:, :1] * down + loop[:, 1:] * np.array([0.0, 1.0, 0.0])
    half = np.array([0.045, 0.14, 0.105]) * size
    centre = rim + np.array([0.6 * half[0], 0.0, -0.75 * half[2]])
    pieces = [_pillow(centre, half, 0.35), _ribbon(path, trunk.mean(axis=0), 0.032 * size, 0.005)]
    flap = centre + np.array([0.55 * half[0], 0.0, 0.35 * half[2]])
    pieces.append(_pillow(flap, half * np.array([0.62, 1.02, 0.66]), 0.3))
    return _placed(posed, "spine_03", _joined(pieces))


def _shopping_bag(grip: Points, ground: float) -> Piece:
    tall = min(0.36, 0.62 * (float(grip[2]) - ground - 0.14))
    wide, deep = 0.42 * tall + 0.005, 0.19 * tall
    top = grip - np.array([0.0, 0.0, 0.36 * tall])
    pieces = [_box(top - np.array([0.0, 0.0, 0.5 * tall]), np.array([deep, wide, 0.5 * tall]), taper=0.94)]
    for x in (-0.9 * deep, 0.9 * deep):
        foot = 0.45 * wide
        hand = np.array([[0.25 * x, -0.03, -0.012], [0.15 * x, 0.0, -0.004], [0.25 * x, 0.03, -0.012]])
        path = np.stack([top + np.array([x, -foot, 0.0]), *(grip + hand), top + np.array([x, foot, 0.0])])
        pieces.append(_ribbon(_smooth_path(path, 24), top, 0.007, 0.005))
    return _joined(pieces)


def _umbrella(grip: Points, head: Points) -> tuple[Piece, Piece]:
    apex = np.array([0.45 * grip[0] + 0.55 * head[0], 0.4 * grip[1] + 0.6 * head[1], head[2] + 0.27])
    axis = normalize(apex - grip)
    side = normalize(np.cross(axis, [0.0, 1.0, 0.0]))
    other = np.cross(axis, side)
    shares = np.linspace(0.0, 1.0, 10)[:, None]
    angle = np.arange(64) / 64 * 2.0 * np.pi
    between = np.abs(np.sin(4.0 * angle))  # eight ribs: 0 on a rib, 1 half-way between ribs
    reach = 0.50 * np.sin(shares * 1.15) / np.sin(1.15) * (1.0 - 0.055 * between * shares**2)
    fall = -0.21 * (1.0 - np.cos(shares * 1.15)) / (1.0 - np.cos(1.15)) + 0.012 * between * shares**2
    points = (
        apex
        + reach[..., None] * (np.cos(angle)[:, None] * side + np.sin(angle)[:, None] * other)
        + np.broadcast_to(fall, reach.shape)[..., None] * axis
    )
    ids = np.arange(points.shape[0] * 64).reshape(-1, 64)
    faces = np.concatenate([surface.strip(ids[k + 1], ids[k])[:, ::-1] for k in range(len(ids) - 1)])
    faces = np.delete(faces, np.s_[64:128], axis=0)  # The first ring is one point, so half of its strip has no area.
    flat = points.reshape(-1, 3)
    uvs = np.stack([np.tile(angle / (2.0 * np.pi), len(ids)), np.repeat(shares.ravel(), 64)], axis=1)
    normals = surface.vertex_normals(flat, faces)
    if normals[64 * 3 :] @ axis @ np.ones(len(flat) - 64 * 3) < 0.0:
        faces, normals = faces[:, ::-1], -normals
    shaft = _joined(
        [
            _rod(grip - 0.10 * axis, apex + 0.07 * axis, 0.005),
            _rod(grip - 0.13 * axis, grip + 0.03 * axis, 0.012),
        ]
    )
    return (flat, normals, uvs, faces), shaft


def _phone(body: Body, posed: Posed) -> Piece:
    along, palm = stances.hand_axes(body, "r")
    knuckles = np.mean([body.head(f"{finger}_01_r") for finger in ("index", "middle", "ring", "pinky")], axis=0)
    box = _box(np.zeros(3), np.array([0.037, 0.0045, 0.077]))
    frame = np.column_stack([np.cross(palm, along), palm, along])
    centre = knuckles + 0.024 * palm + 0.03 * along
    points, normals = box[0] @ frame.T + centre, box[1] @ frame.T
    return _placed(posed, "hand_r", (points, normals, box[2], box[3]))


def _placed(posed: Posed, bone: str, piece: Piece) -> Piece:
    matrix = posed.transforms[data.rig().bones.index(bone)]
    return piece[0] @ matrix[:3, :3].T + matrix[:3, 3], piece[1] @ matrix[:3, :3].T, piece[2], piece[3]


def _pillow(centre: Points, half: Points, sharpness: float) -> Piece:
    """Return a superellipsoid: a box of cloth with round edges, rounder for a higher ``sharpness``."""

    def bent(value: Points) -> Points:
        return np.asarray(np.sign(value) * np.abs(value) ** sharpness)

    polar = np.linspace(-0.5 * np.pi, 0.5 * np.pi, 21)[:, None]
    around = np.linspace(-np.pi, np.pi, 37)[None, :]
    points = np.stack(
        [
            bent(np.cos(polar)) * bent(np.cos(around)),
            bent(np.cos(polar)) * bent(np.sin(around)),
            bent(np.sin(polar)) * np.ones_like(around),
        ],
        axis=2,
    )
    flat = centre + half * points.reshape(-1, 3)
    ids = np.arange(21 * 37).reshape(21, 37)
    quads = np.stack([ids[:-1, :-1], ids[:-1, 1:], ids[1:, 1:], ids[1:, :-1]], axis=-1).reshape(-1, 4)
    normals = surface.vertex_normals(flat, quads)
    uvs = np.stack(
        [np.tile((around.ravel() + np.pi) / (2.0 * np.pi), 21), 0.5 - np.repeat(polar.ravel(), 37) / np.pi], axis=1
    )
    return flat, normals, uvs, surface.triangles(quads)


def _box(centre: Points, half: Points, *, taper: float = 1.0) -> Piece:
    """Return a box with sharp edges whose lower face is ``taper`` times as large as its upper one."""
    points: list[Points] = []
    normals: list[Points] = []
    uvs: list[Points] = []
    faces: list[Indices] = []
    for axis in range(3):
        for sign in (-1.0, 1.0):
            u, v = (axis + 1) % 3, (axis + 2) % 3
            corners = np.zeros((4, 3))
            corners[:, axis] = sign
            corners[:, u] = np.array([-1.0, 1.0, 1.0, -1.0]) * sign
            corners[:, v] = [-1.0, -1.0, 1.0, 1.0]
            normal = np.zeros(3)
            normal[axis] = sign
            faces.append(np.array([[0, 1, 2], [0, 2, 3]]) + 4 * len(points))
            points.append(corners)
            normals.append(np.tile(normal, (4, 1)))
            uvs.append(np.array([[0.0, 1.0], [1.0, 1.0], [1.0, 0.0], [0.0, 0.0]]))
    shape = np.concatenate(points)
    shape[:, :2] *= np.where(shape[:, 2:] < 0.0, taper, 1.0)
    return centre + half * shape, np.concatenate(normals), np.concatenate(uvs), np.concatenate(faces)


def _rod(start: Points, end: Points, radius: float) -> Piece:
    axis = normalize(end - start)
    side = normalize(np.cross(axis, [0.0, 1.0, 0.3]))
    other = np.cross(axis, side)
    angle = np.arange(10) / 10 * 2.0 * np.pi
    ring = np.cos(angle)[:, None] * side + np.sin(angle)[:, None] * other
    rows = np.concatenate(
        [start + 0.3 * radius * ring, start + radius * ring, end + radius * ring, end + 0.3 * radius * ring]
    )
    ids = np.arange(40).reshape(4, 10)
    faces = np.concatenate([surface.strip(ids[k], ids[k + 1])[:, ::-1] for k in range(3)])
    return _outwards(rows, faces, np.stack([np.tile(angle, 4), np.repeat(np.linspace(0.0, 1.0, 4), 10)], axis=1))


def _ribbon(path: Points, inside: Points, width: float, thickness: float) -> Piece:
    """Return a strap of rectangular section along a path, with its flat side towards ``inside``."""
    along = normalize(np.gradient(path, axis=0))
    up = path - inside
    up = normalize(up - np.einsum("ij,ij->i", up, along)[:, None] * along)
    across = np.cross(along, up)
    section = [(-0.5, 0.0), (0.5, 0.0), (0.5, 1.0), (-0.5, 1.0)]
    rings = np.stack([path + a * width * across + b * thickness * up for a, b in section], axis=1)
    ids = np.arange(len(path) * 4).reshape(-1, 4)
    faces = np.concatenate([surface.strip(ids[k], ids[k + 1])[:, ::-1] for k in range(len(ids) - 1)])
    uvs = np.stack([np.tile([0.4, 0.6, 0.6, 0.4], len(path)), np.repeat(np.linspace(0.0, 1.0, len(path)), 4)], axis=1)
    return _outwards(rings.reshape(-1, 3), faces, uvs)


def _outwards(points: Points, faces: Indices, uvs: Points) -> Piece:
    """Return a closed tube with its faces oriented outwards and smooth normals."""
    corners = points[faces] - points.mean(axis=0)
    if np.einsum("ij,ij->i", np.cross(corners[:, 0], corners[:, 1]), corners[:, 2]).sum() < 0.0:
        faces = faces[:, ::-1]
    return points, surface.vertex_normals(points, faces), uvs, faces


def _smooth_path(path: Points, count: int, rounds: int = 2) -> Points:
    """Return ``count`` points at even distances along the path, with rounded corners."""
    for _ in range(rounds):
        path = np.concatenate([path[:1], 0.25 * path[:-2] + 0.5 * path[1:-1] + 0.25 * path[2:], path[-1:]])
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
    even = np.linspace(0.0, length[-1], count)
    return np.stack([np.interp(even, length, path[:, axis]) for axis in range(3)], axis=1)


def _joined(pieces: list[Piece]) -> Piece:
    starts = np.cumsum([0] + [len(piece[0]) for piece in pieces])
    faces: NDArray[np.int64] = np.concatenate([p[3] + start for p, start in zip(pieces, starts, strict=False)])
    return (
        np.concatenate([p[0] for p in pieces]),
        np.concatenate([p[1] for p in pieces]),
        np.concatenate([p[2] for p in pieces]),
        faces,
    )
