"""The pedestrians of a generated street: default places and characters, parameters, nodes."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache, partial
from typing import Final

import numpy as np
from numpy.typing import NDArray

from urban_street.human.aids import AIDED, MATERIALS, aid
from urban_street.human.catalogue import CHARACTERS
from urban_street.human.stances import CARRIED, DEFAULT, GAIT_STEPS, POSES, gait_step
from urban_street.vehicles.build import build_vehicle
from urban_street.vehicles.content import VehicleContent
from valerie.parameters.declaring import angle, choice, number
from valerie.parameters.definitions import Affects, ParameterDefinition
from valerie.scene.assets.attributes import ABSENT
from valerie.scene.graph.model import JOINTS, Material, Mesh, Node, Stance, Texture
from valerie.scene.graph.naming import ROOT
from valerie.scene.graph.transforms import place

#: Radius that a pedestrian needs to stand, metres. Arms may reach over a bonnet.
PERSON_RADIUS_M: Final = 0.3


@dataclass(frozen=True, slots=True)
class PersonPlace:
    """The default place (metres, degrees), character and pose of a person."""

    x: float
    y: float
    heading: float
    character: str
    pose: str = DEFAULT.pose


#: x0, y0, x1, y1 of the positions of people in the street, metres.
PEOPLE_REACH: Final = (-10.0, 0.0, 20.0, 100.0)
#: Places in the order of the persons.
PLACES: Final = (
    PersonPlace(3.0, 20.0, 180.0, "yellow-shirt"),
    PersonPlace(1.5, 24.0, 0.0, ABSENT),
    PersonPlace(-1.9, 14.0, 180.0, ABSENT),
    PersonPlace(6.9, 18.0, 0.0, ABSENT),
    PersonPlace(2.2, 30.0, 270.0, ABSENT),
    PersonPlace(-2.3, 27.0, 0.0, ABSENT),
    PersonPlace(7.4, 31.0, 180.0, ABSENT),
    PersonPlace(3.4, 12.0, 90.0, ABSENT),
)


def person_parameters(
    name: str, person: PersonPlace, reach: tuple[float, float, float, float]
) -> Iterator[ParameterDefinition]:
    """Yield the parameters of one person, whose x and y are within ``reach`` (x0, y0, x1, y1)."""
    path = f"{ROOT}.{name}"
    yield number(f"{path}.pos.x", reach[0], reach[2], person.x, Affects.GEOMETRY, "m", "across the street")
    yield number(f"{path}.pos.y", reach[1], reach[3], person.y, Affects.GEOMETRY, "m", "along the street")
    yield angle(f"{path}.heading", person.heading, Affects.GEOMETRY, "0 faces +y, counter-clockwise from above")
    yield choice(
        f"{path}.character",
        (*CHARACTERS, ABSENT),
        person.character,
        Affects.GEOMETRY,
        "appearance of the person, or absent",
    )
    yield choice(f"{path}.pose", POSES, person.pose, Affects.GEOMETRY, "pose of the person")
    yield number(
        f"{path}.gait_phase", 0.0, 1.0, DEFAULT.gait_phase, Affects.GEOMETRY, "",
        "share of a walk's cycle after the character's first instant; rounded to 1/16",
    )  # fmt: skip
    yield choice(
        f"{path}.carries", CARRIED, DEFAULT.carries, Affects.GEOMETRY, "carried thing; own: the character's own"
    )
    for field, default in (("metallic", 0.0), ("roughness", 0.8), ("specular_tint", 0.0)):
        yield number(f"{path}.cloth.{field}", 0.0, 1.0, default, Affects.MATERIAL, "", "of everything worn")


#: The pose that pushes a bicycle, and the bicycle's place in the figure's frame, metres: on the right, grip and saddle at hand.
_PUSHED: Final = ("bicycle",)
_BICYCLE_AT: Final = np.array([0.44, 0.24, 0.0])
#: Classes of the things that belong to a pose without being carried, and what names their nodes below a person's.
_AIDS: Final = {"dynamic": "dynamic-1", "bicycle": "bicycle-2{number:02d}"}


def aid_classes(names: Iterable[str]) -> dict[str, str]:
    """Return the classes of the nodes of all aids of some persons, by path."""
    return {f"{ROOT}.{name}.{aid_name(kind, name)}": kind for name in names for kind in _AIDS}


def aid_name(kind: str, person: str) -> str:
    """Return the name of the node of a person's aid. A bicycle's number is its instance."""
    return _AIDS[kind].format(number=int(person.rpartition("-")[2]))


class Aid:
    """The things of one class that stand beside a person in some poses (`valerie.scene.graph.model.Figure`).

    Args:
        kind: ``dynamic`` or ``bicycle``.
        stance: the person's stance, which decides what is there.
        rename: maps names of materials to other names.
    """

    def __init__(self, kind: str, stance: Stance, rename: Callable[[str], str]) -> None:
        self._kind, self.stance, self._rename = kind, stance, rename

    @property
    def meshes(self) -> tuple[Mesh, ...]:
        """Return one mesh per material; none if the pose has no aid of this class."""
        pose = self.stance.pose
        if pose not in (AIDED if self._kind == "dynamic" else _PUSHED):
            return ()
        step = gait_step(self.stance.gait_phase) if pose == "dog" else 0
        if (pose, step) not in self._drawn:
            found = _pushed_bicycle() if pose in _PUSHED else aid(pose, step, GAIT_STEPS)
            self._drawn[pose, step] = tuple(mesh.with_material(self._rename(mesh.material)) for mesh in found)
        return self._drawn[pose, step]

    @cached_property
    def _drawn(self) -> dict[tuple[str, int], tuple[Mesh, ...]]:
        return {}

    @property
    def joints(self) -> NDArray[np.float64]:
        """Return no joints: (len(JOINTS), 3) of NaN."""
        return np.full((len(JOINTS), 3), np.nan)

    def taking(self, stance: Stance) -> Aid:
        """Return the aid of another stance."""
        other = Aid(self._kind, stance, self._rename)
        other._drawn = self._drawn
        return other

    def renamed(self, rename: Callable[[str], str]) -> Aid:
        """Return the aid with materials renamed by ``rename(name)``."""
        return Aid(self._kind, self.stance, lambda name: rename(self._rename(name)))


@lru_cache(maxsize=1)
def _bicycle() -> VehicleContent:
    return build_vehicle("bicycle", colour="petrol")


@lru_cache(maxsize=1)
def _pushed_bicycle() -> tuple[Mesh, ...]:
    """Return the meshes of a bicycle at the place where it is pushed, in the figure's frame."""
    return tuple(
        replace(mesh, positions=(mesh.positions + part.transform[:3, 3] + _BICYCLE_AT).astype(np.float32))
        for part in _bicycle().parts
        for mesh in part.meshes
    )


class Crowd:
    """Nodes, materials and textures of persons. Each person has its own materials, which vary independently.

    Bodies and textures are shared and built on first use.
    """

    def __init__(self) -> None:
        from urban_street.human import figure

        self._figures = {name: figure(name) for name in CHARACTERS}
        self.materials: dict[str, Material] = {}
        self.textures: dict[str, Texture] = {}
        for person in self._figures.values():
            self.textures.update(person.textures)

    def nodes(self, name: str, person: PersonPlace) -> Iterator[Node]:
        """Yield the node of a person, a child per character, of which only the chosen one is visible, and those of its aids."""
        path = f"{ROOT}.{name}"
        present = person.character != ABSENT
        rename = partial("{}/{}".format, name)
        stance = replace(DEFAULT, pose=person.pose)
        yield Node(path, place(person.x, person.y, 0.0, person.heading), visible=present)
        for character, model in self._figures.items():
            self._own(model.materials.values(), rename)
            figure = model.renamed(rename)
            if person.pose != DEFAULT.pose:
                figure = figure.taking(stance)
            visible = present and character == person.character
            yield Node(f"{path}.{character}", np.eye(4), figure.meshes, visible=visible, figure=figure)
        self._own((*MATERIALS.values(), *_bicycle().materials.values()), rename)
        for kind in _AIDS:
            yield Node(f"{path}.{aid_name(kind, name)}", np.eye(4), visible=present, figure=Aid(kind, stance, rename))

    def _own(self, materials: Iterable[Material], rename: Callable[[str], str]) -> None:
        self.materials |= {
            rename(material.name): replace(material, name=rename(material.name)) for material in materials
        }
