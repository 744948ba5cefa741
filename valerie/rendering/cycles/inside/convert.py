# SPDX-License-Identifier: Apache-2.0
"""Convert a .blend file to one binary glTF file.

``python -m inside.convert FILE.blend OUT.glb REPORT.json``. The program opens the file with scripts off: Blender executes neither
text blocks nor Python in drivers, only driver arithmetic that it considers safe. Images from outside the file's own folder are
left out. REPORT.json lists what was left out.
"""

from __future__ import annotations

import json
import os
import sys
from typing import Any

from .pipe import Message
from .process import die_with_parent


def convert(bpy: Any, source: str, target: str) -> list[str]:
    """Convert ``source`` to ``target``, and return a sentence for each part that was left out."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.context.preferences.filepaths.use_scripts_auto_execute = False
    bpy.ops.wm.open_mainfile(filepath=source, load_ui=False, use_scripts=False)
    notes = []
    if bpy.app.autoexec_fail:
        notes.append(
            f"scripts of the file are not run ({bpy.app.autoexec_fail_message}): values that they would set are as saved, or 0"
        )
    notes += [f"the file links {library.filepath}, which is converted with it" for library in bpy.data.libraries]
    notes += drop_images(bpy, os.path.dirname(os.path.realpath(source)))  # noqa: PTH120
    notes += procedural_materials(bpy)
    bpy.ops.export_scene.gltf(
        filepath=target,
        export_format="GLB",
        export_yup=True,
        export_apply=True,
        export_cameras=True,
        export_lights=True,
        export_animations=False,
        export_skins=False,
        export_morph=False,
        export_extras=False,
        export_image_format="AUTO",
        check_existing=False,
    )
    return notes


def drop_images(bpy: Any, folder: str) -> list[str]:
    """Remove images that are missing or outside a folder, and return a sentence for each."""
    notes = []
    for image in list(bpy.data.images):
        if image.source not in {"FILE", "TILED"} or image.packed_file is not None:
            continue
        path = os.path.realpath(bpy.path.abspath(image.filepath))
        if os.path.commonpath([path, folder]) != folder:
            notes.append(f"image {image.name} is left out: {image.filepath} is outside the file's folder; pack it")
        elif image.source == "FILE" and not os.path.isfile(path):  # noqa: PTH113
            notes.append(f"image {image.name} is left out: {image.filepath} is missing")
        else:
            continue
        bpy.data.images.remove(image)
    return notes


def procedural_materials(bpy: Any) -> list[str]:
    """Return a sentence for each material whose colour glTF cannot represent."""
    notes = []
    for material in bpy.data.materials:
        if not material.users or not material.use_nodes or material.node_tree is None:
            continue
        for node in material.node_tree.nodes:
            if node.type != "BSDF_PRINCIPLED":
                continue
            links = node.inputs["Base Color"].links
            if links and links[0].from_node.type not in {"TEX_IMAGE", "RGB", "MIX", "VERTEX_COLOR"}:
                notes.append(f"material {material.name}: its procedural colour is not converted; bake it to an image")
    return notes


def main(source: str, target: str, report: str) -> None:
    """Convert a file, and write {"version", "notes"} or {"error"} to the report."""
    die_with_parent()
    import bpy

    try:
        result: Message = {"version": bpy.app.version_string, "notes": convert(bpy, source, target)}
    except Exception as error:
        result = {"error": f"{type(error).__name__}: {error}".strip()}
    with open(report, "w", encoding="utf-8") as file:  # noqa: PTH123
        json.dump(result, file)
    # Blender's regular exit reports every memory block that it did not free, and may hang.
    os._exit(0)


if __name__ == "__main__":
    main(*sys.argv[1:])
