"""Scene assets: a manifest, a base scene and a digest, from an asset pack or from a folder of files.

`asset_manifest` is cheap (no meshes, no trimesh); the API, the planner and the control loop use it. `load_asset` builds
everything; render workers use it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any, Final, Protocol, cast

import numpy as np
from pydantic import ValidationError

from valerie.document import Document
from valerie.entry_points import PluginKind
from valerie.errors import InvalidInput, MissingDependency, UnknownName
from valerie.parameters.assignment import canonical_json, digest
from valerie.parameters.definitions import Value
from valerie.scene.assets.manifest import Manifest
from valerie.scene.assets.objects import require_declared
from valerie.scene.graph.model import Scene
from valerie.validation import problems_of

#: Arguments of an asset pack by name, as its ``Settings`` declares them.
AssetArguments = dict[str, Value]
#: An asset in a spec: its name, or a mapping of name and arguments of its pack, e.g. its seed.
AssetReference = str | Mapping[str, Value]


@dataclass(frozen=True, slots=True, eq=False)
class SceneAsset:
    """A base scene with its manifest, from which variants are built.

    Attributes:
        manifest: declares the parameters, the movables, and the ground where people can stand.
        digest: 32 hexadecimal characters that identify all inputs of the base scene.
        base: the scene as built or read, before any parameter is applied (`valerie.scene.variation.variant.apply`).
    """

    manifest: Manifest
    digest: str
    base: Scene

    @property
    def name(self) -> str:
        return self.manifest.name


class PackSettings(Document):
    """Base class of the settings of an asset pack. The fields are keys of an asset reference."""


class AssetPack(Protocol):
    """A module that generates an asset from a few arguments. Equal settings give equal bytes.

    A distribution declares it as an entry point of the group ``valerie.assets``: the asset's name, and the module.
    `valerie.testing.asset_packs.AssetContract` tests the contract.
    """

    #: Part of the asset's digest. Raise it by hand whenever the generated scene changes.
    REVISION: int
    #: Arguments of the pack.
    Settings: type[PackSettings]

    def make_manifest(self, settings: Any) -> Manifest:
        """Return the manifest in milliseconds, without meshes."""
        ...

    def make_scene(self, settings: Any, manifest: Manifest) -> Scene:
        """Build the base scene, with the labels, instances and movables of the manifest."""
        ...

    def draw_arguments(self, rng: np.random.Generator) -> AssetArguments:
        """Draw the arguments of a training scene besides its seed. Empty if the pack derives everything from the seed.

        Args:
            rng: source of all random choices.
        """
        ...


#: Names of asset packs, and their modules.
PACKS: Final = PluginKind("asset", "valerie.assets")
#: Those of the packs that apply if none is named.
_DEFAULTS: Final = PluginKind("asset", "valerie.default_asset")


def asset_names(asset_dir: Path | None = None) -> tuple[str, ...]:
    """Return the names that `load_asset` knows: the packs, the default first, then the folders of ``asset_dir``, sorted."""
    from valerie.scene.assets.asset_folder import MANIFEST_FILE

    packs, folders = _packs(), list[str]()
    if asset_dir is not None and asset_dir.is_dir():
        folders = sorted(p.name for p in asset_dir.iterdir() if (p / MANIFEST_FILE).is_file())
    return (*packs, *(name for name in folders if name not in packs))


def default_pack() -> str:
    """Return the pack that applies if none is named: the declared default, this distribution's first.

    Raises:
        MissingDependency: no pack is installed.
    """
    if not (names := _packs()):
        raise MissingDependency(f"no asset pack is installed (entry points of {PACKS.group})")
    return names[0]


def _packs() -> tuple[str, ...]:
    """Return the names of the packs: the declared default, then the others by name, this distribution's first."""
    names = PACKS.names()
    return (*(name for name in _DEFAULTS.names() if name in names), *(n for n in names if n not in _DEFAULTS.names()))


def is_generated(name: str) -> bool:
    """Return True if an asset of this name comes from a pack, which generates a new scene from every seed."""
    return name in PACKS.names()


def load_pack(name: str) -> AssetPack:
    """Import an asset pack.

    Raises:
        UnknownName, InvalidInput, MissingDependency: see `valerie.entry_points.PluginKind.load`.
    """
    return cast("AssetPack", PACKS.load(name))


def asset_manifest(reference: AssetReference, *, asset_dir: Path | None = None) -> tuple[Manifest, str]:
    """Return the manifest and the digest of an asset, without meshes.

    Args:
        reference: a name, a mapping of name and arguments of a pack, or (without ``asset_dir``) a folder's path.
        asset_dir: folder of users' assets. Names then never refer to anything outside it.

    Raises:
        UnknownName: there is no such asset, or its pack has no such argument.
        InvalidInput: the manifest, an argument or a file is invalid, or the operator does not allow the pack.
    """
    name, arguments = parse_reference(reference)
    if is_generated(name):
        return _generated_manifest(name, canonical_json(pack_settings(name, arguments).model_dump(mode="json")))
    from valerie.scene.assets.asset_folder import read_manifest

    manifest, files_digest, _ = read_manifest(_asset_folder(name, arguments, asset_dir))
    return manifest, files_digest


def load_asset(reference: AssetReference, *, asset_dir: Path | None = None) -> SceneAsset:
    """Build or read a whole asset. This takes seconds, so callers cache assets by digest.

    Arguments and errors are those of `asset_manifest`, and InvalidInput if scene and manifest contradict each other.
    """
    name, arguments = parse_reference(reference)
    if is_generated(name):
        manifest, asset_digest = asset_manifest(reference)
        scene = load_pack(name).make_scene(pack_settings(name, arguments), manifest)
    else:
        from valerie.scene.assets.asset_folder import read_manifest, read_scene

        folder = _asset_folder(name, arguments, asset_dir)
        manifest, asset_digest, files = read_manifest(folder)
        scene = read_scene(manifest, files, folder)
    require_declared(scene, manifest)
    return SceneAsset(manifest, asset_digest, replace(scene, paints=manifest.paints))


def parse_reference(reference: AssetReference) -> tuple[str, AssetArguments]:
    """Return the name of an asset, and the arguments of its pack.

    Raises:
        InvalidInput: a mapping without a name.
    """
    if isinstance(reference, str):
        return reference, {}
    arguments = dict(reference)
    name = arguments.pop("name", None)
    if not isinstance(name, str):
        raise InvalidInput("an asset mapping needs a name", field="asset.name", value=name, limit="{name: …}")
    return name, arguments


def pack_settings(name: str, arguments: Mapping[str, Value]) -> PackSettings:
    """Return the settings of a pack, with its defaults.

    Raises:
        UnknownName, InvalidInputs: the pack has no such argument; or as `load_pack`.
    """
    settings = load_pack(name).Settings
    for argument in arguments:
        if argument not in settings.model_fields:
            raise UnknownName(f"argument of {name}", argument, settings.model_fields, field="asset")
    try:
        return settings.model_validate(dict(arguments))
    except ValidationError as error:
        raise problems_of(error, "asset") from None


@lru_cache(maxsize=16)
def _generated_manifest(name: str, settings_json: bytes) -> tuple[Manifest, str]:
    pack = load_pack(name)
    settings = pack.Settings.model_validate_json(settings_json)
    return pack.make_manifest(settings), digest("generated-asset", name, settings_json, pack.REVISION)


def _asset_folder(name: str, arguments: AssetArguments, asset_dir: Path | None) -> Path:
    if asset_dir is None:
        folder = Path(name)
        if not folder.is_dir():
            raise PACKS.unknown(name, PACKS.names(), field="asset")
    else:
        folder = asset_dir / name
        if name not in asset_names(asset_dir):
            # Only names of the folder's own entries are accepted, so no path can lead outside it.
            if "/" in name:
                limit = "the name of a folder in VALERIE_ASSET_DIR"
                raise UnknownName("asset", name, asset_names(asset_dir), field="asset", limit=limit)
            raise PACKS.unknown(name, asset_names(asset_dir), field="asset")
    if arguments:
        raise UnknownName("argument", next(iter(arguments)), (), field="asset")
    return folder
