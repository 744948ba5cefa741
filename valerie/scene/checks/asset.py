"""The check of a whole asset. It returns all findings and raises no error."""

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
from valerie.scene.checks.doubts import Doubt, Severity, from_error
from valerie.scene.checks.names import name_findings
from valerie.scene.checks.shapes import shape_findings
from valerie.scene.checks.views import view_findings
from valerie.scene.graph.draft import Draft
from valerie.scene.graph.naming import ROOT
from valerie.scene.legality.rejection import rejection_reason
from valerie.scene.variation.variant import apply


def asset_findings(folder: Path) -> list[Doubt]:
    """Return the findings of a user's asset; an empty list for a sound one.

    Runs cannot use an asset with errors. The scene is checked only if manifest and files have none.

    Args:
        folder: contains ``manifest.yaml`` and the files that it lists.
    """
    from valerie.scene.assets.gltf_scene import merge
    from valerie.scene.gltf.common import FilePart
    from valerie.scene.gltf.reader import read_gltf

    try:
        manifest, asset_digest, files = read_manifest(folder)
    except InvalidInput as error:
        return list(from_error(error, "manifest"))
    findings: list[Doubt] = []
    parts: dict[str, FilePart] = {}
    for name, path in files.items():
        try:
            parts[name] = read_gltf(path, folder)
        except InvalidInput as error:
            findings += from_error(error, "file", file=name)
        else:
            findings += [Doubt(Severity.NOTE, "reading", name, note) for note in parts[name].notes]
    if len(parts) < len(files):
        return findings
    if not any(part.sun for name, part in parts.items() if name in manifest.files):
        findings.append(
            Doubt(
                Severity.NOTE,
                "no-light",
                "scene.sun-1",
                "no file has a directional light: a late morning's sun is used",
            )
        )
    try:
        scene = merge(parts, manifest)
    except InvalidInput as error:
        return [*findings, *from_error(error, "scene")]
    asset = SceneAsset(manifest, asset_digest, scene)
    return [*findings, *scene_findings(asset)]


def scene_findings(asset: SceneAsset) -> Iterator[Doubt]:
    """Yield findings on the scene and the declarations of a loaded asset of any origin."""
    yield from name_findings(asset.base, asset.manifest)
    for problem in declared_problems(asset.base, asset.manifest):
        yield from from_error(problem, "declared")
    # Missing nodes are reported by now. The remaining checks ignore them.
    present = _without_missing(asset)
    yield from _outline_findings(present.manifest)
    unusable: list[Doubt] = []
    try:
        scene = apply({}, present)
    except InvalidInput:
        unusable, present = _without_unusable(present)
        scene = apply({}, present)
    yield from unusable
    yield from shape_findings(scene, present.manifest)
    yield from view_findings(scene, present)


def _without_missing(asset: SceneAsset) -> SceneAsset:
    """Return the asset with a manifest that does not name missing nodes and cameras."""
    manifest, scene = asset.manifest, asset.base
    gaps = {*missing_nodes(scene, manifest)}
    gaps |= {f"{ROOT}.{camera}" for camera in manifest.cameras if camera not in scene.cameras}
    if not gaps:
        return asset

    def is_present(path: str) -> bool:
        return not any(path == other or path.startswith(f"{other}.") for other in gaps)

    fields = {
        "persons": tuple(filter(is_present, manifest.persons)),
        "movable": tuple(filter(is_present, manifest.movable)),
        "grounded": tuple(filter(is_present, manifest.grounded)),
        "node_classes": {path: kind for path, kind in manifest.node_classes.items() if is_present(path)},
        "parameters": tuple(parameter for parameter in manifest.parameters if is_present(parameter.path)),
        "cameras": tuple(camera for camera in manifest.cameras if is_present(f"{ROOT}.{camera}")),
        "trajectories": tuple(trajectory for trajectory in manifest.trajectories if is_present(trajectory.path)),
    }
    return replace(asset, manifest=manifest.model_copy(update=fields))


def _without_unusable(asset: SceneAsset) -> tuple[list[Doubt], SceneAsset]:
    """Return findings on parameters whose defaults the scene refuses, and the asset without these parameters."""
    findings: list[Doubt] = []
    usable: list[ParameterDefinition] = []
    for parameter in asset.manifest.parameters:
        path, attribute = resolve(parameter.path, asset.manifest.cameras)
        try:
            attribute.write(Draft(asset.base), path, parameter.check(parameter.default))
        except InvalidInput as error:
            findings.append(Doubt(Severity.ERROR, "declared", parameter.path, error.message, error.value, error.limit))
        else:
            usable.append(parameter)
    return findings, replace(asset, manifest=asset.manifest.model_copy(update={"parameters": tuple(usable)}))


def _outline_findings(manifest: Manifest) -> Iterator[Doubt]:
    for index, obstacle in enumerate(manifest.obstacles):
        if not shapely.Polygon(obstacle.polygon).is_valid:
            yield Doubt(
                Severity.ERROR,
                "outline",
                f"obstacles.{index}",
                f"the footprint of {obstacle.path} crosses itself: give its corners in order",
            )
    for path in _without_outline(manifest):
        yield Doubt(
            Severity.NOTE,
            "no-outline",
            path,
            "it moves, but has no outline under obstacles: variants in which it stands in something are not rejected",
        )
    try:
        reason = rejection_reason(_camera_defaults(manifest), manifest)
    except ValerieError as error:
        yield Doubt(Severity.ERROR, "outline", "obstacles", str(error))
        return
    if reason:
        yield Doubt(
            Severity.WARNING,
            "rejected-default",
            "parameters",
            f"with every parameter at its default, {reason}: such a variant is rejected",
        )


def _without_outline(manifest: Manifest) -> Iterator[str]:
    """Yield the nodes without an outline, other than persons, that parameters move."""
    cameras = {f"{ROOT}.{camera}" for camera in manifest.cameras}
    outlined = [obstacle.path for obstacle in manifest.obstacles]
    for path in dict.fromkeys(p.path.rpartition(".pos.")[0] for p in manifest.parameters if ".pos." in p.path):
        is_other = path in cameras or path in manifest.persons or path.count(".") != 1
        if not is_other and not any(outline == path or outline.startswith(f"{path}.") for outline in outlined):
            yield path


def _camera_defaults(manifest: Manifest) -> Mapping[str, float]:
    """Return an assignment with all coordinates of the cameras, since cameras are judged only if it gives them."""
    return {
        path: float(manifest.by_path[path].default)
        for camera in manifest.cameras
        for path in (f"scene.{camera}.pos.{axis}" for axis in "xyz")
        if path in manifest.by_path
    }
