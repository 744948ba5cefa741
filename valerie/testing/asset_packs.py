"""Contract of asset packs: subclass `AssetContract`, set the asset's name, and run it with pytest."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import lru_cache
from typing import ClassVar

import numpy as np
import pytest

from valerie.errors import UnknownName
from valerie.scene.assets.asset import (
    AssetArguments,
    AssetPack,
    SceneAsset,
    asset_manifest,
    asset_names,
    load_asset,
    load_pack,
)
from valerie.scene.assets.attributes import resolve
from valerie.scene.assets.manifest import Manifest
from valerie.scene.graph.model import Mesh, Scene
from valerie.scene.legality.rejection import rejection_reason
from valerie.scene.variation.variant import apply
from valerie.testing.scenes import assert_same_scene

#: Number of textures of a scene whose texels are compared.
_COMPARED_TEXTURES = 3


class AssetContract:
    """Tests of an asset pack; a subclass sets ``name`` and ``other``. An entry point must offer the pack, and the operator must
    allow it.

    Attributes:
        name: name of the asset.
        arguments: further arguments of the asset under test. Few and small parts make the tests fast.
        other: arguments of a different asset.
    """

    name: str
    arguments: ClassVar[AssetArguments] = {}
    other: ClassVar[AssetArguments]

    @pytest.fixture
    def pack(self) -> AssetPack:
        """Return the pack under test."""
        return load_pack(self.name)

    @pytest.fixture
    def asset(self) -> SceneAsset:
        """Return the asset under test. It is loaded once."""
        return _loaded(json.dumps({"name": self.name, **self.arguments}))

    def test_it_is_offered_by_its_name(self) -> None:
        assert self.name in asset_names()
        manifest, _ = asset_manifest(self.name)
        assert manifest.name == self.name

    def test_the_manifest_takes_no_mesh(self, pack: AssetPack, monkeypatch: pytest.MonkeyPatch) -> None:
        def refuse(_mesh: Mesh) -> None:
            raise AssertionError("the manifest creates a mesh")

        monkeypatch.setattr(Mesh, "__post_init__", refuse)
        assert pack.make_manifest(pack.Settings()).parameters

    def test_the_manifest_can_be_written_and_read(self, asset: SceneAsset) -> None:
        assert Manifest.model_validate_json(asset.manifest.model_dump_json()) == asset.manifest

    def test_equal_settings_give_equal_bytes(self, pack: AssetPack) -> None:
        settings = pack.Settings(**self.arguments)
        manifest = pack.make_manifest(settings)
        assert manifest == pack.make_manifest(pack.Settings(**self.arguments))
        first, second = (_visible_part(pack.make_scene(settings, manifest)) for _ in range(2))
        assert_same_scene(first, second)

    def test_arguments_at_their_defaults_name_the_same_asset_and_others_another(self, pack: AssetPack) -> None:
        _, digest = asset_manifest(self.name)
        defaults = pack.Settings().model_dump(mode="json")
        assert asset_manifest({"name": self.name, **defaults})[1] == digest
        assert asset_manifest({"name": self.name, **self.other})[1] != digest

    def test_an_unknown_argument_is_refused(self) -> None:
        with pytest.raises(UnknownName, match="no_such_argument"):
            asset_manifest({"name": self.name, "no_such_argument": 1})

    def test_every_parameter_is_of_something_in_the_scene(self, asset: SceneAsset) -> None:
        # `load_asset` refuses a declared node or camera that is missing.
        scene = apply({}, asset)
        for path in asset.manifest.by_path:
            thing, attribute = resolve(path, asset.manifest.cameras)
            assert attribute.read(scene, thing) is not None, path

    def test_the_default_variant_is_legal(self, asset: SceneAsset) -> None:
        assert rejection_reason({}, asset.manifest) is None

    def test_arguments_for_training_are_arguments_of_the_pack_and_follow_from_the_seed(self, pack: AssetPack) -> None:
        for seed in range(20):
            first, second = (pack.draw_arguments(np.random.default_rng(seed)) for _ in range(2))
            assert first == second
            pack.Settings(**first)


@lru_cache(maxsize=2)
def _loaded(reference: str) -> SceneAsset:
    arguments: AssetArguments = json.loads(reference)
    return load_asset(arguments)


def _visible_part(scene: Scene) -> Scene:
    """Return the scene with only the meshes of visible nodes and few textures. Packs may create hidden meshes on demand."""
    nodes = {path: node if node.visible else replace(node, meshes=()) for path, node in scene.nodes.items()}
    names = sorted(scene.textures)
    few = names[:: max(1, len(names) // _COMPARED_TEXTURES)]
    return replace(scene, nodes=nodes, textures={name: scene.textures[name] for name in few})
