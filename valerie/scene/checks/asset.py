"""A user's asset from its folder to a list of findings: everything at once, nothing raised."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path

import shapely

from valerie.errors import InvalidInput, ValerieError
from valerie.parameters.definitions import ParameterDefinition
from valerie.scene.assets.asset import SceneAsset
from valerie.scene.assets.asset_folder import read_manifest
from valerie.scene.assets.attributes import resolve
from valerie.scene.assets.manifest import Manifest
from valerie.scene.assets.objects import declared_problems, missing_nodes
from valerie.scene.checks.findings import Finding, Severity, from_error
from valerie.scene.checks.names import name_findings
from valerie.scene.checks.shapes import shape_findings
from valerie.scene.checks.views import view_findings
from valerie.scene.graph.draft import Draft
from valerie.scene.graph.naming import ROOT
from valerie.scene.legality.rejection import rejection_reason
from valerie.scene.variation.variant import apply


def asset_findings(folder: Path) -> list[Finding]:
    """Check a user's asset; an empty list means that nothing was found.

    Errors keep runs from using the asset; while there are some in the manifest or in files, the scene is not looked at.

    Args:
        folder: with ``manifest.yaml`` and the files that it lists.
    """
    from valerie.scene.assets.gltf_scene import merge
    from valerie.scene.gltf.common import FilePart
    from valerie.scene.gltf.reader import read_gltf

    try:
        manifest, asset_digest, files = read_manifest(folder)
    except InvalidInput as error:
        return list(from_error(error, "manifest"))
    findings: list[Finding] = []
    parts: dict[str, FilePart] = {}
    for name, path in files.items():
        try:
            parts[name] = read_gltf(path, folder)
        except InvalidInput as error:
            findings += from_error(error, "file", file=name)
        else:
            findings += [Finding(Severity.NOTE, "reading", name, note) for note in parts[name].notes]
    if len(parts) < len(files):
        return findings
    if not any(part.sun for name, part in parts.items() if name in manifest.files):
        findings.append(
            Finding(
                Severity.NOTE,
                "no-light",
                "scene.sun-1",
                "no file has a directional light: the sun of a late morning shines",
            )
        )
    try:
        scene = merge(parts, manifest)
    except InvalidInput as error:
        return [*findings, *from_error(error, "scene")]
    asset = SceneAsset(manifest, asset_digest, scene)
    return [*findings, *scene_findings(asset)]


def scene_findings(asset: SceneAsset) -> Iterator[Finding]:
    """Check what a loaded asset holds and declares, wherever it comes from."""
    yield from name_findings(asset.base, asset.manifest)
    for problem in declared_problems(asset.base, asset.manifest):
        yield from from_error(problem, "declared")
    # What is missing was named; everything else is judged as if the manifest did not speak of it.
    there = _of_what_is_there(asset)
    yield from _outline_findings(there.manifest)
    unusable: list[Finding] = []
    try:
        scene = apply({}, there)
    except InvalidInput:
        unusable, there = _without_unusable(there)
        scene = apply({}, there)
    yield from unusable
    yield from shape_findings(scene, there.manifest)
    yield from view_findings(scene, there)


def _of_what_is_there(asset: SceneAsset) -> SceneAsset:
    """The asset with a manifest that names no node and no camera that its scene lacks."""
    manifest, scene = asset.manifest, asset.base
    missing = {*missing_nodes(scene, manifest)}
    missing |= {f"{ROOT}.{camera}" for camera in manifest.cameras if camera not in scene.cameras}
    if not missing:
        return asset

    def there(path: str) -> bool:
        return not any(path == other or path.startswith(f"{other}.") for other in missing)

    changed = {
        "persons": tuple(filter(there, manifest.persons)),
        "movable": tuple(filter(there, manifest.movable)),
        "grounded": tuple(filter(there, manifest.grounded)),
        "node_classes": {path: kind for path, kind in manifest.node_classes.items() if there(path)},
        "parameters": tuple(parameter for parameter in manifest.parameters if there(parameter.path)),
        "cameras": tuple(camera for camera in manifest.cameras if there(f"{ROOT}.{camera}")),
        "trajectories": tuple(trajectory for trajectory in manifest.trajectories if there(trajectory.path)),
    }
    return replace(asset, manifest=manifest.model_copy(update=changed))


def _without_unusable(asset: SceneAsset) -> tuple[list[Finding], SceneAsset]:
    """What is wrong with parameters whose defaults the scene cannot take, and the asset without them."""
    findings: list[Finding] = []
    usable: list[ParameterDefinition] = []
    for parameter in asset.manifest.parameters:
        thing, attribute = resolve(parameter.path, asset.manifest.cameras)
        try:
            attribute.write(Draft(asset.base), thing, parameter.check(parameter.default))
        except InvalidInput as error:
            findings.append(
                Finding(Severity.ERROR, "declared", parameter.path, error.message, error.value, error.limit)
            )
        else:
            usable.append(parameter)
    return findings, replace(asset, manifest=asset.manifest.model_copy(update={"parameters": tuple(usable)}))


def _outline_findings(manifest: Manifest) -> Iterator[Finding]:
    for index, obstacle in enumerate(manifest.obstacles):
        if not shapely.Polygon(obstacle.polygon).is_valid:
            yield Finding(
                Severity.ERROR,
                "outline",
                f"obstacles.{index}",
                f"the footprint of {obstacle.path} crosses itself: give its corners in order",
            )
    for path in _without_outline(manifest):
        yield Finding(
            Severity.NOTE,
            "no-outline",
            path,
            "it moves, and no outline under obstacles tells which ground it takes: variants in which it stands in something are "
            "not rejected",
        )
    try:
        reason = rejection_reason(_camera_defaults(manifest), manifest)
    except ValerieError as error:
        yield Finding(Severity.ERROR, "outline", "obstacles", str(error))
        return
    if reason:
        yield Finding(
            Severity.WARNING,
            "rejected-default",
            "parameters",
            f"with every parameter at its default, {reason}: such a variant is rejected",
        )


def _without_outline(manifest: Manifest) -> Iterator[str]:
    """Things, but for persons, that parameters put elsewhere and whose ground is not known."""
    cameras = {f"{ROOT}.{camera}" for camera in manifest.cameras}
    outlined = [obstacle.path for obstacle in manifest.obstacles]
    for path in dict.fromkeys(p.path.rpartition(".pos.")[0] for p in manifest.parameters if ".pos." in p.path):
        judged = path in cameras or path in manifest.persons or path.count(".") != 1
        if not judged and not any(one == path or one.startswith(f"{path}.") for one in outlined):
            yield path


def _camera_defaults(manifest: Manifest) -> Mapping[str, float]:
    """Cameras are judged where all their coordinates are given."""
    return {
        path: float(manifest.by_path[path].default)
        for camera in manifest.cameras
        for path in (f"scene.{camera}.pos.{axis}" for axis in "xyz")
        if path in manifest.by_path
    }
