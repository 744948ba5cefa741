"""Figures: characters that can take stances, with meshes and textures built on first use."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from functools import cached_property, lru_cache, partial
from typing import Final, NamedTuple

import numpy as np
from cachetools import LRUCache
from numpy.typing import NDArray

from urban_street.human import (
    carried,
    clothing,
    data,
    hair,
    hats,
    outfits,
    pose,
    postures,
    shoes,
    skin,
    stances,
    surface,
    textures,
    trim,
    unwrap,
)
from urban_street.human.body import Body, shape_body
from urban_street.human.catalogue import LOOKS
from urban_street.human.riding import Contact, ride
from urban_street.human.stances import CARRIED, POSES
from urban_street.human.surface import Indices, Points
from valerie.errors import UnknownName
from valerie.scene.graph.deferred import DeferredMesh, deferred_textures
from valerie.scene.graph.model import Material, Mesh, Stance, Texture

#: Number of stances of a figure whose meshes are cached: a walk cycle, and the other poses.
_KEPT_STANCES: Final = 24
#: Height over the ground of cloth that lies on it, metres.
_LYING: Final = 0.003
_HIDDEN_MARGIN: Final = 0.04
#: A larger margin, since the view reaches further under a skirt.
_SKIRT_MARGIN: Final = 0.14


class PartShape(NamedTuple):
    """One material's part: (V, 3) positions and normals, (V, 2) texture coordinates, (F, 3) faces."""

    positions: Points
    normals: Points
    uvs: Points
    faces: Indices


class StanceKey(NamedTuple):
    """The parts of a stance that determine the shape: pose, instant of the walk, and the carried thing, never ``own``."""

    pose: str
    step: int
    carries: str


_FIRST: Final = StanceKey("walking", 0, "nothing")


@lru_cache(maxsize=len(LOOKS))
def figure(name: str) -> Figure:
    """Return the figure of a character in its default stance.

    Raises:
        UnknownName: there is no such character.
    """
    if name not in LOOKS:
        raise UnknownName("character", name, LOOKS)
    return Figure(Model(name, LOOKS[name]()), stances.DEFAULT, None)


class Figure:
    """See `valerie.scene.graph.model.Figure`.

    Args:
        model: the character, which all its figures share.
        rename: maps names of materials to other names; None to keep them.
    """

    def __init__(self, model: Model, stance: Stance, rename: Callable[[str], str] | None) -> None:
        self._model, self._stance, self._rename = model, stance, rename
        #: The meshes of all figures that differ only in their stance.
        self._meshes: dict[StanceKey, tuple[Mesh, ...]] = {}

    @property
    def stance(self) -> Stance:
        return self._stance

    @property
    def name(self) -> str:
        return self._model.name

    @property
    def materials(self) -> dict[str, Material]:
        """Return the materials of all stances, by their original names."""
        return self._model.materials

    @property
    def textures(self) -> dict[str, Texture]:
        """Return the textures of these materials."""
        return self._model.textures

    @property
    def meshes(self) -> tuple[Mesh, ...]:
        """Return one mesh per material of this stance."""
        model, key = self._model, self._key
        if key not in self._meshes:
            full = {part: f"{model.name}/{part}" for part in model.parts(key)}
            rename = self._rename or (lambda name: name)
            meshes = (DeferredMesh(partial(model.mesh, key, part), rename(name)) for part, name in full.items())
            # Another thread may have been faster; its meshes count.
            self._meshes.setdefault(key, tuple(meshes))
        return self._meshes[key]

    @cached_property
    def joints(self) -> NDArray[np.float64]:
        """See `valerie.scene.graph.model.Figure`."""
        return self._model.joints(self._key)

    def taking(self, stance: Stance) -> Figure:
        """Return the figure in another stance. Stances with equal shapes have the same meshes."""
        if stance.pose not in POSES:
            raise UnknownName("pose", stance.pose, POSES)
        if stance.carries not in CARRIED:
            raise UnknownName("thing to carry", stance.carries, CARRIED)
        figure = Figure(self._model, stance, self._rename)
        figure._meshes = self._meshes
        return figure

    def seated(self, contact: Contact) -> SeatedFigure:
        """Return the figure on a bicycle or motorcycle."""
        return SeatedFigure(self._model, contact)

    def renamed(self, rename: Callable[[str], str]) -> Figure:
        """Return the figure with materials renamed by ``rename(name)``."""
        before = self._rename
        return Figure(self._model, self._stance, rename if before is None else lambda name: rename(before(name)))

    @property
    def _key(self) -> StanceKey:
        stance = self._stance
        step = stances.gait_step(stance.gait_phase) if stance.pose in stances.GAITS else 0
        carries = self._model.look.carries if stance.carries == "own" else stance.carries
        return StanceKey(stance.pose, step, stances.kept(carries, stance.pose))


class SeatedFigure:
    """A figure on a bicycle or motorcycle, in the vehicle's frame. Everything is computed when it is first read.

    Attributes:
        meshes: one mesh per part, by the part's name (`Model.parts`).
    """

    def __init__(self, model: Model, contact: Contact) -> None:
        self._model, self._contact = model, contact
        self.meshes = {
            part: DeferredMesh(partial(self._mesh, part), f"{model.name}/{part}") for part in model.parts(_FIRST)
        }

    @cached_property
    def joints(self) -> Points:
        """See `valerie.scene.graph.model.Skeleton`."""
        posed, origin = self._posed
        return pose.joints(self._model.body, posed) - origin

    @cached_property
    def head(self) -> Points:
        """Return the (4, 4) frame of the head: origin inside the skull at brow height, axes of the rest pose."""
        posed, origin = self._posed
        head: Points = posed.transforms[data.rig().bones.index("head")].copy()
        head[:3, 3] += head[:3, :3] @ hair.head_centre(self._model.body) - origin
        return head

    def _mesh(self, part: str) -> Mesh:
        shape, name = self._shapes[part], f"{self._model.name}/{part}"
        return _mesh(shape._replace(positions=shape.positions - self._posed[1]), name)

    @cached_property
    def _posed(self) -> tuple[pose.Posed, Points]:
        """Return the posed bones, and the vehicle's origin in the body's frame, (3,)."""
        rotations, origin = ride(self._model.body, self._contact)
        return pose.pose_body(self._model.body, rotations), origin

    @cached_property
    def _shapes(self) -> dict[str, PartShape]:
        return self._model.slimmed(self._model.full_shapes(self._posed[0]))


class Model:
    """A character: its look, and everything derived from it, each built once.

    Attributes:
        name: e.g. ``black-outfit``. Names of materials and textures start with it: ``<character>/<part>``, where the parts of
            clothes start with ``cloth-``, others with ``skin-``, ``hair-``, ``shoe-`` or ``carried-``.
        look: body, clothes and colours.
        materials, textures: materials and textures by name. The images are painted on first use.
    """

    def __init__(self, name: str, look: outfits.Outfit) -> None:
        self.name, self.look = name, look
        self.materials: dict[str, Material] = {}
        self.textures: dict[str, Texture] = {}
        self._stances: LRUCache[StanceKey, dict[str, Mesh]] = LRUCache(_KEPT_STANCES)
        self._declare()

    def parts(self, key: StanceKey) -> tuple[str, ...]:
        """Return the names of the parts that a stance shows, one mesh each."""
        own = [f"cloth-{garment.name}" for garment in self.look.garments]
        own += ["skin-head", "skin-limbs", "skin-eyes", "hair-lashes"]
        if self.look.hair is not None:
            own.append("hair-head")
        if self.look.hat is not None:
            own.append("cloth-hat")
        own += ["shoe-upper", "shoe-sole"]
        return (*own, *carried.parts(key.carries, key.pose))

    def mesh(self, key: StanceKey, part: str) -> Mesh:
        """Return one part of a stance."""
        if key not in self._stances:
            self._stances[key] = {
                name: _mesh(shape, f"{self.name}/{name}") for name, shape in self._shapes(key).items()
            }
        return self._stances[key][part]

    @cached_property
    def body(self) -> Body:
        """Return the shaped body in the rest pose."""
        return shape_body(self.look.shape)

    @cached_property
    def _ground(self) -> float:
        return float(self.body.vertices[np.unique(data.base_mesh().groups["body"].quads), 2].min())

    @cached_property
    def _skin(self) -> clothing.SecondSkin:
        return clothing.second_skin(self.body)

    @cached_property
    def _patterns(self) -> list[clothing.Pattern]:
        return [clothing.cut_out(garment.cut, self.body) for garment in self.look.garments]

    @cached_property
    def pairs(self) -> dict[str, tuple[shoes.ShoePart, shoes.ShoePart]]:
        """Return upper and sole of the shoe of each side, in the rest pose."""
        return {s: shoes.build_shoe(self.look.shoe, self.body, self._skin, s, self._ground) for s in ("l", "r")}

    @cached_property
    def covered(self) -> NDArray[np.bool_]:
        """Return the mask of body vertices under clothes, (19158,), except near the clothes' edges."""
        body, weights = self.body, data.rig().weights
        hidden = np.zeros(len(body.vertices), bool)
        for garment in self.look.garments:
            margin = _SKIRT_MARGIN if garment.cut.kind == "skirt" else _HIDDEN_MARGIN
            hidden |= clothing.covered(garment.cut, body, body.vertices, weights, margin)
        return hidden

    @cached_property
    def _bare_parts(self) -> tuple[skin.SkinPart, skin.SkinPart]:
        body, weights = self.body, data.rig().weights
        hidden = self.covered.copy()
        in_shoe = clothing.share(weights, ("foot", "ball", "calf")) > 0.5
        hidden |= in_shoe & (body.vertices[:, 2] < self._ground + self.look.shoe.height - 0.012)
        return skin.bare_parts(body, hidden)

    @cached_property
    def _first(self) -> dict[str, PartShape]:
        return self.full_shapes(self.posed(_FIRST))

    @cached_property
    def _slim(self) -> dict[str, surface.Mapped]:
        """Return the simplification of each part, computed at the first instant of the walk and used for all stances."""
        full = self._first
        keep = {"skin-head": 0.62, "skin-limbs": 0.62, "shoe-upper": 0.75}
        simplified = {}
        for part, shape in full.items():
            share = 0.72 if part.startswith("cloth-") and part != "cloth-hat" else keep.get(part, 1.0)
            simplified[part] = surface.simplify(shape.positions, shape.faces, int(share * len(shape.faces)))
        return simplified

    def _shapes(self, key: StanceKey) -> dict[str, PartShape]:
        first = key._replace(carries="nothing") == _FIRST and not carried.takes_a_hand(key.carries)
        posed, origin = self.placed(key)
        full = self._first if first else self.full_shapes(posed)
        shapes = self.slimmed(full)
        ground = origin[2]
        clothes = np.concatenate([shape.positions for part, shape in full.items() if part.startswith("cloth-")])
        for part, thing in carried.build(key.carries, key.pose, self.body, posed, clothes, float(ground)).items():
            shapes[part] = PartShape(*thing)
        if key.pose in postures.LOW:
            shapes |= {part: _above(ground, shapes[part]) for part in shapes if part.startswith("cloth-")}
        return {part: shape._replace(positions=shape.positions - origin) for part, shape in shapes.items()}

    def joints(self, key: StanceKey) -> Points:
        """Return the joints in a stance, in the frame of its meshes, (len(JOINTS), 3)."""
        posed, origin = self.placed(key)
        return pose.joints(self.body, posed) - origin

    def slimmed(self, full: Mapping[str, PartShape]) -> dict[str, PartShape]:
        """Return parts from `full_shapes` with fewer triangles, the same ones in every stance."""
        slim = self._slim
        return {
            part: PartShape(
                slim[part].matrix @ shape.positions,
                slim[part].matrix @ shape.normals,
                slim[part].matrix @ shape.uvs,
                slim[part].faces,
            )
            for part, shape in full.items()
        }

    def posed(self, key: StanceKey) -> pose.Posed:
        """Return the posed bones in a stance."""
        return self.placed(key)[0]

    def placed(self, key: StanceKey) -> tuple[pose.Posed, Points]:
        """Return the posed bones in a stance, and the origin of its meshes in the body's frame, (3,).

        The origin is on the ground: between the soles, or below the hips of a body that is low or holds something.
        """
        body, gait = self.body, self.look.gait
        soles = {side: (pair[1].points, pair[1].weights) for side, pair in self.pairs.items()}
        if key.pose in postures.LOW:
            rotations, origin = postures.take(body, postures.LOW[key.pose], soles)
            return pose.pose_body(body, rotations), origin
        rotations = stances.rotations(body, gait, key.pose, key.step, key.carries)
        rotations = stances.feet_on_ground(body, rotations, gait, key.pose, key.step, soles)
        posed = pose.pose_body(body, rotations)
        feet = [posed.apply(*sole) for sole in soles.values()]
        middle = np.mean([sole.mean(axis=0) for sole in feet], axis=0)
        origin = np.array([middle[0], middle[1], np.concatenate(feet)[:, 2].min()])
        if key.pose in postures.HOLDING:
            origin[:2] = postures.hips(posed.transforms, body)[:2]
            rotations |= postures.reach(
                body, rotations, postures.HOLDING[key.pose], origin, postures.leg_length(body, soles)
            )
            posed = pose.pose_body(body, rotations)
        return posed, origin

    def dressed(self, posed: pose.Posed) -> tuple[clothing.Cloth, ...]:
        """Return the settled garments on the posed body, without collars and hems."""
        cloths: list[clothing.Cloth] = []
        for garment, pattern in zip(self.look.garments, self._patterns, strict=True):
            cloths.append(clothing.put_on(garment.cut, pattern, self._skin, posed, tuple(cloths)))
        return tuple(cloths)

    def full_shapes(self, posed: pose.Posed) -> dict[str, PartShape]:
        """Return all parts, not simplified, in the body's frame."""
        shapes = dict(self._dressed(posed))
        shapes |= self._bare(posed)
        shapes |= self._on_head(posed)
        for index, part in enumerate(("shoe-upper", "shoe-sole")):
            pieces = []
            for pair in self.pairs.values():
                points = posed.apply(pair[index].points, pair[index].weights)
                pieces.append(
                    PartShape(
                        points, surface.vertex_normals(points, pair[index].faces), pair[index].uvs, pair[index].faces
                    )
                )
            shapes[part] = _joined(pieces)
        return shapes

    def _dressed(self, posed: pose.Posed) -> Iterator[tuple[str, PartShape]]:
        for garment, settled in zip(self.look.garments, self.dressed(posed), strict=True):
            collar = garment.collar
            collared = settled if collar is None else trim.add_collar(settled, collar, self.body, posed)
            cloth = trim.add_hems(collared, garment.thickness)
            old, uvs, faces = unwrap.unwrap(garment.cut, self.body, cloth)
            normals = surface.vertex_normals(cloth.points, cloth.faces)
            yield f"cloth-{garment.name}", PartShape(cloth.points[old], normals[old], uvs, faces)

    def _bare(self, posed: pose.Posed) -> dict[str, PartShape]:
        body = self.body
        points = posed.apply(body.vertices, data.rig().weights)
        normals = surface.vertex_normals(points, data.base_mesh().groups["body"].quads)
        head, limbs = self._bare_parts
        shapes = {
            name: PartShape(points[part.vertices], normals[part.vertices], part.uvs, part.faces)
            for part, name in ((head, "skin-head"), (limbs, "skin-limbs"))
        }
        small = {
            "skin-eyes": [skin.eye_part(body, side) for side in ("l", "r")],
            "hair-lashes": [skin.lash_part(side) for side in ("l", "r")],
        }
        for name, pieces in small.items():
            shapes[name] = _joined(
                [
                    PartShape(points[p.vertices], surface.vertex_normals(points[p.vertices], p.faces), p.uvs, p.faces)
                    for p in pieces
                ]
            )
        return shapes

    def _on_head(self, posed: pose.Posed) -> Iterator[tuple[str, PartShape]]:
        turn, chest = (posed.transforms[data.rig().bones.index(bone)] for bone in ("head", "spine_03"))
        pieces: dict[str, hair.Hair] = {}
        if self.look.hair is not None:
            pieces["hair-head"] = hair.build_hair(self.look.hair, self.body, self.look.seed)
        if self.look.hat is not None:
            pieces["cloth-hat"] = hats.build_hat(self.look.hat, self.body)
        for part, piece in pieces.items():
            points = piece.points @ turn[:3, :3].T + turn[:3, 3]
            if piece.chest is not None:
                points += piece.chest[:, None] * (piece.points @ chest[:3, :3].T + chest[:3, 3] - points)
            normals = surface.vertex_normals(points, piece.faces)
            old, uvs, faces = surface.unweld(piece.faces, piece.uvs[piece.faces])
            yield part, PartShape(points[old], normals[old], uvs, faces)

    def _declare(self) -> None:
        look = self.look
        for garment in look.garments:
            self._painted(
                f"cloth-{garment.name}", garment.texture, garment.roughness, garment.specular, double_sided=True
            )
        self._painted(
            "skin-head", lambda: skin.paint_head(look.face, self.body, look.seed), 0.5, 0.8, double_sided=True
        )
        self._painted("skin-limbs", lambda: skin.paint_limbs(look.face, look.seed), 0.55, 0.8)
        self._painted("skin-eyes", lambda: textures.eye(look.face.iris, look.seed), 0.12, 1.0)
        self._plain("hair-lashes", (0.012, 0.009, 0.007), 0.8, double_sided=True)
        if look.hair is not None:
            self._painted(
                "hair-head", lambda: textures.strands(look.hair_colour, look.seed), 0.5, 0.8, double_sided=True
            )
        if look.hat is not None:
            self._painted("cloth-hat", look.hat.texture, 0.9, 0.5, double_sided=True)
        self._painted("shoe-upper", look.shoe_texture, look.shoe_roughness, 1.0, double_sided=True)
        self._plain("shoe-sole", look.sole, 0.85)
        for part, (texture, roughness) in carried.paints(look.bag_colour, look.umbrella_colour).items():
            self._painted(part, texture, roughness, 0.9, double_sided=True)

    def _plain(
        self, part: str, colour: tuple[float, float, float], roughness: float, *, double_sided: bool = False
    ) -> None:
        full = f"{self.name}/{part}"
        self.materials[full] = Material(full, base_color=colour, roughness=roughness, double_sided=double_sided)

    def _painted(
        self,
        part: str,
        canvas: Callable[[], textures.TextureCanvas],
        roughness: float,
        specular: float,
        *,
        double_sided: bool = False,
    ) -> None:
        full = f"{self.name}/{part}"
        self.textures |= deferred_textures((f"{full}-color", f"{full}-normal"), lambda: canvas().images())
        self.materials[full] = Material(
            full,
            base_color=(1.0, 1.0, 1.0),
            base_color_texture=f"{full}-color",
            normal_texture=f"{full}-normal",
            roughness=roughness,
            specular=specular,
            double_sided=double_sided,
        )


def _joined(pieces: list[PartShape]) -> PartShape:
    starts = np.cumsum([0] + [len(piece.positions) for piece in pieces])
    faces = np.concatenate([piece.faces + start for piece, start in zip(pieces, starts, strict=False)])
    return PartShape(
        np.concatenate([piece.positions for piece in pieces]),
        np.concatenate([piece.normals for piece in pieces]),
        np.concatenate([piece.uvs for piece in pieces]),
        faces,
    )


def _above(ground: float, shape: PartShape) -> PartShape:
    """Return cloth that lies on the ground instead of hanging through it."""
    return shape._replace(positions=np.maximum(shape.positions, [-np.inf, -np.inf, ground + _LYING]))


def _mesh(shape: PartShape, material: str) -> Mesh:
    return Mesh(
        positions=shape.positions.astype(np.float32),
        normals=surface.normalize(shape.normals).astype(np.float32),
        uvs=shape.uvs.astype(np.float32),
        faces=shape.faces.astype(np.uint32),
        material=material,
    )
