"""Measure CPU seconds and bytes per frame of `raster` and of stock pyrender on the same variants of the paper's pattern.

Pattern: 3 cameras × 4 suns × 30 poses at 1920 × 1080 (section 6 of the paper; poses drawn from `examples/paper-pattern.yaml`).
A frame is the linear image, class, instance and depth maps and amodal masks, encoded and written to a folder.
Each engine runs in its own single-threaded process; CPU seconds are those of the whole process, including Python.

- ``raster.cold``: the first frame of each (camera, sun), with its background; every fourth of them has a new camera too.
- ``raster.warm``: the other frames.
- ``pyrender``: the same data from pyrender 0.1.45 as its users call it: the scene with its default 4× MSAA and sun shadows as
  8-bit RGB, a SEG pass for ids and depth, one SEG pass per person for the amodal mask; stored with the codecs of this project.

``python -m benchmarks.bench_render [--poses 30] [--pyrender-frames 24]`` writes ``var/bench/render.json``.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import results
from valerie.parameters.definitions import Value
from valerie.rendering.base import GroundTruth, LinearImage, PersonTruth, View
from valerie.scene.assets.asset import SceneAsset, load_asset
from valerie.scene.graph.model import Scene
from valerie.scene.legality.rejection import rejection_reason
from valerie.scene.variation.variant import apply
from valerie.storage import codecs
from valerie.storage.store import open_store

CAMERAS = ("camera-1", "camera-2", "camera-3")
SUNS_DEG = (120.0, 165.0, 210.0, 255.0)
WIDTH, HEIGHT = 1920, 1080


def poses(asset: SceneAsset, count: int) -> list[dict[str, Value]]:
    """Return legal places, headings and outfits of the paper's pattern, drawn uniformly with a fixed seed."""
    random = np.random.default_rng(6)
    places: list[dict[str, Value]] = []
    while len(places) < count:
        pose: dict[str, Value] = {
            "scene.person-1.pos.x": float(random.integers(-2, 8)),
            "scene.person-1.pos.y": float(5 + 2 * random.integers(0, 16)),
            "scene.person-1.heading": float(45 * random.integers(0, 8)),
            "scene.person-1.character": ("black-outfit", "yellow-shirt")[int(random.integers(0, 2))],
        }
        if rejection_reason(pose, asset.manifest) is None:
            places.append(pose)
    return places


def variants(asset: SceneAsset, count: int) -> Iterator[tuple[str, float, list[dict[str, Value]]]]:
    """Return (camera, sun, poses with that sun) of each group."""
    drawn = poses(asset, count)
    for camera in CAMERAS:
        for sun in SUNS_DEG:
            yield camera, sun, [{**pose, "scene.sun-1.azimuth": sun} for pose in drawn]


def triangles(scene: Scene) -> int:
    """Return the number of triangles drawn."""
    hidden = {path for path, node in scene.nodes.items() if not node.visible}
    return sum(
        len(mesh.faces)
        for path, node in scene.nodes.items()
        if not any(path == above or path.startswith(f"{above}.") for above in hidden)
        for mesh in node.meshes
    )


class Writer:
    """Folder for artifacts, with a count of their bytes."""

    def __init__(self, folder: str) -> None:
        self._store = open_store(folder)
        self.bytes: dict[str, list[int]] = {}
        self._number = 0

    def put(self, kind: str, data: bytes) -> None:
        self._number += 1
        self._store.put(f"{kind}/{self._number:06d}.zst", data)
        self.bytes.setdefault(kind, []).append(len(data))


def measure_raster(count: int) -> dict[str, Any]:
    from valerie import plugins

    asset = load_asset("urban-street")
    engine, truth_pass = plugins.create_renderer("raster"), plugins.create_truth_pass("")
    cold: list[float] = []
    warm: list[float] = []
    statics: GroundTruth | None = None
    statics_digest = ""
    with tempfile.TemporaryDirectory(prefix="valerie-bench-") as folder:
        out = Writer(folder)
        # Shaders are compiled and meshes uploaded once per process.
        small = View(CAMERAS[0], 96, 54)
        for values in poses(asset, 8):
            scene = apply(values, asset)
            engine.background(scene, small)
            engine.layer(scene, small)
            truth_pass.truth(scene, small)
        for camera, _, group in variants(asset, count):
            view = View(camera, WIDTH, HEIGHT)
            for i, values in enumerate(group):
                started = time.process_time()
                scene = apply(values, asset)
                if i == 0:
                    background = engine.background(scene, view)
                    out.put("background", codecs.encode_image(background))
                layer = engine.layer(scene, view)
                seen, truth = truth_pass.parts(scene, view)
                if seen is not statics:
                    statics = seen
                    statics_digest = codecs.statics_digest(statics)
                    out.put("statics", codecs.encode_truth(statics))
                out.put("layer", codecs.encode_layer(layer))
                out.put("truth", codecs.encode_truth_layer(truth, statics_digest))
                (warm if i else cold).append(time.process_time() - started)
                if i == 0:
                    out.put("whole image", codecs.encode_image(layer.over(background)))
                    out.put("whole truth", codecs.encode_truth(truth.over(seen)))
        sizes = {kind: float(np.mean(values)) for kind, values in out.bytes.items()}
        return {
            "numeric_class": engine.numeric_class,
            "triangles": triangles(scene),
            "cpu_s_per_frame": round(float(np.mean(warm)), 4),
            "cpu_s_per_frame_p95": round(float(np.quantile(warm, 0.95)), 4),
            "warm_frames": len(warm),
            "cold_cpu_s_per_frame": round(float(np.mean(cold)), 3),
            "cold_frames": len(cold),
            "bytes": {kind: round(size) for kind, size in sizes.items()},
            "disk_share_of_whole_frames": round(
                (sizes["layer"] + sizes["truth"]) / (sizes["whole image"] + sizes["whole truth"]), 4
            ),
        }


def measure_pyrender(count: int, frames: int) -> dict[str, Any]:
    """Measure stock pyrender: its own renderer, materials and passes, without this project's engine."""
    asset = load_asset("urban-street")
    chosen = [
        (camera, values) for camera, _, group in variants(asset, count) for values in group[:: max(1, count // 2)][:2]
    ][:frames]
    seconds: list[float] = []
    with tempfile.TemporaryDirectory(prefix="valerie-bench-") as folder:
        out = Writer(folder)
        stock = StockPyrender(asset)
        for i, (camera, values) in enumerate([chosen[0], *chosen]):
            started = time.process_time()
            image, truth = stock.frame(apply(values, asset), View(camera, WIDTH, HEIGHT))
            out.put("image", codecs.encode_image(image))
            out.put("truth", codecs.encode_truth(truth))
            if i:  # The first frame uploads and compiles.
                seconds.append(time.process_time() - started)
    return {"cpu_s_per_frame": round(float(np.mean(seconds)), 3), "frames": len(seconds)}


class StockPyrender:
    """Renderer of VALERIE's scenes with stock pyrender."""

    def __init__(self, asset: SceneAsset) -> None:
        os.environ.setdefault("PYOPENGL_PLATFORM", "egl")
        if not hasattr(np, "infty"):
            np.infty = np.inf  # type: ignore[attr-defined]  # noqa: NPY201  pyrender 0.1.45 needs the name
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            import pyrender
        self._library = pyrender
        self._renderer = pyrender.OffscreenRenderer(WIDTH, HEIGHT)
        self._meshes: dict[int, Any] = {}
        self._asset = asset

    def frame(self, scene: Scene, view: View) -> tuple[LinearImage, GroundTruth]:
        from valerie.rendering.scene_reading import draw_items

        library = self._library
        target = library.Scene(bg_color=[0.6, 0.7, 0.9], ambient_light=[0.3, 0.3, 0.3])
        nodes: dict[Any, tuple[int, int]] = {}
        for movable in (False, True):
            for item in draw_items(scene, movable=movable):
                mesh = self._mesh(item.meshes, scene)
                if mesh is not None:
                    nodes[target.add(mesh, pose=item.world)] = (item.node.label_id, item.node.instance_id)
        camera = scene.cameras[view.camera]
        focal = camera.focal_length_px(view.width)
        lens = library.IntrinsicsCamera(focal, focal, view.width / 2, view.height / 2, camera.near, camera.far)
        target.add(lens, pose=camera.transform)
        toward = scene.sun_direction()
        pose = np.eye(4)
        right = np.cross([0.0, 0.0, 1.0], toward)
        pose[:3, 0] = right / np.linalg.norm(right)
        pose[:3, 1], pose[:3, 2] = np.cross(toward, pose[:3, 0]), toward
        target.add(library.DirectionalLight(color=np.ones(3), intensity=4.0), pose=pose)
        flags = library.RenderFlags
        rgb, _ = self._renderer.render(target, flags=flags.SHADOWS_DIRECTIONAL)
        colors = {node: (1 + i % 255, i // 255, 0) for i, node in enumerate(nodes)}
        seg, depth = self._renderer.render(target, flags=flags.SEG, seg_node_map=colors)
        number = seg[..., 0].astype(np.int64) + 255 * seg[..., 1]
        ids = np.array([(23, 0), *nodes.values()])
        classes, instances = ids[number, 0].astype(np.uint8), ids[number, 1].astype(np.uint16)
        persons = []
        for instance in sorted({instance for label, instance in nodes.values() if label == 24}):
            for node, (_, other) in nodes.items():
                node.mesh.is_visible = other == instance
            alone, _ = self._renderer.render(target, flags=flags.SEG, seg_node_map=colors)
            amodal = alone.any(axis=2)
            persons.append(PersonTruth.of(instance, amodal, int(amodal.sum())))
        for node in nodes:
            node.mesh.is_visible = True
        linear = ((rgb / np.float32(255)) ** np.float32(2.2)).astype(np.float16)
        axis_depth = np.where(depth > 0, depth, np.inf).astype(np.float32)
        return LinearImage(linear), GroundTruth(classes, instances, axis_depth, tuple(persons))

    def _mesh(self, meshes: Any, scene: Scene) -> Any:
        """Return the pyrender mesh of a node, created once; None without meshes. Nodes share none, since ids are per node."""
        if not meshes:
            return None
        key = id(meshes)
        if key not in self._meshes:
            library = self._library
            primitives = []
            for mesh in meshes:
                material = scene.materials[mesh.material]
                texture = scene.textures.get(material.base_color_texture or "")
                image = None
                if texture is not None:
                    image = library.Texture(source=np.ascontiguousarray(texture.image[..., :3]), source_channels="RGB")
                primitives.append(
                    library.Primitive(
                        positions=mesh.positions,
                        normals=mesh.normals,
                        texcoord_0=mesh.uvs if image is not None else None,
                        indices=mesh.faces,
                        material=library.MetallicRoughnessMaterial(
                            baseColorFactor=(*material.base_color, 1.0),
                            baseColorTexture=image,
                            metallicFactor=material.metallic,
                            roughnessFactor=material.roughness,
                            doubleSided=material.double_sided,
                        ),
                    )
                )
            self._meshes[key] = (meshes, library.Mesh(primitives))
        return self._meshes[key][1]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--poses", type=int, default=30, help="number of poses per camera and sun")
    parser.add_argument("--pyrender-frames", type=int, default=24)
    parser.add_argument("--engine", choices=("raster", "pyrender"), help="one engine, in this process, as JSON")
    arguments = parser.parse_args()
    if arguments.engine == "raster":
        print(json.dumps(measure_raster(arguments.poses)))
        return
    if arguments.engine == "pyrender":
        print(json.dumps(measure_pyrender(arguments.poses, arguments.pyrender_frames)))
        return
    figures: dict[str, Any] = {"width": WIDTH, "height": HEIGHT, "cameras": CAMERAS, "suns_deg": SUNS_DEG}
    figures["poses"] = arguments.poses
    for engine in ("raster", "pyrender"):
        process = subprocess.run(
            [
                sys.executable, "-m", "benchmarks.bench_render", f"--engine={engine}", f"--poses={arguments.poses}",
                f"--pyrender-frames={arguments.pyrender_frames}",
            ],
            capture_output=True, text=True, check=False, cwd=Path(__file__).parents[1],
            env={**os.environ, "LP_NUM_THREADS": "0", "OMP_NUM_THREADS": "1"},
        )  # fmt: skip
        if process.returncode:
            raise SystemExit(process.stderr)
        figures[engine] = json.loads(process.stdout.strip().splitlines()[-1])
        print(f"{engine:10}", json.dumps(figures[engine]), flush=True)
    figures["ratio"] = round(figures["pyrender"]["cpu_s_per_frame"] / figures["raster"]["cpu_s_per_frame"], 1)
    print(
        f"{figures['raster']['triangles']} triangles; pyrender needs {figures['ratio']} times the CPU seconds of raster"
    )
    results.write("render", figures)


if __name__ == "__main__":
    main()
