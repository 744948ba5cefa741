"""Changes to a scene: attributes write to a `Draft`, and `Draft.finish` returns a new immutable scene.

The new scene shares all unchanged nodes, materials and cameras with the old one, since engines cache by identity.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal

from valerie.errors import InvalidInput, UnknownName
from valerie.scene.graph.model import Camera, Figure, Light, Material, Node, Scene, Stance
from valerie.scene.graph.naming import ROOT, class_of_name, is_cloth
from valerie.scene.graph.paints import is_paint
from valerie.scene.graph.transforms import Pose, camera_angles, camera_transform

CameraAngle = Literal["yaw", "pitch", "roll"]


@dataclass(frozen=True, slots=True)
class CameraPose:
    """The pose of a camera: optical centre in metres, angles in degrees (see `camera_transform`)."""

    position: tuple[float, float, float]
    yaw: float
    pitch: float
    roll: float

    @classmethod
    def of(cls, camera: Camera) -> CameraPose:
        """Return the pose of a camera. The angles are exact up to rounding."""
        x, y, z = (float(v) for v in camera.position)
        return cls((x, y, z), *camera_angles(camera.transform))

    def with_angle(self, name: CameraAngle, degrees: float) -> CameraPose:
        """Return the pose with one of its angles changed."""
        angles = {"yaw": self.yaw, "pitch": self.pitch, "roll": self.roll} | {name: degrees}
        return CameraPose(self.position, **angles)


class Draft:
    """Changes to a scene, which itself stays as it is."""

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self._poses: dict[str, Pose] = {}
        self._camera_poses: dict[str, CameraPose] = {}
        self._focal_lengths: dict[str, float] = {}
        self._shown: dict[str, bool] = {}
        self._stances: dict[str, Stance] = {}
        self._materials: dict[str, Material] = {}
        self._lights: dict[str, Light] = {}
        self._sun = scene.sun
        self._environment = scene.environment

    def node(self, path: str) -> Node:
        """Return the unchanged node at a path.

        Raises:
            UnknownName: there is none.
        """
        try:
            return self.scene.nodes[path]
        except KeyError:
            raise UnknownName("node", path, self.scene.nodes) from None

    def camera(self, path: str) -> Camera:
        """Return the unchanged camera at a path such as ``scene.camera-1``.

        Raises:
            UnknownName: there is none.
        """
        name = path.removeprefix(f"{ROOT}.")
        if name not in self.scene.cameras:
            raise UnknownName("camera", path, [camera.path for camera in self.scene.cameras.values()])
        return self.scene.cameras[name]

    def pose(self, path: str, change: Callable[[Pose], Pose]) -> None:
        """Change a node's pose in its parent."""
        pose = self._poses.get(path) or Pose.of(self.node(path).transform)
        self._poses[path] = change(pose)

    def camera_pose(self, path: str, change: Callable[[CameraPose], CameraPose]) -> None:
        """Change a camera's pose in the world."""
        camera = self.camera(path)
        self._camera_poses[camera.name] = change(self._camera_poses.get(camera.name) or CameraPose.of(camera))

    def focal_length(self, path: str, millimetres: float) -> None:
        """Change a camera's focal length."""
        self._focal_lengths[self.camera(path).name] = millimetres

    def show(self, path: str, shown: bool) -> None:
        """Show or hide a node. Everything below a hidden node is hidden too.

        Raises:
            UnknownName: there is no such node.
        """
        self.node(path)
        self._shown[path] = shown

    def choose(self, path: str, name: str | None) -> None:
        """Show only the direct child ``name`` of a node; None hides the node with all its children.

        Children whose names state a class are objects of their own: they stay as they are.

        Raises:
            UnknownName: there is no such node or child.
        """
        self.show(path, name is not None)
        if name is not None:
            if f"{path}.{name}" not in self.scene.nodes:
                raise UnknownName(
                    f"child of {path}", name, [n.name for n in self.scene.nodes.values() if n.parent == path]
                )
            for child in self.scene.nodes.values():
                if child.parent == path and (child.name == name or class_of_name(child.name) is None):
                    self.show(child.path, child.name == name)

    def stance(self, path: str, **changes: Any) -> None:
        """Change fields of the stance of all figures directly below a node.

        Raises:
            InvalidInput: there is no figure.
        """
        stance = self._stances.get(path)
        if stance is None:
            bodies = figures(self.scene, path)
            if not bodies:
                raise InvalidInput("no figure below it can take a pose", field=path)
            stance = bodies[0].stance
        self._stances[path] = replace(stance, **changes)

    def cloth(self, path: str, **appearance: Any) -> None:
        """Change fields of all cloth materials at or below a node."""
        for name in cloth_materials(self.scene, path):
            self._materials[name] = replace(self._materials.get(name) or self.scene.materials[name], **appearance)

    def paint(self, path: str, name: str) -> None:
        """Give all paint materials at or below a node the look of one of the scene's paints.

        Raises:
            UnknownName: the scene has no such paint.
        """
        if name not in self.scene.paints:
            raise UnknownName("paint", name, self.scene.paints, field=path)
        paint = self.scene.paints[name]
        for material in paint_materials(self.scene, path):
            self._materials[material] = replace(
                self._materials.get(material) or self.scene.materials[material],
                base_color=paint.base_color,
                metallic=paint.metallic,
                roughness=paint.roughness,
            )

    def light(self, path: str, **changes: Any) -> None:
        """Change fields of a node's `Light`; angles in radians.

        Raises:
            UnknownName: there is no such node.
            InvalidInput: the node has no light.
        """
        light = self._lights.get(path) or self.node(path).light
        if light is None:
            raise InvalidInput("the node has no light", field=path)
        self._lights[path] = replace(light, **changes)

    def light_channel(self, path: str, channel: int, value: float) -> None:
        """Change one channel (0 red, 1 green, 2 blue) of the colour of a node's light; do nothing if it has no light."""
        light = self._lights.get(path) or self.node(path).light
        if light is not None:
            red, green, blue = (value if i == channel else old for i, old in enumerate(light.color))
            self.light(path, color=(red, green, blue))

    def sun(self, **changes: float) -> None:
        """Change fields of the sun; angles in radians."""
        self._sun = replace(self._sun, **changes)

    def environment(self, **changes: Any) -> None:
        """Change fields of the environment."""
        self._environment = replace(self._environment, **changes)

    def finish(self) -> Scene:
        """Return the scene with all changes."""
        return replace(
            self.scene,
            nodes=self._finished_nodes(),
            materials={**self.scene.materials, **self._materials},
            cameras=self._finished_cameras(),
            sun=self._sun,
            environment=self._environment,
        )

    def _finished_nodes(self) -> Mapping[str, Node]:
        if not self._poses and not self._shown and not self._stances and not self._lights:
            return self.scene.nodes
        nodes = dict(self.scene.nodes)
        for path, light in self._lights.items():
            nodes[path] = replace(nodes[path], light=light)
        for path, pose in self._poses.items():
            nodes[path] = replace(nodes[path], transform=pose.matrix())
        inside = tuple(f"{root}." for root in self._shown)
        for path in nodes if inside else ():
            if not (path in self._shown or path.startswith(inside)):
                continue
            node = nodes[path]
            parent = nodes.get(node.parent)
            own = self._shown.get(path, self._was_shown_itself(path))
            visible = own and (parent is None or parent.visible)
            if visible != node.visible:
                nodes[path] = replace(node, visible=visible)
        for path, node in list(nodes.items()) if self._stances else ():
            stance = self._stances.get(node.parent)
            if stance is not None and node.figure is not None and node.figure.stance != stance:
                figure = node.figure.taking(stance)
                nodes[path] = replace(node, figure=figure, meshes=figure.meshes)
        return nodes

    def _was_shown_itself(self, path: str) -> bool:
        """Return True if a node is itself shown, or if a hidden parent leaves this unknown."""
        node = self.scene.nodes[path]
        parent = self.scene.nodes.get(node.parent)
        return node.visible or (parent is not None and not parent.visible)

    def _finished_cameras(self) -> Mapping[str, Camera]:
        cameras = dict(self.scene.cameras)
        for name, pose in self._camera_poses.items():
            transform = camera_transform(pose.position, pose.yaw, pose.pitch, pose.roll)
            cameras[name] = replace(cameras[name], transform=transform)
        for name, millimetres in self._focal_lengths.items():
            cameras[name] = replace(cameras[name], focal_length_mm=millimetres)
        return cameras


def figures(scene: Scene, path: str) -> list[Figure]:
    """Return the figures directly below a node."""
    return [node.figure for node in scene.nodes.values() if node.parent == path and node.figure is not None]


def cloth_materials(scene: Scene, path: str) -> list[str]:
    """Return the names of the cloth materials at or below a node, in the order of the nodes."""
    return _materials_below(scene, path, is_cloth)


def paint_materials(scene: Scene, path: str) -> list[str]:
    """Return the names of the paint materials at or below a node, in the order of the nodes."""
    return _materials_below(scene, path, is_paint)


def _materials_below(scene: Scene, path: str, has_kind: Callable[[str], bool]) -> list[str]:
    names: dict[str, None] = {}
    for node in scene.nodes.values():
        if node.path == path or node.path.startswith(f"{path}."):
            names.update((mesh.material, None) for mesh in node.meshes if has_kind(mesh.material))
    return list(names)
