"""The manifest of an asset: its parameters, its movables, and the ground where people can stand.

The same document is the ``manifest.yaml`` of a user's asset and the value that an asset pack returns. The API, the planner and
the control loop read it without meshes, trimesh or GL.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from functools import cached_property
from typing import Annotated, Any, Literal, Self

from pydantic import Field, StringConstraints, ValidationError, field_validator, model_validator

from valerie.document import Document
from valerie.errors import InvalidInput, UnknownName
from valerie.labels import label_of_node_class
from valerie.parameters.assignment import digest
from valerie.parameters.definitions import ParameterDefinition, ParameterType
from valerie.parameters.paths import parse_path
from valerie.scene.assets.attributes import Attribute, Target, resolve
from valerie.scene.assets.placements import Coordinate, PlacedCamera, PlacedFile, require_gltf_name
from valerie.scene.assets.sensor_parameters import SENSOR_PARAMETERS, SENSOR_ROOT
from valerie.scene.graph.model import POSITIONS
from valerie.scene.graph.naming import ROOT, is_node_name, parse_object_name
from valerie.scene.graph.paints import Paint
from valerie.scene.light.solar import ANGLES, CLOCK_PATHS
from valerie.scene.motion.trajectory import Trajectory, check_keyframes
from valerie.validation import problems_of

Point = tuple[Coordinate, Coordinate]
Polygon = Annotated[tuple[Point, ...], Field(min_length=3, max_length=1000)]
AssetName = Annotated[str, StringConstraints(pattern=r"^[a-z0-9][a-z0-9_-]*$", max_length=64)]


class Footprint(Document):
    """Ground that something occupies.

    Attributes:
        path: node that stands there, e.g. ``scene.car-2``. If the node has a ``kind``, the path of the kind with this outline.
        polygon: corners (x, y) in metres, world; simple, of either orientation.
        reason: place of a person who would stand there, e.g. ``inside building-3``; derived from the path if empty.
        height_m: height of its top above z = 0; None if it is higher than any camera.
    """

    path: str
    polygon: Polygon
    reason: str = ""
    height_m: float | None = Field(default=None, gt=0, allow_inf_nan=False)

    @property
    def text(self) -> str:
        """Return the reason, e.g. ``inside building-3``."""
        parts = self.path.split(".")
        return self.reason or f"inside {next((part for part in reversed(parts) if parse_object_name(part)), parts[-1])}"


class GroundRegion(Document):
    """A part of the ground at one height.

    Attributes:
        polygon: corners (x, y) in metres, world. The border is part of the region.
        height: z in metres.
    """

    polygon: Polygon
    height: float = Field(ge=-1000, le=1000, allow_inf_nan=False)


class TrainingRules(Document):
    """Rules for varying an asset in training scenes (`valerie.pipeline.retraining.training_scenes`).

    Attributes:
        left_out: movable nodes, and characters of persons (``scene.person-1.red-coat``), that these scenes never show.
        poses: pose of a person to its weight. If empty, all poses have the same weight.
        worn: prefixes, besides ``cloth-``, of materials to dye. A ``/``-separated part of the material's name starts with one.
        skin: likewise, prefixes of materials to make lighter or darker, by one factor per person.
    """

    left_out: tuple[str, ...] = ()
    poses: dict[str, Annotated[float, Field(gt=0, allow_inf_nan=False)]] = Field(default_factory=dict)
    worn: tuple[str, ...] = ()
    skin: tuple[str, ...] = ("skin",)


class Manifest(Document):
    """The declarations of an asset.

    Attributes:
        name: the asset's name in specs.
        files: glTF files of a user's asset whose nodes are named by the convention, relative to the manifest; an asset pack has
            none.
        placed_files: glTF files of a user's asset that are named and placed here.
        bearing_deg: compass bearing of +y, clockwise from north.
        extent: x0, y0, x1, y1 in metres: the ground on which persons and other movables may be.
        parameters: declarations of the parameters: type, range, unit and default.
        movable: nodes that, with everything below them, belong to the movable layer instead of the background.
        obstacles: ground on which no person can stand. The outline of a mover moves with it.
        ways: ground of carriageways and pavements. Houses and other objects that nobody drives stay off it.
        ground: heights of the ground. A later region covers an earlier one; elsewhere z is 0.
        persons: nodes that are pedestrians under test.
        grounded: nodes whose z is the height of the ground below their (x, y); by default the persons.
        person_radius_m: radius of the circle that a standing person needs.
        cameras: names, e.g. ``camera-1``; by default those of ``placed_cameras``.
        placed_cameras: cameras that no file contains.
        node_classes: class by path, for nodes whose names do not state one.
        gaits: poses of persons in which ``gait_phase`` has an effect.
        reaches: pose of a person to the middles (x, y) of further circles of ``person_radius_m`` that it needs, metres in the
            person's frame (+y ahead): the ground of a pushed stroller, or of a dog.
        paints: the colours that a vehicle can have, by name.
        training: rules for training scenes.
        trajectories: movements in runs with a sequence or a time.

    Raises:
        InvalidInput, UnknownName: parts of the manifest contradict each other.
    """

    manifest_version: Literal[1] = 1
    name: AssetName
    title: str = ""
    description: str = ""
    files: tuple[str, ...] = ()
    placed_files: tuple[PlacedFile, ...] = ()
    bearing_deg: float = Field(default=0.0, ge=-360, le=360, allow_inf_nan=False)
    extent: tuple[Coordinate, Coordinate, Coordinate, Coordinate]
    parameters: tuple[ParameterDefinition, ...] = ()
    movable: tuple[str, ...] = ()
    obstacles: tuple[Footprint, ...] = ()
    ways: tuple[Footprint, ...] = ()
    ground: tuple[GroundRegion, ...] = ()
    persons: tuple[str, ...] = ()
    grounded: tuple[str, ...] = ()
    person_radius_m: float = Field(default=0.3, ge=0, le=5, allow_inf_nan=False)
    cameras: tuple[str, ...] = Field(min_length=1)
    placed_cameras: tuple[PlacedCamera, ...] = ()
    node_classes: dict[str, str] = Field(default_factory=dict)
    gaits: tuple[str, ...] = ()
    reaches: dict[str, tuple[Point, ...]] = Field(default_factory=dict)
    paints: dict[str, Paint] = Field(default_factory=dict)
    training: TrainingRules = TrainingRules()
    trajectories: tuple[Trajectory, ...] = ()

    # Hot loops cache by manifest. One that was read again is another object, so comparing thousands of parameters each time would
    # make planning fourteen times as expensive.
    def __eq__(self, other: object) -> bool:
        return self is other or (isinstance(other, Manifest) and self.fingerprint == other.fingerprint)

    def __hash__(self) -> int:
        return hash((self.name, self.extent, len(self.parameters), len(self.obstacles)))

    def __copy__(self) -> Self:
        copy = super().__copy__()
        for derived in ("by_path", "fingerprint"):  # they describe the old fields
            copy.__dict__.pop(derived, None)
        return copy

    @model_validator(mode="before")
    @classmethod
    def _fill_in(cls, document: Any) -> Any:
        """Fill in optional entries: grounded persons, and type, unit and stage of parameters, which follow from their paths."""
        if not isinstance(document, dict):
            return document
        fields = dict(document)
        if "persons" in fields:
            fields.setdefault("grounded", fields["persons"])
        placements = fields.get("placed_cameras")
        if placements and isinstance(placements, list | tuple) and "cameras" not in fields:
            fields["cameras"] = [camera.get("name") for camera in placements if isinstance(camera, dict)]
        cameras, parameters = fields.get("cameras"), fields.get("parameters")
        if isinstance(cameras, list | tuple) and isinstance(parameters, list | tuple):
            fields["parameters"] = tuple(_fill_in_parameter(parameter, cameras) for parameter in parameters)
        return fields

    @field_validator("files")
    @classmethod
    def _plain_files(cls, files: tuple[str, ...]) -> tuple[str, ...]:
        for index, file in enumerate(files):
            require_gltf_name(file, field=f"files.{index}")
        return files

    @model_validator(mode="after")
    def _check(self) -> Self:
        x0, y0, x1, y1 = self.extent
        if x0 >= x1 or y0 >= y1:
            raise InvalidInput("not x0 < x1 and y0 < y1", field="extent", value=self.extent)
        for field in ("movable", "persons", "grounded"):
            _check_paths(field, getattr(self, field))
        for path, node_class in self.node_classes.items():
            _check_paths("node_classes", (path,))
            label_of_node_class(node_class, field=f"node_classes.{path}")
        for index, camera in enumerate(self.cameras):
            if not is_node_name(camera):
                raise InvalidInput("not a camera name", field=f"cameras.{index}", value=camera, limit="e.g. camera-1")
        for path in self.grounded:
            if path.count(".") != 1:
                raise InvalidInput("a grounded node must be directly below the scene", field="grounded", value=path)
        for field in ("cameras", "movable", "persons", "grounded", "files"):
            _check_distinct(field, getattr(self, field))
        _check_distinct("placed_files", [entry.node for entry in self.placed_files])
        _check_distinct("placed_cameras", [entry.name for entry in self.placed_cameras])
        for index, entry in enumerate(self.placed_cameras):
            self.require_camera(entry.name, field=f"placed_cameras.{index}")
        _check_distinct("parameters", [p.name for p in self.parameters])
        _check_distinct("parameters", [p.path for p in self.parameters])
        paths = {definition.path for definition in self.parameters}
        for path in self.persons:
            if (f"{path}.pos.x" in paths) != (f"{path}.pos.y" in paths):
                # The manifest alone decides which variants are legal, so it needs both coordinates.
                raise InvalidInput("a person needs both pos.x and pos.y, or neither", field="parameters", value=path)
        for obstacle in self.obstacles:
            changes = any(f"{obstacle.path}.{name}" in paths for name in ("heading", "rot.z", "scale"))
            if changes and not {f"{obstacle.path}.pos.x", f"{obstacle.path}.pos.y"} <= paths:
                raise InvalidInput(
                    "an obstacle that turns or scales needs pos.x and pos.y",
                    field="parameters",
                    value=obstacle.path,
                )
        if not paths.isdisjoint(CLOCK_PATHS) and not paths.issuperset(ANGLES):
            raise InvalidInput(
                "a sun that varies by time and place needs its two angles too",
                field="parameters",
                limit=", ".join(ANGLES),
            )
        for index, definition in enumerate(self.parameters):
            _check_attribute(definition, self, f"parameters.{index}")
            if definition.path.removesuffix(".pos.z") in self.grounded:
                raise InvalidInput(
                    "z of a grounded node cannot vary", field=f"parameters.{index}", value=definition.path
                )
        _check_poses(self)
        for path in self.training.left_out:
            person, _, character = path.rpartition(".")
            characters = self.by_path.get(f"{person}.character")
            if path not in self.movable and (characters is None or character not in characters.choices):
                raise UnknownName("movable node or character", path, self.movable, field="training.left_out")
        _check_distinct("trajectories", [trajectory.path for trajectory in self.trajectories])
        for index, trajectory in enumerate(self.trajectories):
            self.require_trajectory(trajectory, field=f"trajectories.{index}")
        return self

    @property
    def all_files(self) -> tuple[str, ...]:
        """Return every file once, in the order in which they are named."""
        return tuple(dict.fromkeys((*self.files, *(entry.file for entry in self.placed_files))))

    @cached_property
    def fingerprint(self) -> str:
        """Return a hash of the whole manifest."""
        return digest(self.model_dump_json())

    @cached_property
    def by_path(self) -> Mapping[str, ParameterDefinition]:
        """Return the declared parameters by path."""
        return {definition.path: definition for definition in self.parameters}

    def definition(self, path: str) -> ParameterDefinition:
        """Return the declaration of a path.

        Raises:
            UnknownName: the path is not declared. The message lists near matches.
        """
        try:
            return self.by_path[path]
        except KeyError:
            raise UnknownName("parameter", path, self.by_path) from None

    def require_camera(self, name: str, *, field: str = "") -> str:
        """Return ``name`` if it is a camera of this asset.

        Raises:
            UnknownName: it is not.
        """
        if name not in self.cameras:
            raise UnknownName("camera", name, self.cameras, field=field)
        return name

    def require_trajectory(self, trajectory: Trajectory, *, field: str = "") -> None:
        """Refuse a trajectory that does not fit the manifest.

        Raises:
            UnknownName: its target cannot move; or as `check_keyframes`.
            InvalidInput: as `check_keyframes`.
        """
        cameras = {f"{ROOT}.{camera}" for camera in self.cameras}
        if not self.is_movable(trajectory.path) and trajectory.path not in cameras:
            names = sorted({path.removeprefix(f"{ROOT}.") for path in (*self.movable, *cameras)})
            raise UnknownName("node or camera that can move", trajectory.name, names, field=f"{field}.path")
        check_keyframes(trajectory, self.by_path, field=field)

    def is_movable(self, path: str) -> bool:
        """Return True if a node, or the node of an attribute, belongs to the movable layer."""
        return any(path == movable or path.startswith(movable + ".") for movable in self.movable)


def parse_manifest(data: object, *, source: str = "manifest") -> Manifest:
    """Validate a manifest read from YAML or JSON.

    Args:
        source: the name in errors, e.g. ``manifest.yaml``.

    Raises:
        InvalidInputs: all problems, each with its dotted field.
        InvalidInput, UnknownName: a contradiction.
    """
    if not isinstance(data, dict):
        raise InvalidInput("the document is not a mapping", field=source, value=type(data).__name__)
    unknown = [str(key) for key in data if key not in Manifest.model_fields]
    if unknown:
        raise UnknownName("field", unknown[0], Manifest.model_fields, field=source)
    try:
        return Manifest.model_validate(data)
    except ValidationError as error:
        raise problems_of(error, source) from None


def _fill_in_parameter(parameter: Any, cameras: Sequence[Any]) -> Any:
    if not isinstance(parameter, dict):
        return parameter
    path = parameter.get("path", parameter.get("scene_graph_ref"))
    if not isinstance(path, str):
        return parameter
    _, attribute = resolve(path, [str(camera) for camera in cameras], field=f"parameters.{path}")
    return {"type": attribute.type, "unit": attribute.unit, "affects": attribute.affects, **parameter}


def _check_attribute(definition: ParameterDefinition, manifest: Manifest, field: str) -> None:
    """Check type, unit, range and stage against the attribute's row. A wrong stage would reuse wrong products."""
    _, attribute = resolve(definition.path, manifest.cameras, field=field)
    for name in ("type", "unit", "affects"):
        value, own = getattr(definition, name), getattr(attribute, name)
        if value != own:
            raise InvalidInput(
                f"{definition.path} has another {name}", field=f"{field}.{name}", value=str(value), limit=str(own)
            )
    low, high = attribute.minimum, attribute.maximum
    if definition.type in (ParameterType.FLOAT, ParameterType.INT) and (
        (low is not None and (definition.minimum is None or definition.minimum < low))
        or (high is not None and (definition.maximum is None or definition.maximum > high))
    ):
        raise InvalidInput(
            f"the range of {definition.path} is too wide",
            field=f"{field}.minimum",
            value=definition.range_text,
            limit=f"{low}…{high}",
        )
    choices = _known_choices(definition, attribute, manifest)
    for choice in definition.choices if choices is not None else ():
        if choices is not None and choice not in choices:
            raise UnknownName(f"choice of {definition.path}", choice, choices, field=f"{field}.choices")


def _check_poses(manifest: Manifest) -> None:
    """Check that the poses in ``gaits``, ``reaches`` and ``training`` are poses that persons can take."""
    poses = {
        choice: None
        for definition in manifest.parameters
        if definition.path.endswith(".pose")
        for choice in definition.choices
    }
    declared = (("gaits", manifest.gaits), ("reaches", manifest.reaches), ("training.poses", manifest.training.poses))
    for field, names in declared:
        for name in names:
            if name not in poses:
                raise UnknownName("pose", name, poses, field=field)


def _known_choices(definition: ParameterDefinition, attribute: Attribute, manifest: Manifest) -> Collection[str] | None:
    """Return the permitted choices of a parameter; None if only the scene's nodes and figures define them."""
    if attribute.target is Target.SENSOR:
        return SENSOR_PARAMETERS[definition.path.removeprefix(f"{SENSOR_ROOT}.")].choices
    if attribute.target is Target.ENVIRONMENT:
        return POSITIONS
    return manifest.paints if attribute.name == "colour" else None


def _check_paths(field: str, paths: tuple[str, ...]) -> None:
    for path in paths:
        parts = parse_path(path, field=field)
        if parts[0] != ROOT:
            raise InvalidInput("not a node of the scene", field=field, value=path, limit="scene.…")


def _check_distinct(field: str, names: list[str] | tuple[str, ...]) -> None:
    repeated = sorted({name for name in names if names.count(name) > 1})
    if repeated:
        raise InvalidInput("named twice", field=field, value=", ".join(repeated))
