"""The street as an asset pack: the contract of all packs, and the effects of its seed."""

import re

import pytest

from valerie.errors import InvalidInput
from valerie.scene.assets.asset import asset_manifest
from valerie.testing.asset_packs import AssetContract


class TestUrbanStreet(AssetContract):
    name = "urban-street"
    arguments = {"length_m": 100.0, "side_street": "none", "persons": 1}  # noqa: RUF012
    other = {"seed": 7}  # noqa: RUF012


def test_another_seed_declares_the_same_about_other_cars_and_houses() -> None:
    (first, first_digest), (second, second_digest) = (
        asset_manifest({"name": "urban-street", "seed": seed}) for seed in (0, 7)
    )
    assert first_digest != second_digest
    assert first.obstacles != second.obstacles
    # Parked cars, the places of fitted vehicles and houses differ; all other declarations are equal.
    differing = re.compile(r"scene\.(car-\d{1,2}|car-102|car-103|truck-10[12]|bus-101|motorcycle-101|building-\d+)\.")
    common = [
        [definition for definition in manifest.parameters if not differing.match(definition.path)]
        for manifest in (first, second)
    ]
    assert common[0] == common[1]


@pytest.mark.parametrize("seed", [-1, "seven", 2**70, 1.5])
def test_a_seed_of_the_wrong_kind_is_refused(seed: object) -> None:
    with pytest.raises(InvalidInput, match=r"asset\.seed"):
        asset_manifest({"name": "urban-street", "seed": seed})
