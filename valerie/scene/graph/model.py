"""The scene: an immutable value, independent of any engine.

Frames (docs/conventions.md): right-handed world in metres, z up, x to the right, y ahead. A camera looks along
its own −z with y up (as in glTF). Transforms are 4×4 float64, column vectors, object to parent.

A `Scene` is one concrete variant: `valerie.scene.variation.variant.apply` builds it from an asset and an assignment. Meshes,
materials, textures and unchanged nodes are shared by identity between scenes of one asset, so an engine may cache its uploads
by identity.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any, Final, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from valerie.scene.graph.paints import Paint

Matrix = NDArray[np.float64]


Array = TypeVar("Array", bound=NDArray[Any])


def freeze(array: Array) -> Array:
    """Mark an array read-only and return it."""
    array.setflags(write=False)
    return array


@dataclass(frozen=True, slots=True, eq=False)
class Texture:
    """An image that materials refer to by name.

    Attributes:
        image: (H, W, 3) or (H, W, 4) uint8, first row at the top (v = 0, as in glTF); sRGB for colour, linear for data.
    """

    name: str
    image: NDArray[np.uint8]


#: `Material.translucency` of double-sided sheets that state none: cloth, paper.
TRANSLUCENCY: Final = 0.18


#: Cells along each edge of `Rooms`.
ROOM_CELLS: Final = 4


@dataclass(frozen=True, slots=True)
class Rooms:
    """The rooms behind panes: `ROOM_CELLS`² different ones. Lamps light some of them while the street lamps are on.

    The texture coordinates of a pane fill a cell but for a margin of 2 % and choose its room. The middle of the pane is the
    middle of the room's width. The ceiling is 0.35 m above the pane. The floor is at its lower edge, but at least 2.3 m below
    its upper edge.

    The texture's quarters have a cell for each room. Above, they show the rooms by day, as the reflectance of the pane, and by
    lamps; alpha by lamps is 1 if lamps light the room, else 0. A picture is taken from one depth of the room in front of the
    pane, and the room's front fills the cell but for the margin. Below, they show what hangs at the pane by day and by lamps,
    with its opacity in alpha.

    Attributes:
        texture: name of the texture.
        width: width of a room, metres, but at least one and a half panes.
        depth: metres.
        luminance: luminance of white by lamps, cd/m².
    """

    texture: str
    width: float
    depth: float
    luminance: float


@dataclass(frozen=True, slots=True)
class Material:
    """Metallic-roughness appearance (glTF 2.0 section 3.9), with Blender's specular tint.

    Attributes:
        base_color: linear RGB factor in [0, 1].
        base_color_texture: texture name, multiplied with ``base_color`` after sRGB decoding.
        normal_texture: tangent-space normals, linear.
        roughness_texture: linear; its green channel is multiplied with ``roughness``, its blue one with ``metallic``
            (glTF's metallicRoughnessTexture). Red is not read.
        metallic, roughness: in [0, 1].
        specular: reflectance at normal incidence relative to 4 % (1 = 0.04), in [0, 2].
        specular_tint: in [0, 1]: 0 for white highlights, 1 for highlights in the base colour.
        emissive: linear RGB radiance.
        signal: True for coloured lamps such as tail lamps; in the dark, pictures show them darker, but in their hue.
        alpha_cutoff: None for opaque; else texels with alpha below it are cut, never blended, so that labels stay exact.
        double_sided: draw back faces too, with the normal turned to the viewer.
        transmission: share of light that passes straight through a thin pane such as glass, in [0, 1]. Labels and depth are the
            pane's. Engines without transmission draw it opaque.
        traffic: share of the lying snow and leaves that wheels or feet remove where they have polished the surface, in [0, 1].
        soaks: share of the rain that sinks in, in [0, 1]: 0 for sealed ground, which mirrors, 1 for soil and grass.
        rooms: what a pane shows behind it; None for nothing. Engines without rooms show the base colour.
        translucency: share of the light scattered by a thin sheet that leaves it on the other side, in the sheet's colour. None
            for that of paper and cloth if the sheet is double-sided, else 0.
    """

    name: str
    base_color: tuple[float, float, float] = (0.8, 0.8, 0.8)
    base_color_texture: str | None = None
    normal_texture: str | None = None
    roughness_texture: str | None = None
    metallic: float = 0.0
    roughness: float = 0.8
    specular: float = 1.0
    specular_tint: float = 0.0
    emissive: tuple[float, float, float] = (0.0, 0.0, 0.0)
    alpha_cutoff: float | None = None
    double_sided: bool = False
    transmission: float = 0.0
    traffic: float = 0.0
    soaks: float = 0.0
    rooms: Rooms | None = None
    signal: bool = False
    translucency: float | None = None

    @property
    def light_through(self) -> float:
        """Return the translucency of its sheet."""
        if self.translucency is not None:
            return self.translucency
        return TRANSLUCENCY if self.double_sided else 0.0

    @property
    def textures(self) -> tuple[str, ...]:
        """Return the names of its textures."""
        rooms = self.rooms.texture if self.rooms is not None else None
        names = (self.base_color_texture, self.normal_texture, self.roughness_texture, rooms)
        return tuple(name for name in names if name is not None)

    def with_textures(self, named: Callable[[str], str]) -> Material:
        """Return the material with other names for its textures."""

        def new(name: str | None) -> str | None:
            return None if name is None else named(name)

        return replace(
            self,
            base_color_texture=new(self.base_color_texture),
            normal_texture=new(self.normal_texture),
            roughness_texture=new(self.roughness_texture),
            rooms=None if self.rooms is None else replace(self.rooms, texture=named(self.rooms.texture)),
        )


@dataclass(frozen=True, slots=True, eq=False)
class Mesh:
    """Triangles of one material, in object coordinates.

    Attributes:
        positions: (V, 3) float32, metres.
        normals: (V, 3) float32, unit length.
        uvs: (V, 2) float32; v grows downwards in the texture, as in glTF.
        faces: (F, 3) uint32, counter-clockwise seen from outside.
        material: name of a material of the scene.
    """

    positions: NDArray[np.float32]
    normals: NDArray[np.float32]
    uvs: NDArray[np.float32]
    faces: NDArray[np.uint32]
    material: str

    def __post_init__(self) -> None:
        for array in (self.positions, self.normals, self.uvs, self.faces):
            freeze(array)

    def with_material(self, name: str) -> Mesh:
        """Return the same triangles with another material. The arrays are shared."""
        return replace(self, material=name)


@dataclass(frozen=True, slots=True)
class Stance:
    """A figure's pose and what it carries. The asset names the poses and the things to carry.

    Attributes:
        pose: the name of a pose of the figure.
        gait_phase: phase of a walking pose in the cycle of two steps, 0…1, relative to the figure's own start.
        carries: the name of a thing that the figure can carry.
    """

    pose: str
    gait_phase: float
    carries: str


#: The joints of a figure. Left and right are the figure's own. ``head`` is the joint of skull and neck, ``toes`` the ball of
#: the foot.
JOINTS: Final = (
    "pelvis", "spine", "chest", "neck", "head", "head_top", "left_eye", "right_eye",
    "left_shoulder", "right_shoulder", "left_elbow", "right_elbow", "left_wrist", "right_wrist",
    "left_hip", "right_hip", "left_knee", "right_knee", "left_ankle", "right_ankle", "left_toes", "right_toes",
)  # fmt: skip


class Skeleton(Protocol):
    """The joints of a human body."""

    @property
    def joints(self) -> NDArray[np.float64]:
        """Return the positions of `JOINTS`: (len(JOINTS), 3) metres in the node's frame."""
        ...


class Figure(Skeleton, Protocol):
    """A body that can take several stances. Its node has the meshes and the joints of the current stance."""

    @property
    def stance(self) -> Stance: ...

    @property
    def meshes(self) -> tuple[Mesh, ...]:
        """Return the meshes of this stance: the same objects each time, whose arrays are computed when first read."""
        ...

    def taking(self, stance: Stance) -> Figure:
        """Return the figure in another stance.

        Raises:
            UnknownName: the figure has no such pose, or no such thing to carry.
        """
        ...

    def renamed(self, rename: Callable[[str], str]) -> Figure:
        """Return the figure with other names for its materials."""
        ...


@dataclass(frozen=True, slots=True)
class Light:
    """A lamp at its node's origin that shines along the node's +y, a vehicle's forward direction.

    Light falls with the square of the distance. Across the beam, it is full within ``inner`` and zero beyond ``outer``. Between
    them it follows the square of a linear function of the cosine (glTF's KHR_lights_punctual). A dipped beam is dark above a
    cut-off through the axis, level with the node's x (`valerie.rendering.beams`).

    Attributes:
        color: linear RGB, relative: it is scaled to luminance 1.
        intensity: candela along the axis; for a dipped beam, in its brightest direction.
        inner, outer: radians from the axis; a lamp with ``outer`` π shines in all directions.
        beam: one of `BEAMS`.
        radius: radius of the luminous surface, metres.
        switch: the switch of `Environment` that turns it on, a key of `SWITCHES`; empty if it is always on.
        glowing: names of the materials that glow while it is on.
        luminance: luminance of these materials, cd/m².
    """

    color: tuple[float, float, float] = (1.0, 1.0, 1.0)
    intensity: float = 100.0
    inner: float = 0.0
    outer: float = math.pi
    beam: str = "cone"
    radius: float = 0.05
    switch: str = ""
    glowing: tuple[str, ...] = ()
    luminance: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class Node:
    """A named object in the scene graph.

    Attributes:
        path: dotted path from the root, e.g. ``scene.car-3.door-1``; its last part is ``class-instance`` or a plain name.
        transform: (4, 4), object to parent.
        meshes: drawn with this node's world transform.
        label_id: Cityscapes label id, inherited from the object. A bag has the label of the person who carries it.
        instance_id: label id × 1000 + n, or 0 for classes without instances.
        movable: True if it belongs to the movable layer instead of the background. The manifest declares it; it is inherited.
        visible: False if neither the node nor anything below it is drawn, as for an absent person.
        figure: the source of ``meshes`` if the node can take several stances.
        skeleton: the joints of a body with a fixed pose, such as a rider; None for a figure and for nodes without a body.
        light: a lamp at the node's origin.
    """

    path: str
    transform: Matrix
    meshes: tuple[Mesh, ...] = ()
    label_id: int = 0
    instance_id: int = 0
    movable: bool = False
    visible: bool = True
    figure: Figure | None = None
    skeleton: Skeleton | None = None
    light: Light | None = None

    @property
    def name(self) -> str:
        return self.path.rpartition(".")[2]

    @property
    def parent(self) -> str:
        return self.path.rpartition(".")[0]


@dataclass(frozen=True, slots=True, eq=False)
class Camera:
    """A pinhole camera.

    Attributes:
        path: e.g. ``scene.camera-1``.
        transform: (4, 4), camera to world. The camera looks along −z with y up.
        focal_length_mm, sensor_width_mm: the horizontal field of view is 2·atan(sensor_width / (2·focal_length)).
        near, far: clipping distances in metres.
    """

    path: str
    transform: Matrix
    focal_length_mm: float
    sensor_width_mm: float = 36.0
    near: float = 0.1
    far: float = 600.0

    @property
    def name(self) -> str:
        return self.path.rpartition(".")[2]

    @property
    def position(self) -> NDArray[np.float64]:
        """Return the optical centre: (3,) metres, world."""
        return np.asarray(self.transform[:3, 3], np.float64)

    def focal_length_px(self, width: int) -> float:
        """Return the focal length in pixels for an image ``width`` square pixels wide."""
        return self.focal_length_mm / self.sensor_width_mm * width


@dataclass(frozen=True, slots=True)
class Sun:
    """A directional light with a disc.

    Attributes:
        azimuth: radians clockwise from north, seen from above. `Environment` has the bearing.
        elevation: radians above the horizon.
        irradiance: irradiance of a surface that faces the sun, in scene units: 1 is a clear noon, for which the default
            exposure is made.
        angular_diameter: radians; determines the softness of shadows.
    """

    azimuth: float
    elevation: float
    irradiance: float = 1.0
    angular_diameter: float = math.radians(0.53)


#: Beams of lamps: evenly filled cones, and the dipped beams of vehicles.
BEAMS: Final = ("cone", "dipped")
#: Switches of lamps, and the illuminance of the ground, lux, below which ``auto`` turns each on. Street lamps: the usual
#: twilight switch. Vehicles: UN Regulation 48, annex 12 (dipped beam on below 1,000 lx).
SWITCHES: Final = MappingProxyType({"street": 50.0, "car": 1000.0})
#: Positions of a switch.
POSITIONS: Final = ("auto", "on", "off")

#: Visibility, metres, that stands for no fog: only turbidity then describes the air.
CLEAR_VISIBILITY_M: Final = 100_000.0


@dataclass(frozen=True, slots=True)
class Environment:
    """Light and weather.

    Attributes:
        bearing: compass bearing of the world's +y, radians clockwise from north.
        turbidity: haze of the analytic sky, 2 (clear) … 10 (hazy).
        sky_strength: factor of the sky's radiance.
        cloud_cover: share of the sky under cloud, 0 (clear) … 1 (overcast: no sun, no shadows).
        visibility: metres at which a black object keeps 2 % of its contrast in fog (Koschmieder); `CLEAR_VISIBILITY_M`: no fog.
        rain: mm/h. It wets surfaces that face up, and adds extinction and drops in the air.
        snowfall: mm/h of water. It adds extinction and flakes in the air.
        snow_depth: metres of snow that lie on static surfaces that face up.
        leaf_litter: share of level static surfaces that fallen leaves cover, 0…1.
        street_lamps, car_lamps: ``on``, ``off``, or ``auto``: on when it is dark, see `SWITCHES`.
    """

    bearing: float = 0.0
    turbidity: float = 3.0
    sky_strength: float = 1.0
    cloud_cover: float = 0.0
    visibility: float = CLEAR_VISIBILITY_M
    rain: float = 0.0
    snowfall: float = 0.0
    snow_depth: float = 0.0
    leaf_litter: float = 0.0
    street_lamps: str = "auto"
    car_lamps: str = "auto"


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Scene:
    """One concrete variant of an asset.

    Attributes:
        nodes: path to node, parents before children; the root is ``scene``.
        materials, textures: materials and textures by name.
        cameras: by camera name, e.g. ``camera-1``.
        paints: paints of vehicles by name.
    """

    nodes: Mapping[str, Node]
    materials: Mapping[str, Material]
    textures: Mapping[str, Texture]
    cameras: Mapping[str, Camera]
    sun: Sun
    environment: Environment = field(default_factory=Environment)
    paints: Mapping[str, Paint] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name in ("nodes", "materials", "textures", "cameras", "paints"):
            object.__setattr__(self, name, MappingProxyType(dict(getattr(self, name))))

    def __repr__(self) -> str:
        """Return one line, since printing every array of a scene takes minutes."""
        return f"<Scene: {len(self.nodes)} nodes, {len(self.materials)} materials, cameras {', '.join(self.cameras)}>"

    def world_transform(self, path: str) -> Matrix:
        """Return the (4, 4) transform, object to world, of the node at ``path``."""
        node = self.nodes[path]
        if node.parent in self.nodes:
            return self.world_transform(node.parent) @ node.transform
        return node.transform

    def sun_direction(self) -> NDArray[np.float64]:
        """Return the (3,) unit vector, world, from the scene towards the sun.

        With bearing b of +y and azimuth a (both clockwise from north), the horizontal direction is
        (sin(a − b), cos(a − b)) in (x, y).
        """
        relative = self.sun.azimuth - self.environment.bearing
        horizontal = math.cos(self.sun.elevation)
        return np.array(
            [horizontal * math.sin(relative), horizontal * math.cos(relative), math.sin(self.sun.elevation)]
        )
