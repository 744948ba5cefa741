# SPDX-License-Identifier: Apache-2.0
"""Images into and out of Blender."""

from __future__ import annotations

import os
from collections.abc import Callable
from typing import Any

import numpy as np

from .pipe import ByName


class Film:
    """Renders images through files in a folder, Blender's only way of returning unchanged linear values."""

    def __init__(self, bpy: Any, folder: str) -> None:
        self._bpy = bpy
        self._folder = folder

    def image(self, scene: Any) -> Any:
        """Render a scene and return its image, (h, w, 3) float32, first row at the top."""
        path = f"{self._folder}/image.exr"
        scene.render.filepath = path
        self._bpy.ops.render.render(write_still=True, scene=scene.name)
        return self._read(path)

    def index(self, scene: Any) -> Any:
        """Return Cycles' object index, (h, w), from one sample at each pixel centre."""
        layer = scene.view_layers[0]
        layer.use_pass_object_index = True
        scene.cycles.samples, scene.cycles.use_denoising, scene.cycles.filter_width = 1, False, 0.01
        scene.cycles.max_bounces = 0
        try:
            passes = self._composited(
                scene, lambda nodes: {"index": nodes.new("CompositorNodeRLayers").outputs["IndexOB"]}
            )
        finally:
            layer.use_pass_object_index = False
        return np.rint(passes["index"][..., 0])

    def guided(self, scene: Any) -> ByName:
        """Return the inputs of Cycles' denoiser: ``noisy``, ``albedo`` and ``normal``, each (h, w, 3) float32."""
        layer = scene.view_layers[0]
        layer.cycles.denoising_store_passes = True
        names = {"noisy": "Image", "albedo": "Denoising Albedo", "normal": "Denoising Normal"}

        def passes(nodes: Any) -> ByName:
            outputs = nodes.new("CompositorNodeRLayers").outputs
            return {name: outputs[output] for name, output in names.items()}

        try:
            return self._composited(scene, passes)
        finally:
            layer.cycles.denoising_store_passes = False

    def denoised(self, threads: int, arrays: ByName) -> ByName:
        """Denoise ``noisy`` with Cycles' own denoiser and the guides ``albedo`` and ``normal``, each (h, w, 3) float32."""
        bpy = self._bpy
        scene = bpy.data.scenes.new("denoise")
        scene.render.resolution_y, scene.render.resolution_x, _ = arrays["noisy"].shape
        scene.render.resolution_percentage = 100
        take_threads(scene, threads)
        images = {name: float_image(bpy.data, name, arrays[name]) for name in ("noisy", "albedo", "normal")}

        def denoiser_output(nodes: Any) -> ByName:
            denoiser = nodes.new("CompositorNodeDenoise")
            denoiser.use_hdr, denoiser.prefilter, denoiser.quality = True, "ACCURATE", "HIGH"
            for name, socket in (("noisy", "Image"), ("albedo", "Albedo"), ("normal", "Normal")):
                source = nodes.new("CompositorNodeImage")
                source.image = images[name]
                scene.node_tree.links.new(source.outputs["Image"], denoiser.inputs[socket])
            return {"pixels": denoiser.outputs["Image"]}

        try:
            return self._composited(scene, denoiser_output)
        finally:
            bpy.data.scenes.remove(scene)
            for image in images.values():
                bpy.data.images.remove(image)

    def _composited(self, scene: Any, outputs: Callable[[Any], ByName]) -> ByName:
        """Render a scene and return an image, (h, w, 3) float32, of each output that ``outputs`` adds to its compositor."""
        scene.use_nodes, scene.render.use_compositing = True, True
        tree = scene.node_tree
        tree.nodes.clear()
        try:
            writer = tree.nodes.new("CompositorNodeOutputFile")
            writer.base_path = self._folder
            writer.format.file_format, writer.format.color_depth, writer.format.exr_codec = "OPEN_EXR", "32", "NONE"
            writer.file_slots.clear()
            sockets = outputs(tree.nodes)
            for name, output in sockets.items():
                writer.file_slots.new(f"{name}-")
                tree.links.new(output, writer.inputs[f"{name}-"])
            self._bpy.ops.render.render(scene=scene.name)
        finally:
            tree.nodes.clear()
            scene.render.use_compositing = False
        files = {name.partition("-")[0]: name for name in os.listdir(self._folder) if "-" in name}  # noqa: PTH208
        return {name: self._read(f"{self._folder}/{files[name]}") for name in sockets}

    def _read(self, path: str) -> Any:
        image = self._bpy.data.images.load(path)
        try:
            width, height = image.size
            pixels = np.empty(width * height * 4, np.float32)
            image.pixels.foreach_get(pixels)
        finally:
            self._bpy.data.images.remove(image)
            os.unlink(path)  # noqa: PTH108
        return pixels.reshape(height, width, 4)[::-1, :, :3]


def take_threads(scene: Any, threads: int) -> None:
    """Set the number of threads that render a scene; 0 for one per core."""
    scene.render.threads_mode = "FIXED" if threads else "AUTO"
    if threads:
        scene.render.threads = threads


def write_floats(scene: Any) -> None:
    """Make Blender write a scene's images with their linear float values."""
    settings = scene.render.image_settings
    settings.file_format, settings.color_mode = "OPEN_EXR", "RGB"
    settings.color_depth, settings.exr_codec = "32", "NONE"


def float_image(data: Any, name: str, pixels: Any) -> Any:
    """Return a Blender image of (H, W, 3) float32 linear values, first row at the top, without colour conversion."""
    height, width, _ = pixels.shape
    image = data.images.new(name, width, height, float_buffer=True, alpha=False)
    image.colorspace_settings.name = "Linear Rec.709"
    rgba = np.ones((height, width, 4), np.float32)
    rgba[..., :3] = pixels[::-1]
    image.pixels.foreach_set(rgba.ravel())
    image.pack()
    return image
