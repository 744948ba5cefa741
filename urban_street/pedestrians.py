"""The pedestrians of a generated street: default places and characters, parameters, nodes."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial
from typing import Final

import numpy as np

from urban_street.human.catalogue import CHARACTERS
from urban_street.human.stances import CARRIED, DEFAULT, POSES
from valerie.parameters.declaring import angle, choice, number
from valerie.parameters.definitions import Affects, ParameterDefinition
from valerie.scene.assets.attributes import ABSENT
from valerie.scene.graph.model import Material, Node, Texture
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
        """Yield the node of a person, and a child per character. Only the chosen child is visible."""
        path = f"{ROOT}.{name}"
        present = person.character != ABSENT
        yield Node(path, place(person.x, person.y, 0.0, person.heading), visible=present)
        for character, model in self._figures.items():
            for material in model.materials.values():
                own = f"{name}/{material.name}"
                self.materials[own] = replace(material, name=own)
            figure = model.renamed(partial("{}/{}".format, name))
            if person.pose != DEFAULT.pose:
                figure = figure.taking(replace(DEFAULT, pose=person.pose))
            visible = present and character == person.character
            yield Node(f"{path}.{character}", np.eye(4), figure.meshes, visible=visible, figure=figure)
