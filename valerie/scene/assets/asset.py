"""Scene assets: a manifest, a base scene and a digest, from a generator or from files.

`asset_manifest` is cheap (no meshes, no trimesh) and is what the API, the planner and the control loop use;
`load_asset` builds everything and is what render workers use.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from importlib import import_module
from pathlib import Path
from typing import Any, Final, Protocol, cast

from pydantic import BaseModel, ConfigDict, ValidationError

from valerie.errors import InvalidInput, InvalidInputs, UnknownName
from valerie.parameters.assignment import canonical_json, digest
from valerie.scene.assets.manifest import Manifest
from valerie.scene.assets.objects import require_declared
from valerie.scene.graph.model import Scene

#: An asset in a spec: its name, or a mapping of name and generator arguments, e.g. {name: urban-street, seed: 7}.
AssetReference = str | Mapping[str, Any]


@dataclass(frozen=True, slots=True, eq=False)
class SceneAsset:
    """A scene that variants are made from.

    Attributes:
        manifest: what may vary, what moves, where one can stand.
        digest: stands for everything that the base scene depends on; 32 hexadecimal characters.
        base: the scene as it was built or read, before any parameter (`valerie.scene.variation.applying.apply`).
    """

    manifest: Manifest
    digest: str
    base: Scene

    @property
    def name(self) -> str:
        return self.manifest.name


class GeneratorSettings(BaseModel):
    """Base of what a generator can be told; the fields are keys of an asset reference."""

    model_config = ConfigDict(frozen=True, extra="forbid")


class Generator(Protocol):
    """A module that makes an asset from a few arguments; equal settings give equal bytes."""

    #: Raised by hand whenever the generated scene changes.
    REVISION: int
    #: What the generator can be told.
    Settings: type[GeneratorSettings]

    def make_manifest(self, settings: Any) -> Manifest:
        """The manifest alone: no meshes."""
        ...

    def make_scene(self, settings: Any, manifest: Manifest) -> Scene:
        """The base scene; labels, instances and movability are as the manifest says."""
        ...


#: Built-in assets: name to the module that is their generator (imported when asked for).
GENERATORS: Final[Mapping[str, str]] = {
    "urban-street": "urban_street.asset",
}


def asset_names(asset_dir: Path | None = None) -> tuple[str, ...]:
    """Names that `load_asset` knows: the built-in ones and, sorted, the folders of ``asset_dir`` with a manifest."""
    from valerie.scene.assets.asset_files import MANIFEST_FILE

    found: list[str] = []
    if asset_dir is not None and asset_dir.is_dir():
        found = sorted(p.name for p in asset_dir.iterdir() if (p / MANIFEST_FILE).is_file())
    return (*GENERATORS, *(name for name in found if name not in GENERATORS))


def asset_manifest(reference: AssetReference, *, asset_dir: Path | None = None) -> tuple[Manifest, str]:
    """The manifest and the digest of an asset, without meshes.

    Args:
        reference: a name, a mapping of name and generator arguments, or (without ``asset_dir``) a folder's path.
        asset_dir: where users' assets lie; names then never lead outside of it.

    Raises:
        UnknownName: no such asset, or an argument that its generator does not take.
        InvalidInput: the manifest, an argument or a file is not usable.
    """
    name, arguments = _parse_reference(reference)
    if name in GENERATORS:
        return _generated_manifest(name, canonical_json(_settings(name, arguments).model_dump(mode="json")))
    from valerie.scene.assets.asset_files import read_manifest

    manifest, files_digest, _ = read_manifest(_asset_folder(name, arguments, asset_dir))
    return manifest, files_digest


def load_asset(reference: AssetReference, *, asset_dir: Path | None = None) -> SceneAsset:
    """Build or read a whole asset; takes seconds, so callers keep what they load (by digest).

    Args and errors: as `asset_manifest`; also InvalidInput when scene and manifest do not fit together.
    """
    name, arguments = _parse_reference(reference)
    if name in GENERATORS:
        manifest, asset_digest = asset_manifest(reference)
        scene = _generator(name).make_scene(_settings(name, arguments), manifest)
    else:
        from valerie.scene.assets.asset_files import read_manifest, read_scene

        folder = _asset_folder(name, arguments, asset_dir)
        manifest, asset_digest, files = read_manifest(folder)
        scene = read_scene(manifest, files, folder)
    require_declared(scene, manifest)
    return SceneAsset(manifest, asset_digest, scene)


def _parse_reference(reference: AssetReference) -> tuple[str, dict[str, Any]]:
    if isinstance(reference, str):
        return reference, {}
    arguments = dict(reference)
    name = arguments.pop("name", None)
    if not isinstance(name, str):
        raise InvalidInput("an asset mapping has a name", field="asset.name", value=name, limit="as urban-street")
    return name, arguments


def _generator(name: str) -> Generator:
    return cast("Generator", import_module(GENERATORS[name]))


def _settings(name: str, arguments: Mapping[str, Any]) -> GeneratorSettings:
    settings = _generator(name).Settings
    for argument in arguments:
        if argument not in settings.model_fields:
            raise UnknownName(f"argument of {name}", argument, settings.model_fields, field="asset")
    try:
        return settings.model_validate(dict(arguments))
    except ValidationError as error:
        raise InvalidInputs(
            [
                InvalidInput(
                    problem["msg"], field=".".join(("asset", *map(str, problem["loc"]))), value=problem["input"]
                )
                for problem in error.errors(include_url=False)
            ]
        ) from None


@lru_cache(maxsize=16)
def _generated_manifest(name: str, settings_json: bytes) -> tuple[Manifest, str]:
    generator = _generator(name)
    settings = generator.Settings.model_validate_json(settings_json)
    return generator.make_manifest(settings), digest("generated-asset", name, settings_json, generator.REVISION)


def _asset_folder(name: str, arguments: Mapping[str, Any], asset_dir: Path | None) -> Path:
    if arguments:
        raise UnknownName("argument", next(iter(arguments)), (), field="asset")
    if asset_dir is None:
        folder = Path(name)
        if not folder.is_dir():
            raise UnknownName("asset", name, GENERATORS, field="asset")
        return folder
    if name not in asset_names(asset_dir):
        # Only names of the folder's own entries are accepted, so no path can lead outside of it.
        raise UnknownName("asset", name, asset_names(asset_dir), field="asset")
    return asset_dir / name
