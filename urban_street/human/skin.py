"""Bare parts of a body: head with painted face, limbs, eyes."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.spatial import cKDTree

from urban_street.human import data, hair, surface, textures
from urban_street.human.body import Body
from urban_street.human.surface import Indices, Points

#: Height of the head's texture, metres.
_HEAD_SPAN: Final = 0.40
_HEAD_ABOVE: Final = 0.16


@dataclass(frozen=True, slots=True)
class Face:
    """The colours of skin and face, sRGB.

    Attributes:
        skin, lips, brows, iris, scalp: colours. The scalp's shows through thin hair and above the hairline.
        beard: 0 none … 1 dark stubble.
        brow_height: thickness of the brows, metres.
        hairline: hairline of the scalp's colour, see `hair.HairCut.hairline`.
    """

    skin: textures.Colour
    lips: textures.Colour
    brows: textures.Colour
    iris: textures.Colour
    scalp: textures.Colour
    beard: float = 0.0
    brow_height: float = 0.007
    hairline: dict[float, float] | None = None


@dataclass(frozen=True, slots=True, eq=False)
class SkinPart:
    """A part of the bare body: (V,) base-mesh vertex of each vertex, (V, 2) uvs (v down), (F, 3) faces."""

    vertices: Indices
    uvs: Points
    faces: Indices


def bare_parts(body: Body, hidden: NDArray[np.bool_]) -> tuple[SkinPart, SkinPart]:
    """Return head with neck, and limbs, of the body, without faces whose vertices are all ``hidden``, (19158,)."""
    mesh, rig = data.base_mesh(), data.rig()
    quads, uvs = _outside()
    keep = ~hidden[quads].all(axis=1)
    quads, uvs = quads[keep], uvs[keep]
    of_head = rig.weights[:, [rig.bones.index("head"), rig.bones.index("neck_01")]].sum(axis=1)
    trunk = of_head + rig.weights[:, [b.startswith(("spine", "clavicle")) for b in rig.bones]].sum(axis=1)
    upper = trunk[quads].mean(axis=1) > 0.5
    head_faces = surface.triangles(quads[upper])
    head = surface.unweld(head_faces, _head_uvs(body, body.vertices)[head_faces])
    corners = np.concatenate([np.stack([quads, uvs], axis=2)[~upper][:, k] for k in ((0, 1, 2), (0, 2, 3))])
    coordinates = mesh.uvs[corners[..., 1]] * [1.0, -1.0] + [0.0, 1.0]
    limbs = surface.unweld(corners[..., 0], coordinates, wraps=False)
    return SkinPart(*head), SkinPart(*limbs)


def eye_part(body: Body, side: str) -> SkinPart:
    """Return one eyeball with its texture projected from the front."""
    faces = surface.triangles(data.base_mesh().groups[f"helper-{side}-eye"].quads)
    vertices = np.unique(faces)
    centre, radius = _sphere(body.vertices[vertices])
    offset = (body.vertices - centre) / (2.0 * radius)
    uvs = np.stack([0.5 + offset[:, 0], 0.5 - offset[:, 2]], axis=1)
    return SkinPart(*surface.unweld(faces, uvs[faces], wraps=False))


def lash_part(side: str) -> SkinPart:
    """Return the upper eyelashes of one eye."""
    faces = surface.triangles(data.base_mesh().groups[f"helper-{side}-eyelashes-1"].quads)
    return SkinPart(*surface.unweld(faces, np.zeros((*faces.shape, 2)), wraps=False))


def paint_head(face: Face, body: Body, seed: int) -> textures.TextureCanvas:
    """Paint the texture of head and neck; u runs around (0.5 in front), v down from above the crown."""
    canvas = textures.skin(face.skin, seed)
    random = np.random.default_rng(seed + 1)
    u, v = textures.grid()
    angle, height = _metres(body, u, v)
    eyes = _joint(body, "joint-l-eye")
    mouth = _joint(body, "joint-mouth")
    centre = hair.head_centre(body)
    depth = float(np.linalg.norm((eyes - centre)[:2])) + 0.012  # radius that converts angles to metres on the face
    across = np.abs(angle) * depth
    eye_across = abs(float(np.arctan2(eyes[0], eyes[1] - centre[1]))) * depth
    # warm cheeks and nose, cool sockets
    cheek = textures.line(across - 0.042, 0.020) * textures.line(height - (eyes[2] - 0.045), 0.020)
    nose = textures.line(across, 0.014) * textures.line(height - (eyes[2] - 0.045), 0.012)
    canvas.colour *= 1.0 - np.clip(0.5 * cheek + 0.5 * nose, 0, 1)[..., None] * np.array([0.02, 0.13, 0.12])
    socket = textures.line(across - eye_across, 0.017) * textures.line(height - (eyes[2] + 0.002), 0.011)
    canvas.shade(1.0 - 0.20 * socket)
    lips = _mask_on_head(body, "lips")
    canvas.paint(face.lips, 0.85 * lips)
    if face.beard > 0.0:
        chin = np.clip((mouth[2] + 0.025 - height) / 0.012, 0, 1) * np.clip((height - mouth[2] + 0.085) / 0.02, 0, 1)
        jaw = chin * np.clip((0.115 - across) / 0.03, 0.0, 1.0) * (1.0 - lips)
        speckle = 0.7 + 0.3 * textures.noise(random, (0.7, 0.7))
        canvas.paint(face.scalp, 0.5 * face.beard * jaw * speckle)
    _paint_brows(canvas, face, across, height, eye_across, float(eyes[2]), random)
    if face.hairline is not None:
        degrees = np.degrees(np.abs(angle))
        line = np.interp(degrees, list(face.hairline), list(face.hairline.values()))
        elevation = np.degrees(np.arctan2(height - centre[2], 0.092))
        ragged = textures.noise(random, (6.0, 0.8))
        canvas.paint(face.scalp, 0.92 * np.clip((elevation - line + 2.0 + 1.5 * ragged) / 4.0, 0.0, 1.0))
    return canvas


def paint_limbs(face: Face, seed: int) -> textures.TextureCanvas:
    """Paint the texture of hands and arms in MakeHuman's own layout, with nails."""
    canvas = textures.skin(face.skin, seed)
    nails = ndimage.zoom(data.mask("fingernails").astype(np.float64) / 255.0, textures.SIZE / 2048.0, order=1)
    canvas.paint((232, 190, 180), 0.7 * nails)
    return canvas


def _paint_brows(
    canvas: textures.TextureCanvas,
    face: Face,
    across: Points,
    height: Points,
    eye_across: float,
    eye_height: float,
    random: np.random.Generator,
) -> None:
    place = (across - eye_across) / 0.024  # −1 at the nose … 1 at the temple
    middle = eye_height + 0.0215 + 0.0042 * np.clip(place + 0.2, -1.0, 0.5) - 0.007 * np.clip(place - 0.4, 0.0, 1.0)
    width = face.brow_height * np.clip(0.62 - 0.34 * place, 0.2, 0.75)
    cover = np.exp(-(((height - middle) / width) ** 2)) * np.clip((1.05 - np.abs(place)) / 0.12, 0.0, 1.0)
    canvas.paint(face.brows, 0.92 * cover * np.clip(0.85 + 0.25 * textures.noise(random, (0.8, 0.6)), 0.3, 1.0))


def _head_uvs(body: Body, points: Points) -> Points:
    centre = hair.head_centre(body)
    offset = points - centre
    angle = np.arctan2(offset[:, 0], offset[:, 1])  # 0 in front, grows to the character's right
    return np.stack([0.5 + angle / (2.0 * np.pi), (_HEAD_ABOVE - offset[:, 2]) / _HEAD_SPAN], axis=1)


def _metres(body: Body, u: Points, v: Points) -> tuple[Points, Points]:
    """Return azimuth in radians and height in metres of texels."""
    centre = hair.head_centre(body)
    return (u - 0.5) * 2.0 * np.pi, centre[2] + _HEAD_ABOVE - v * _HEAD_SPAN


def _mask_on_head(body: Body, name: str) -> Points:
    """Return one of MakeHuman's skin masks, mapped from its texture layout to the head's, (SIZE, SIZE) in 0…1."""
    mesh = data.base_mesh()
    quads, quad_uvs = _outside()
    rig = data.rig()
    of_head = rig.weights[quads[:, 0], rig.bones.index("head")] > 0.5
    corners, coordinates = quads[of_head].ravel(), mesh.uvs[quad_uvs[of_head].ravel()]
    corners, first = np.unique(corners, return_index=True)
    mask = data.mask(name)
    texel = (coordinates[first] * [1.0, -1.0] + [0.0, 1.0]) * mask.shape[0]
    row, column = np.clip(texel[:, ::-1].astype(int), 0, mask.shape[0] - 1).T
    # Only the front counts, since the mouth's inside shares the azimuths of the lips.
    places = _head_uvs(body, body.vertices[corners])
    front = body.vertices[corners, 1] > hair.head_centre(body)[1] + 0.05
    u, v = textures.grid()
    window = slice(None), slice(textures.SIZE // 4, 3 * textures.SIZE // 4)
    distance, nearest = cKDTree(places[front]).query(np.stack([u[window], v[window]], axis=-1), k=4)
    share: Points = 1.0 / (np.asarray(distance) + 1e-4) ** 2
    values = np.zeros_like(u)
    values[window] = (share * mask[row, column][front][nearest] / 255.0).sum(axis=-1) / share.sum(axis=-1)
    return np.asarray(ndimage.gaussian_filter(values, 0.8))


@lru_cache(maxsize=1)
def _outside() -> tuple[Indices, Indices]:
    """Return the body's quads that are visible from outside (without the inside of the mouth), and their texture indices."""
    mesh = data.base_mesh()
    group = mesh.groups["body"]
    mask = data.mask("inside-mouth")
    texel = (mesh.uvs[group.quad_uvs].mean(axis=1) * [1.0, -1.0] + [0.0, 1.0]) * mask.shape[0]
    row, column = np.clip(texel[:, ::-1].astype(int), 0, mask.shape[0] - 1).T
    # The lips' inner rim remains, since it is visible between open lips.
    keep = ndimage.minimum_filter(mask[::4, ::4], 9)[row // 4, column // 4] < 128
    return group.quads[keep], group.quad_uvs[keep]


def _joint(body: Body, name: str) -> Points:
    joint: Points = body.vertices[np.unique(data.base_mesh().groups[name].quads)].mean(axis=0)
    return joint


def _sphere(points: Points) -> tuple[Points, float]:
    """Return least-squares centre and radius of points on a sphere."""
    matrix = np.column_stack([2.0 * points, np.ones(len(points))])
    solution = np.linalg.lstsq(matrix, (points**2).sum(axis=1), rcond=None)[0]
    centre = solution[:3]
    return centre, float(np.sqrt(solution[3] + centre @ centre))
