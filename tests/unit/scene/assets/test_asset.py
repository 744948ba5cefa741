"""References to assets: names, arguments, digests, and what the cheap manifest must not load."""

import re
import subprocess
import sys

import pytest

from valerie.errors import InvalidInput, UnknownName
from valerie.scene.assets.asset import asset_manifest, asset_names


def test_the_built_in_street_is_known_by_name() -> None:
    manifest, digest = asset_manifest("urban-street")
    assert manifest.name == "urban-street"
    assert len(digest) == 32
    assert "urban-street" in asset_names()


def test_a_mapping_with_the_default_arguments_is_the_same_asset() -> None:
    assert asset_manifest({"name": "urban-street", "seed": 0}) == asset_manifest("urban-street")


def test_another_seed_is_another_asset() -> None:
    (one, one_digest), (other, other_digest) = (
        asset_manifest({"name": "urban-street", "seed": seed}) for seed in (0, 7)
    )
    assert one_digest != other_digest
    assert one.obstacles != other.obstacles
    # Which cars are parked where, where later vehicles begin and which houses stand there differ; all else is declared alike.
    differing = re.compile(r"scene\.(car-\d{1,2}|car-102|truck-101|bus-101|motorcycle-101|building-\d+)\.")
    common = [
        [definition for definition in manifest.parameters if not differing.match(definition.path)]
        for manifest in (one, other)
    ]
    assert common[0] == common[1]


def test_an_unknown_asset_lists_near_matches() -> None:
    with pytest.raises(UnknownName, match="urban-street"):
        asset_manifest("urban-streets")


def test_an_unknown_argument_lists_near_matches() -> None:
    with pytest.raises(UnknownName, match="seed"):
        asset_manifest({"name": "urban-street", "sed": 7})


@pytest.mark.parametrize("seed", [-1, "seven", 2**70, 1.5])
def test_an_argument_of_the_wrong_kind_names_its_field(seed: object) -> None:
    with pytest.raises(InvalidInput, match=r"asset\.seed"):
        asset_manifest({"name": "urban-street", "seed": seed})


def test_an_asset_mapping_without_name_is_refused() -> None:
    with pytest.raises(InvalidInput, match="name"):
        asset_manifest({"seed": 7})


@pytest.mark.processes
def test_the_manifest_loads_neither_mesh_nor_graphics_libraries() -> None:
    code = (
        "import sys; from valerie.scene.assets.asset import asset_manifest; asset_manifest('urban-street');"
        "print(sorted(m for m in ('trimesh', 'pygltflib', 'cv2', 'moderngl', 'pyrender', 'torch') if m in sys.modules))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
