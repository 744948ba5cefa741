"""The compatibility engine: pyrender 0.1.45 (https://github.com/mmatl/pyrender, MIT), the paper's first kind of renderer.

It has no normal maps (unfinished in its shader), no visible sky, a constant ambient term as its only sky light, no ambient
occlusion, no reflections of surroundings, no soft shadows, no specular tint and no camera effects. Shadows ignore alpha. Its
shader writes alpha but cuts nothing; GL then covers a share of each pixel's samples equal to alpha. Its output has 8 bits per
channel with a gamma of 2.2. This adapter scales the light down before rendering and up afterwards, and inverts the gamma
exactly. The linear image thus has 255 steps per channel up to `HEADROOM`, where it is clipped.
"""

from __future__ import annotations

import os
import warnings
from collections.abc import Hashable
from functools import cache
from importlib.metadata import version
from typing import Any, ClassVar, Final

import numpy as np
from cachetools import LRUCache
from numpy.typing import NDArray

from valerie.errors import MissingDependency, RenderingError
from valerie.rendering.base import Layer, LinearImage, Rectangle, View, bounds, require_image
from valerie.rendering.numeric import numeric_class
from valerie.rendering.scene_reading import DrawItem, camera_key, camera_of, draw_items, material_of
from valerie.rendering.sky import Sky, sky_of
from valerie.scene.graph.model import Material, Mesh, Scene, Texture

#: Brightest value of the linear image.
HEADROOM: Final = 4.0
#: Illuminance of the ground, lux, below which its images are nearly black: a white wall is then step 7 of 255.
DARKEST_LUX: Final = 50.0
_GAMMA: Final = 2.2
#: Texels per side of the shadow map. It covers the whole scene.
_SHADOW_MAP: Final = 4096
#: Cached textures and backgrounds.
_TEXTURES: Final = 512
_BACKGROUNDS: Final = 4
_MIRROR: Final = np.diag([-1.0, 1.0, 1.0, 1.0])
#: GL_LINEAR.
_LINEAR: Final = 9729


class PyrenderRenderer:
    """Images by pyrender; see `valerie.rendering.base.Renderer` for the contract.

    A layer is the bounding rectangle of all pixels in which the frame differs from the background. The background is rendered for
    this comparison, and cached for the next layer with the same camera and light.

    Raises:
        MissingDependency: pyrender is not installed, or there is no EGL driver.
    """

    name: ClassVar[str] = "pyrender"
    revision: ClassVar[int] = 7

    def __init__(self) -> None:
        self._library = _import_pyrender()
        self._node = _ordered_node(self._library)
        self._renderer, driver = _process_renderer()
        self._numeric_class = f"pyrender-{version('pyrender')}-{driver}"
        self._meshes: dict[Hashable, tuple[Mesh, Any]] = {}
        self._textures: LRUCache[Hashable, tuple[Texture, Any]] = LRUCache(_TEXTURES)
        self._backgrounds: LRUCache[Hashable, tuple[Scene, LinearImage]] = LRUCache(_BACKGROUNDS)

    @property
    def numeric_class(self) -> str:
        """See `valerie.rendering.base.Renderer`."""
        return self._numeric_class

    def background(self, scene: Scene, view: View) -> LinearImage:
        """Render the frame without movables.

        Raises:
            RenderingError: the image is constant.
        """
        return LinearImage(self._render(scene, view, draw_items(scene, movable=False)))

    def layer(self, scene: Scene, view: View) -> Layer:
        """Render the rectangle in which the frame differs from the background."""
        movables = draw_items(scene, movable=True)
        if not movables:
            return Layer(Rectangle(0, 0, 0, 0), np.zeros((0, 0, 3), np.float16))
        background = self._background_of(scene, view)
        pixels = self.full(scene, view).pixels
        differs = (pixels != background.pixels).any(axis=2)
        rectangle = bounds(differs)
        return Layer(rectangle, pixels[rectangle.slices].copy())

    def full(self, scene: Scene, view: View) -> LinearImage:
        """Render the whole frame at once."""
        items = (*draw_items(scene, movable=False), *draw_items(scene, movable=True))
        return LinearImage(self._render(scene, view, items))

    def close(self) -> None:
        """Clear the caches. The EGL context belongs to the process and stays open."""
        self._meshes.clear()
        self._textures.clear()
        self._backgrounds.clear()

    def _background_of(self, scene: Scene, view: View) -> LinearImage:
        statics = draw_items(scene, movable=False)
        key = (
            camera_key(camera_of(scene, view), view),
            scene.sun,
            scene.environment,
            tuple((id(item.node), item.world.tobytes()) for item in statics),
            tuple(material_of(scene, mesh, item.node.path) for item in statics for mesh in item.meshes),
        )
        entry = self._backgrounds.get(key)
        if entry is None:
            # The reference to the scene keeps the identities in the key from being reused.
            entry = (scene, self.background(scene, view))
            self._backgrounds[key] = entry
        return entry[1]

    def _render(self, scene: Scene, view: View, items: tuple[DrawItem, ...]) -> NDArray[np.float16]:
        """Render a linear image, (height, width, 3)."""
        camera = camera_of(scene, view)
        sky = sky_of(scene)
        if sky.lux < DARKEST_LUX:
            raise RenderingError(
                f"pyrender cannot show the night: the ground has {sky.lux:.3g} lx, its 8 bits begin at {DARKEST_LUX:g} lx"
            )
        library = self._library
        target = library.Scene(bg_color=_encoded(sky.haze), ambient_light=_ambient(sky) / HEADROOM)
        keys: set[Hashable] = set()
        for item in items:
            for mesh in item.meshes:
                if mesh.faces.size:
                    material = material_of(scene, mesh, item.node.path)
                    mirrored = bool(np.linalg.det(item.world[:3, :3]) < 0)
                    keys.add((id(mesh), material, mirrored))
                    world = item.world @ _MIRROR if mirrored else item.world
                    node = self._node(mesh=self._mesh(mesh, material, scene, mirrored=mirrored), matrix=world)
                    node.serial = len(target.mesh_nodes)
                    target.add_node(node)
        focal = camera.focal_length_px(view.width)
        lens = library.IntrinsicsCamera(
            focal, focal, view.width / 2, view.height / 2, znear=camera.near, zfar=camera.far
        )
        target.add(lens, pose=camera.transform)
        flags = library.RenderFlags.NONE
        strength = float(sky.sun.max())
        if strength > 0:
            # The library's shader divides diffuse reflection by π; our image unit has no π.
            light = library.DirectionalLight(color=sky.sun / strength, intensity=np.pi * strength / HEADROOM)
            target.add(light, pose=_pose_along(-sky.sun_direction))
            flags |= library.RenderFlags.SHADOWS_DIRECTIONAL
        self._renderer.viewport_width, self._renderer.viewport_height = view.width, view.height
        try:
            encoded, _ = self._renderer.render(target, flags=flags)
        except Exception as error:
            raise RenderingError(f"pyrender could not render the frame: {error}") from error
        self._forget_all_but(keys)
        pixels: NDArray[np.float16] = _DECODED[encoded]
        require_image(pixels, engine=self.name)
        return pixels

    def _mesh(self, mesh: Mesh, material: Material, scene: Scene, *, mirrored: bool) -> Any:
        """Return the library's mesh, cached by identity. It is itself mirrored, since the library's nodes cannot mirror."""
        key = (id(mesh), material, mirrored)
        entry = self._meshes.get(key)
        if entry is None:
            # The library's shader reads roughness and metallic from the first two channels.
            color = self._texture(scene, material.base_color_texture, (0, 1, 2), material.alpha_cutoff)
            rough = self._texture(scene, material.roughness_texture, (1, 2, 0))
            flip = np.diag(_MIRROR[:3, :3]).astype(np.float32) if mirrored else np.ones(3, np.float32)
            primitive = self._library.Primitive(
                positions=mesh.positions * flip,
                normals=mesh.normals * flip,
                # The library uploads textures with the bottom row first.
                texcoord_0=np.stack([mesh.uvs[:, 0], 1 - mesh.uvs[:, 1]], axis=1) if color or rough else None,
                indices=np.ascontiguousarray(mesh.faces[:, ::-1]) if mirrored else mesh.faces,
                material=self._library.MetallicRoughnessMaterial(
                    baseColorFactor=(*material.base_color, 1.0),
                    baseColorTexture=color,
                    metallicRoughnessTexture=rough,
                    metallicFactor=material.metallic,
                    roughnessFactor=max(material.roughness, 0.05),
                    emissiveFactor=tuple(value / HEADROOM for value in material.emissive),
                    doubleSided=material.double_sided,
                ),
            )
            entry = (mesh, self._library.Mesh([primitive]))
            self._meshes[key] = entry
        return entry[1]

    def _texture(
        self, scene: Scene, name: str | None, channels: tuple[int, int, int], cutoff: float | None = None
    ) -> Any:
        if name is None:
            return None
        texture = scene.textures[name]
        if texture.image.shape[2] < 4:
            cutoff = None
        key = (id(texture), channels, cutoff)
        entry = self._textures.get(key)
        if entry is None:
            image = np.ascontiguousarray(texture.image[..., channels])
            if cutoff is None:
                copy = self._library.Texture(source=image, source_channels="RGB")
            else:
                solid = np.where(texture.image[..., 3:] >= 255 * cutoff, 255, 0).astype(np.uint8)
                # Without mipmaps: the mean of bars and gaps would be neither.
                sampler = self._library.Sampler(magFilter=_LINEAR, minFilter=_LINEAR)
                copy = self._library.Texture(
                    source=np.concatenate([image, solid], axis=2), source_channels="RGBA", sampler=sampler
                )
            self._textures[key] = (texture, copy)
            return copy
        return entry[1]

    def _forget_all_but(self, keys: set[Hashable]) -> None:
        """Drop the meshes that the last frame did not use once there are many, which bounds memory over many materials."""
        if len(self._meshes) > 2 * len(keys) + 64:
            self._meshes = {key: mesh for key, mesh in self._meshes.items() if key in keys}


def _import_pyrender() -> Any:
    # The library binds its GL platform at import.
    os.environ.setdefault("PYOPENGL_PLATFORM", "egl")
    # pyrender 0.1.45 uses np.infty in the bounds of shadows; numpy 2 has removed the name.
    if not hasattr(np, "infty"):
        np.infty = np.inf  # type: ignore[attr-defined]  # noqa: NPY201
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            import pyrender
            import pyrender.light
            import pyrender.renderer
    except Exception as error:
        raise MissingDependency(f"pyrender cannot be imported ({error}); install valerie[render]") from error
    # The library reads the size of its shadow maps from module globals.
    pyrender.light.SHADOW_TEX_SZ = pyrender.renderer.SHADOW_TEX_SZ = _SHADOW_MAP
    return pyrender


@cache
def _process_renderer() -> tuple[Any, str]:
    """Return the library's renderer and the driver's numeric class. There is one renderer, which lives as long as the process.

    Deleting it, or its garbage collection, would terminate the EGL display and with it the contexts of the truth pass and the
    raster engine.
    """
    library = _import_pyrender()
    try:
        renderer = library.OffscreenRenderer(16, 16)
    except Exception as error:
        raise MissingDependency(f"pyrender finds no EGL driver: {error}") from error
    from OpenGL import GL

    # These set states of the renderer's context, which stays current. Rows of textures follow each other without padding.
    GL.glEnable(GL.GL_SAMPLE_ALPHA_TO_COVERAGE)
    GL.glPixelStorei(GL.GL_UNPACK_ALIGNMENT, 1)
    return renderer, numeric_class(_text(GL.glGetString(GL.GL_RENDERER)), _text(GL.glGetString(GL.GL_VERSION)))


def _ordered_node(library: Any) -> Any:
    """Return a node class whose nodes are drawn in the order in which they were added.

    The library keeps nodes in a set and draws nodes of equal distance in the order of the set. With the default hash, an
    address, this order would differ from frame to frame, and so would the image where surfaces coincide.
    """

    class OrderedNode(library.Node):  # type: ignore[misc]
        serial = 0

        def __hash__(self) -> int:
            return self.serial

    return OrderedNode


def _encoded(linear: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a linear colour as the library's shader would write it."""
    encoded: NDArray[np.float64] = np.clip(linear / HEADROOM, 0, 1) ** (1 / _GAMMA)
    return encoded


def _ambient(sky: Sky) -> NDArray[np.float64]:
    """Return the ambient colour: half the sky's, half the ground's."""
    ambient: NDArray[np.float64] = 0.5 * (sky.sky_irradiance + sky.ground)
    return ambient


def _pose_along(direction: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the pose, (4, 4), whose −z is ``direction``."""
    back = -direction / np.linalg.norm(direction)
    reference = np.array([0.0, 1.0, 0.0]) if abs(back[1]) < 0.9 else np.array([1.0, 0.0, 0.0])
    right = np.cross(reference, back)
    right /= np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3, :3] = np.stack([right, np.cross(back, right), back], axis=1)
    return pose


def _text(value: bytes | str) -> str:
    return value.decode() if isinstance(value, bytes) else value


_DECODED: Final = ((np.arange(256) / 255.0) ** _GAMMA * HEADROOM).astype(np.float16)
