"""Test the people of a generated street: numbers, places, and shapes built only when needed."""

from __future__ import annotations

import sys

import numpy as np
import pytest

from urban_street import pedestrians
from urban_street.human.body import BodyShape, shape_body
from urban_street.human.catalogue import LOOKS
from urban_street.human.figure import Figure, Model
from urban_street.human.stances import DEFAULT
from urban_street.pedestrians import PLACES, Crowd
from urban_street.site import numbered
from valerie.errors import InvalidInputs
from valerie.scene.assets.asset import asset_manifest
from valerie.scene.legality.rejection import rejection_reason


def test_a_street_has_as_many_people_as_it_is_told() -> None:
    manifest, digest = asset_manifest({"name": "urban-street", "persons": 4})
    assert manifest.persons == tuple(f"scene.person-{n}" for n in range(1, 5))
    assert manifest.movable[:4] == manifest.persons
    assert manifest.definition("scene.person-4.character").default == "absent"
    assert digest != asset_manifest("urban-street")[1]
    assert asset_manifest({"name": "urban-street", "persons": 2})[1] == asset_manifest("urban-street")[1]


@pytest.mark.parametrize("count", [0, len(PLACES) + 1])
def test_a_number_of_people_out_of_range_is_refused(count: int) -> None:
    with pytest.raises(InvalidInputs, match=r"asset\.persons"):
        asset_manifest({"name": "urban-street", "persons": count})


def test_everybody_can_stand_where_they_are_by_default() -> None:
    manifest, _ = asset_manifest({"name": "urban-street", "persons": len(PLACES)})
    everybody = {f"{person}.character": "black-outfit" for person in manifest.persons}
    assert rejection_reason(everybody, manifest) is None


def test_nobody_is_made_before_somebody_looks(monkeypatch: pytest.MonkeyPatch) -> None:
    figures = {name: Figure(Model(name, look()), DEFAULT, None) for name, look in LOOKS.items()}
    monkeypatch.setattr("urban_street.human.figure", figures.__getitem__)  # none that another test has looked at
    built: list[BodyShape] = []
    monkeypatch.setattr(sys.modules[Model.__module__], "shape_body", lambda s: built.append(s) or shape_body(s))
    crowd = Crowd()
    people = numbered(PLACES[:2])
    nodes = [node for name, person in people.items() for node in crowd.nodes(name, person)]
    assert len(nodes) == 2 * (1 + len(pedestrians.CHARACTERS)) + len(pedestrians.aid_classes(people))
    assert built == []
    one, other = (
        next(node for node in nodes if node.path == f"scene.{person}.striped-boy")
        for person in ("person-1", "person-2")
    )
    for a, b in zip(one.meshes, other.meshes, strict=True):
        assert len(a.positions)
        assert a.positions is b.positions
    assert built == [LOOKS["striped-boy"]().shape]  # once for both


def test_each_person_has_materials_of_its_own_for_everything_it_may_show() -> None:
    crowd = Crowd()
    nodes = [node for name, person in numbered(PLACES[:2]).items() for node in crowd.nodes(name, person)]
    for node in nodes:
        owner = node.path.split(".")[1]
        for mesh in node.meshes:
            assert mesh.material.startswith(f"{owner}/")
            material = crowd.materials[mesh.material]
            assert set(material.textures) <= set(crowd.textures)
    assert all(np.array_equal(node.transform, np.eye(4)) for node in nodes if node.path.count(".") == 2)
