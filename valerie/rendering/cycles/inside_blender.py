# SPDX-License-Identifier: Apache-2.0
"""The program that runs inside Blender's Python: reads scenes from one pipe, renders them with Cycles, answers into another.

Licence note. This program imports Blender (``bpy``, GPL-3.0-or-later). Its text is under Apache-2.0, which is compatible
with version 3 of the GPL; running together with Blender in one process, the whole is under GPL-3.0-or-later. It imports
nothing of VALERIE, and VALERIE imports nothing of it: the two are separate programs that exchange messages over pipes.
See docs/cycles.md.

``python -I inside_blender.py FOLDER``: FOLDER takes temporary pictures. A message is a header in JSON, after its length
(4 bytes, little-endian), and then the bytes of the arrays that the header lists under ``arrays``: {"name", "dtype",
"shape"}. Requests have a ``kind``: the name of a method of `Studio`. Every request gets one answer; while Cycles
renders, headers {"alive": true} come before it. End of the requests ends the program, and so does its parent's death.

Frames and units are those of the scene that is sent: world in metres, z up; a camera looks along −z; radiances are in
the unit of the picture that comes back (linear Rec. 709, float32, first row at the top).
"""

from __future__ import annotations

import ctypes
import json
import math
import os
import signal
import struct
import sys
import time
from collections.abc import Callable
from typing import Any

import numpy as np

_HEADER = struct.Struct("<I")
_PR_SET_PDEATHSIG = 1
#: Devices in the order in which "auto" takes them.
_DEVICES = ("OPTIX", "CUDA", "HIP", "ONEAPI", "METAL")
#: Size of the panorama in which the sky is measured.
_SKY_SIZE = (64, 32)


class Pipe:
    """One end of the conversation."""

    def __init__(self, requests: int, answers: int) -> None:
        self._requests = os.fdopen(requests, "rb", buffering=1 << 20)
        self._answers = os.fdopen(answers, "wb", buffering=1 << 20)
        self._signed = 0.0

    def read(self) -> tuple[dict[str, Any], dict[str, Any]] | None:
        """(header, arrays), or None at the end."""
        length = self._requests.read(_HEADER.size)
        if len(length) < _HEADER.size:
            return None
        header = json.loads(self._requests.read(_HEADER.unpack(length)[0]))
        arrays = {}
        for entry in header.get("arrays", ()):
            dtype, shape = np.dtype(entry["dtype"]), tuple(entry["shape"])
            data = self._requests.read(dtype.itemsize * math.prod(shape))
            arrays[entry["name"]] = np.frombuffer(data, dtype).reshape(shape)
        return header, arrays

    def write(self, header: dict[str, Any], arrays: dict[str, Any] | None = None) -> None:
        """Send one answer."""
        arrays = {name: np.ascontiguousarray(array) for name, array in (arrays or {}).items()}
        entries = [{"name": n, "dtype": a.dtype.str, "shape": list(a.shape)} for n, a in arrays.items()]
        text = json.dumps({**header, "arrays": entries}).encode()
        self._answers.write(_HEADER.pack(len(text)) + text)
        for array in arrays.values():
            self._answers.write(array.data)
        self._answers.flush()

    def alive(self, *_: Any) -> None:
        """A sign of life, at most two a second."""
        if time.monotonic() - self._signed > 0.5:
            self._signed = time.monotonic()
            self.write({"alive": True})


class Studio:
    """Blender with one scene, which follows what is asked for; only what differs is changed."""

    def __init__(self, bpy: Any, folder: str, pipe: Pipe) -> None:
        self._bpy = bpy
        self._folder = folder
        self._pipe = pipe
        self._skies: dict[tuple[float, float], float] = {}
        self._device = ("CPU", "")
        self._threads = 0
        self._clear()

    def hello(self, header: dict[str, Any], _: dict[str, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
        """Choose the device; say what there is."""
        self._threads = int(header["threads"])
        wanted = str(header["device"]).upper()
        preferences = self._bpy.context.preferences.addons["cycles"].preferences
        names: list[str] = []
        if wanted != "CPU":
            offered = {entry[0] for entry in preferences.get_device_types(self._bpy.context)}
            for kind in _DEVICES if wanted == "AUTO" else (wanted,):
                if kind not in offered:
                    continue
                devices = [d for d in preferences.get_devices_for_type(kind) or () if d.type == kind]
                if devices:
                    preferences.compute_device_type = kind
                    for device in preferences.devices:
                        device.use = device.type == kind
                    names = sorted({device.name for device in devices})
                    self._device = (kind, ", ".join(names))
                    break
        self._clear()
        return {"version": self._bpy.app.version_string, "device": self._device[0], "device_name": self._device[1]}, {}

    def reset(self, _: dict[str, Any], __: dict[str, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
        """Forget everything that was sent and everything that Cycles keeps."""
        self._clear()
        return {}, {}

    def forget(self, header: dict[str, Any], _: dict[str, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
        """Remove meshes, materials and textures, and what the last picture made of them."""
        data = self._bpy.data
        gone = {*header["meshes"], *header["materials"]}
        for name in [name for name, (_, state) in self._objects.items() if gone & {state[0], state[1]}]:
            data.objects.remove(self._objects.pop(name)[0])
        for key in header["meshes"]:
            data.meshes.remove(self._meshes.pop(key))
        for key in header["materials"]:
            data.materials.remove(self._materials.pop(key))
        for key in header["textures"]:
            data.images.remove(self._textures.pop(key))
        return {}, {}

    def mesh(self, header: dict[str, Any], arrays: dict[str, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
        """Positions (V, 3), normals (V, 3), uvs (V, 2; v downwards), faces (F, 3)."""
        faces = arrays["faces"].astype(np.int32)
        mesh = self._bpy.data.meshes.new(header["key"])
        mesh.vertices.add(len(arrays["positions"]))
        mesh.vertices.foreach_set("co", arrays["positions"].ravel())
        mesh.loops.add(faces.size)
        mesh.loops.foreach_set("vertex_index", faces.ravel())
        mesh.polygons.add(len(faces))
        mesh.polygons.foreach_set("loop_start", np.arange(0, faces.size, 3, dtype=np.int32))
        mesh.polygons.foreach_set("use_smooth", np.ones(len(faces), bool))
        corners = arrays["uvs"][faces.ravel()].copy()
        corners[:, 1] = 1 - corners[:, 1]
        mesh.uv_layers.new(name="uv").data.foreach_set("uv", corners.ravel())
        mesh.update(calc_edges=True)
        mesh.normals_split_custom_set_from_vertices(arrays["normals"])
        mesh.materials.append(None)
        self._meshes[header["key"]] = mesh
        return {}, {}

    def texture(self, header: dict[str, Any], arrays: dict[str, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
        """An (H, W, 3 or 4) uint8 image; ``color``: sRGB colour, else data."""
        pixels = arrays["image"]
        height, width, channels = pixels.shape
        image = self._bpy.data.images.new(header["key"], width, height, alpha=channels == 4)
        image.colorspace_settings.name = "sRGB" if header["color"] else "Non-Color"
        image.alpha_mode = "CHANNEL_PACKED"
        rgba = np.ones((height, width, 4), np.float32)
        rgba[..., :channels] = pixels[::-1] / np.float32(255)
        image.pixels.foreach_set(rgba.ravel())
        image.pack()
        self._textures[header["key"]] = image
        return {}, {}

    def material(self, header: dict[str, Any], _: dict[str, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
        """Blender's Principled BSDF with the numbers of ``header``."""
        material = self._bpy.data.materials.new(header["key"])
        material.use_nodes = True
        material.use_transparent_shadow = header["alpha_cutoff"] is not None or header["transmission"] > 0
        # The haze before a surface is an emission too, but no lamp.
        material.cycles.emission_sampling = "AUTO" if any(header["emissive"]) and not header["lens"] else "NONE"
        nodes = Nodes(material.node_tree)
        principled = nodes.add("ShaderNodeBsdfPrincipled")
        base: Any = nodes.color(header["base_color"])
        alpha = None
        if header["base_color_texture"] is not None:
            image = nodes.add("ShaderNodeTexImage")
            image.image = self._textures[header["base_color_texture"]]
            base, alpha = nodes.multiplied(image.outputs["Color"], header["base_color"]), image.outputs["Alpha"]
        nodes.link(base, principled.inputs["Base Color"])
        for name in ("metallic", "roughness"):
            principled.inputs[name.capitalize()].default_value = header[name]
        if header["roughness_texture"] is not None:
            image = nodes.add("ShaderNodeTexImage")
            image.image = self._textures[header["roughness_texture"]]
            channels = nodes.add("ShaderNodeSeparateColor")
            nodes.link(image.outputs["Color"], channels.inputs["Color"])
            for name, channel in (("metallic", "Blue"), ("roughness", "Green")):
                factor = nodes.math("MULTIPLY", channels.outputs[channel], header[name])
                nodes.link(factor, principled.inputs[name.capitalize()])
        # 1 stands for a reflectance of 4 %, which is half of the socket's range (index of refraction 1.5).
        principled.inputs["Specular IOR Level"].default_value = 0.5 * header["specular"]
        nodes.link(nodes.tinted(base, header["specular_tint"]), principled.inputs["Specular Tint"])
        principled.inputs["Emission Color"].default_value = (*header["emissive"], 1.0)
        principled.inputs["Emission Strength"].default_value = 1.0 if any(header["emissive"]) else 0.0
        if header["lens"]:
            # A lamp stands in front of it and gives the light: the glow is only looked at.
            seen = nodes.add("ShaderNodeLightPath").outputs["Is Camera Ray"]
            nodes.link(seen, principled.inputs["Emission Strength"])
        if header["normal_texture"] is not None:
            image = nodes.add("ShaderNodeTexImage")
            image.image = self._textures[header["normal_texture"]]
            bumps = nodes.add("ShaderNodeNormalMap")
            bumps.uv_map = "uv"
            nodes.link(image.outputs["Color"], bumps.inputs["Color"])
            nodes.link(bumps.outputs["Normal"], principled.inputs["Normal"])
        if header["wet"]:
            water = nodes.add("ShaderNodeGroup")
            water.node_tree = self._water
            nodes.feed_alike(water.inputs["Metallic"], principled.inputs["Metallic"])
            for name in ("Base Color", "Roughness", "Specular IOR Level"):
                nodes.feed_alike(water.inputs[name], principled.inputs[name])
                nodes.link(water.outputs[name], principled.inputs[name])
            if header["normal_texture"] is not None:
                nodes.link(water.outputs["Relief"], bumps.inputs["Strength"])
        surface = principled.outputs["BSDF"]
        if header["translucency"]:
            through = nodes.add("ShaderNodeBsdfTranslucent")
            nodes.link(base, through.inputs["Color"])
            surface = nodes.mixed(header["translucency"], surface, through.outputs["BSDF"])
        air = nodes.add("ShaderNodeGroup")
        air.node_tree = self._air
        nodes.link(surface, air.inputs[0])
        surface = air.outputs[0]
        if header["alpha_cutoff"] is not None and alpha is not None:
            cut = nodes.add("ShaderNodeMath")
            cut.operation = "LESS_THAN"
            cut.inputs[1].default_value = header["alpha_cutoff"]
            nodes.link(alpha, cut.inputs[0])
            clear = nodes.add("ShaderNodeBsdfTransparent")
            surface = nodes.mixed(cut.outputs[0], surface, clear.outputs["BSDF"])
        if header["transmission"]:
            # What is seen through a pane has its own haze, over the whole way.
            pane = nodes.add("ShaderNodeBsdfTransparent")
            surface = nodes.mixed(header["transmission"], surface, pane.outputs["BSDF"])
        if not header["double_sided"]:
            # Back faces are not there for the camera; light meets them, as a closed body's inside never sees any.
            seen = nodes.add("ShaderNodeLightPath").outputs["Is Camera Ray"]
            hidden = nodes.math("MULTIPLY", nodes.add("ShaderNodeNewGeometry").outputs["Backfacing"], seen)
            surface = nodes.mixed(hidden, surface, nodes.add("ShaderNodeBsdfTransparent").outputs["BSDF"])
        nodes.link(surface, nodes.add("ShaderNodeOutputMaterial").inputs["Surface"])
        self._materials[header["key"]] = material
        return {}, {}

    def render(self, header: dict[str, Any], arrays: dict[str, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
        """A picture (h, w, 3) float32 of the border (x, y, w, h), or what a denoiser is given for it with ``guides``, or with
        ``index`` the object index pass (h, w).
        """
        self._settings(header["settings"], header["size"], header["border"])
        self._camera_at(header["camera"])
        self._objects_at(header["objects"], arrays["matrices"])
        self._light(header["light"], header["sky"], arrays.get("sky"))
        self._lamps_at(header["lamps"])
        if header.get("index"):
            return {}, {"index": self._index()}
        if header.get("guides"):
            return {}, self._guided()
        return {}, {"pixels": self._picture()}

    def denoise(self, _: dict[str, Any], arrays: dict[str, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
        """What Cycles' own denoiser makes of ``noisy`` with the guides ``albedo`` and ``normal``, each (h, w, 3) float32."""
        bpy = self._bpy
        scene = bpy.data.scenes.new("denoise")
        scene.render.resolution_y, scene.render.resolution_x, _ = arrays["noisy"].shape
        scene.render.resolution_percentage = 100
        scene.render.threads_mode, scene.render.threads = self._scene.render.threads_mode, self._scene.render.threads
        images = {name: _float_image(bpy.data, name, arrays[name]) for name in ("noisy", "albedo", "normal")}

        def cleaned(nodes: Any) -> dict[str, Any]:
            cleaner = nodes.new("CompositorNodeDenoise")
            cleaner.use_hdr, cleaner.prefilter, cleaner.quality = True, "ACCURATE", "HIGH"
            for name, socket in (("noisy", "Image"), ("albedo", "Albedo"), ("normal", "Normal")):
                shown = nodes.new("CompositorNodeImage")
                shown.image = images[name]
                scene.node_tree.links.new(shown.outputs["Image"], cleaner.inputs[socket])
            return {"pixels": cleaner.outputs["Image"]}

        try:
            return {}, self._composited(scene, cleaned)
        finally:
            bpy.data.scenes.remove(scene)
            for image in images.values():
                bpy.data.images.remove(image)

    def _clear(self) -> None:
        bpy = self._bpy
        bpy.ops.wm.read_factory_settings(use_empty=True)
        bpy.app.handlers.render_stats.append(self._pipe.alive)
        self._meshes: dict[str, Any] = {}
        self._textures: dict[str, Any] = {}
        self._materials: dict[str, Any] = {}
        self._objects: dict[str, tuple[Any, tuple[Any, ...]]] = {}
        self._air: Any = _air_group(bpy)
        self._water: Any = _water_group(bpy)
        self._light_set: object = None
        self._lamps: list[dict[str, Any]] = []
        scene = self._scene = bpy.context.scene
        scene.render.engine = "CYCLES"
        scene.render.use_persistent_data = True
        scene.render.use_compositing = scene.render.use_sequencer = False
        scene.render.resolution_percentage = 100
        scene.render.threads_mode = "FIXED" if self._threads else "AUTO"
        if self._threads:
            scene.render.threads = self._threads
        scene.cycles.device = "CPU" if self._device[0] == "CPU" else "GPU"
        _write_floats(scene)
        self._camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
        self._sun = bpy.data.objects.new("sun", bpy.data.lights.new("sun", "SUN"))
        for thing in (self._camera, self._sun):
            scene.collection.objects.link(thing)
        scene.camera = self._camera
        scene.world = bpy.data.worlds.new("world")
        self._world = World(scene.world)

    def _settings(self, settings: dict[str, Any], size: list[int], border: list[int] | None) -> None:
        render, cycles = self._scene.render, self._scene.cycles
        width, height = size
        render.resolution_x, render.resolution_y = width, height
        render.use_border = render.use_crop_to_border = border is not None
        if border is not None:
            x, y, w, h = border
            # Blender and Cycles each cut these to whole pixels, in single precision: an edge that lies on a pixel's may come out
            # a pixel lower, and not in both. A little inside the pixel it is the same for both; rays are not moved by it.
            inside, bottom = 0.25, height - (y + h)
            render.border_min_x, render.border_max_x = (x + inside) / width, min((x + w + inside) / width, 1.0)
            render.border_min_y, render.border_max_y = (
                (bottom + inside) / height,
                min((bottom + h + inside) / height, 1.0),
            )
        cycles.samples = settings["samples"]
        cycles.seed = settings["seed"]
        cycles.use_adaptive_sampling = False
        cycles.use_denoising = settings["denoise"]
        if settings["denoise"]:
            cycles.denoiser = "OPENIMAGEDENOISE"
            cycles.denoising_input_passes = "RGB_ALBEDO_NORMAL"
            cycles.denoising_prefilter = "ACCURATE"
            cycles.denoising_quality = "HIGH"
            cycles.denoising_use_gpu = self._device[0] != "CPU"
        cycles.max_bounces = settings["max_bounces"]
        cycles.diffuse_bounces = cycles.glossy_bounces = cycles.transmission_bounces = settings["max_bounces"]
        cycles.transparent_max_bounces = 32
        cycles.use_light_tree = settings["light_tree"]
        cycles.sample_clamp_indirect = settings["clamp_indirect"]
        cycles.caustics_reflective = cycles.caustics_refractive = False
        cycles.pixel_filter_type = "BLACKMAN_HARRIS"
        cycles.filter_width = 1.5

    def _camera_at(self, camera: dict[str, Any]) -> None:
        data = self._camera.data
        data.type, data.sensor_fit = "PERSP", "HORIZONTAL"
        data.lens, data.sensor_width = camera["focal_length_mm"], camera["sensor_width_mm"]
        data.clip_start, data.clip_end = camera["near"], camera["far"]
        self._camera.matrix_world = _matrix(np.array(camera["matrix"]).reshape(4, 4))

    def _objects_at(self, wanted: list[dict[str, Any]], matrices: Any) -> None:
        data = self._bpy.data
        # Noise depends on the order of things. What is not in its place is removed and comes again in the order of a new scene.
        names = [entry["name"] for entry in wanted]
        kept = 0
        for name, there in zip(names, self._objects, strict=False):
            if name != there:
                break
            kept += 1
        for name in list(self._objects)[kept:]:
            data.objects.remove(self._objects.pop(name)[0])
        for entry, matrix in zip(wanted, matrices, strict=True):
            name = entry["name"]
            state = (entry["mesh"], entry["material"], entry["index"], matrix.tobytes())
            thing, known = self._objects.get(name, (None, ()))
            if known == state:
                continue
            mesh = self._meshes[entry["mesh"]]
            if thing is None:
                thing = data.objects.new(name, mesh)
                self._scene.collection.objects.link(thing)
            elif known[0] != entry["mesh"]:
                thing.data = mesh
            slot = thing.material_slots[0]
            slot.link = "OBJECT"
            slot.material = self._materials[entry["material"]]
            thing.pass_index = entry["index"]
            thing.matrix_world = _matrix(matrix)
            self._objects[name] = (thing, state)

    def _light(self, light: dict[str, Any], sky: dict[str, Any], panorama: Any) -> None:
        wanted = (light, sky, None if panorama is None else panorama.tobytes())
        if self._light_set == wanted:
            return
        strength = max(light["sun"])
        lamp = self._sun.data
        # Off is energy 0: a hidden lamp would come back in another place of Cycles' order, with other noise.
        # A white Lambert surface that faces the lamp shows its energy divided by π.
        lamp.energy = math.pi * strength
        lamp.color = [value / strength for value in light["sun"]] if strength > 0 else (1.0, 1.0, 1.0)
        lamp.angle = light["angular_diameter"]
        toward = np.array(light["toward_sun"])
        side = np.cross((0.0, 1.0, 0.0) if abs(toward[2]) > 0.9 else (0.0, 0.0, 1.0), toward)
        side /= np.linalg.norm(side)
        pose = np.eye(4)
        pose[:3, :3] = np.stack([side, np.cross(toward, side), toward], axis=1)
        self._sun.matrix_world = _matrix(pose)
        if panorama is not None:
            self._world.show_panorama(self._bpy.data, sky, panorama)
        else:
            self._world.show(sky, strength=sky["irradiance"] / self._unit_sky(sky) if sky["irradiance"] > 0 else 0.0)
        self._water.nodes["wetness"].outputs[0].default_value = light["wetness"]
        self._air.nodes["extinction"].outputs[0].default_value = -light["extinction"]
        self._air.nodes["haze"].inputs["Color"].default_value = (*light["haze"], 1.0)
        self._light_set = wanted

    def _lamps_at(self, wanted: list[dict[str, Any]]) -> None:
        """Point and spot lights; all are made anew when one differs, so that their order is that of the list."""
        if wanted == self._lamps:
            return
        data = self._bpy.data
        for index in range(len(self._lamps)):
            data.lights.remove(data.lights[f"lamp-{index}"])  # the object goes with its light
        for index, lamp in enumerate(wanted):
            spot = lamp["outer"] <= 0.5 * math.pi
            light = data.lights.new(f"lamp-{index}", "SPOT" if spot else "POINT")
            light.energy, light.color, light.shadow_soft_size = lamp["energy"], lamp["color"], lamp["radius"]
            if spot:
                # Blender fades from the rim inwards over a share of the cone.
                light.spot_size = 2 * lamp["outer"]
                light.spot_blend = 1 - math.tan(lamp["inner"] / 2) / math.tan(lamp["outer"] / 2)
            if lamp["beam"] is not None:
                _fill_dipped(light, lamp)
            thing = data.objects.new(f"lamp-{index}", light)
            away = -np.array(lamp["direction"])
            side = np.cross((0.0, 1.0, 0.0) if abs(away[2]) > 0.9 else (0.0, 0.0, 1.0), away)
            side /= np.linalg.norm(side)
            pose = np.eye(4)
            pose[:3, :3] = np.stack([side, np.cross(away, side), away], axis=1)
            pose[:3, 3] = lamp["position"]
            thing.matrix_world = _matrix(pose)
            self._scene.collection.objects.link(thing)
        self._lamps = wanted

    def _unit_sky(self, sky: dict[str, Any]) -> float:
        """Luminance of a white Lambert surface below Blender's sky at strength 1, measured in a panorama of it."""
        key = (sky["elevation"], sky["dust"])
        if key not in self._skies:
            bpy = self._bpy
            scene = bpy.data.scenes.new("sky")
            world = bpy.data.worlds.new("sky")
            World(world).show({**sky, "ground": [0.0, 0.0, 0.0]}, strength=1.0)
            lens = bpy.data.cameras.new("sky")
            lens.type, lens.panorama_type = "PANO", "EQUIRECTANGULAR"
            camera = bpy.data.objects.new("sky", lens)
            camera.rotation_euler = (math.pi / 2, 0.0, 0.0)
            scene.collection.objects.link(camera)
            scene.camera, scene.world = camera, world
            scene.render.engine = "CYCLES"
            scene.cycles.device = "CPU"
            scene.cycles.samples, scene.cycles.use_denoising = 4, False
            scene.cycles.use_adaptive_sampling = False
            scene.render.resolution_x, scene.render.resolution_y = width, height = _SKY_SIZE
            scene.render.resolution_percentage = 100
            _write_floats(scene)
            try:
                radiance = self._rendered(scene) @ np.array([0.2126, 0.7152, 0.0722])
            finally:
                for collection, thing in (
                    (bpy.data.scenes, scene),
                    (bpy.data.objects, camera),
                    (bpy.data.cameras, lens),
                    (bpy.data.worlds, world),
                ):
                    collection.remove(thing)
            latitude = math.pi / 2 - (np.arange(height) + 0.5) / height * math.pi
            weight = np.cos(latitude) * np.maximum(np.sin(latitude), 0) * (math.pi / height) * (2 * math.pi / width)
            self._skies[key] = max(float((radiance * weight[:, None]).sum() / math.pi), 1e-12)
        return self._skies[key]

    def _picture(self) -> Any:
        return self._rendered(self._scene)

    def _rendered(self, scene: Any) -> Any:
        path = f"{self._folder}/picture.exr"
        scene.render.filepath = path
        self._bpy.ops.render.render(write_still=True, scene=scene.name)
        return self._read(path)

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

    def _index(self) -> Any:
        """Cycles' object index of one sample in the middle of each pixel."""
        scene = self._scene
        layer = scene.view_layers[0]
        layer.use_pass_object_index = True
        scene.cycles.samples, scene.cycles.use_denoising, scene.cycles.filter_width = 1, False, 0.01
        scene.cycles.max_bounces = 0
        try:
            made = self._composited(scene, lambda nodes: {"index": _layers(nodes).outputs["IndexOB"]})
        finally:
            layer.use_pass_object_index = False
        return np.rint(made["index"][..., 0])

    def _guided(self) -> dict[str, Any]:
        """``noisy``, ``albedo`` and ``normal``, each (h, w, 3) float32, as Cycles' denoiser gets them."""
        layer = self._scene.view_layers[0]
        layer.cycles.denoising_store_passes = True
        names = {"noisy": "Image", "albedo": "Denoising Albedo", "normal": "Denoising Normal"}

        def passes(nodes: Any) -> dict[str, Any]:
            outputs = _layers(nodes).outputs
            return {name: outputs[output] for name, output in names.items()}

        try:
            return self._composited(self._scene, passes)
        finally:
            layer.cycles.denoising_store_passes = False

    def _composited(self, scene: Any, outputs: Callable[[Any], dict[str, Any]]) -> dict[str, Any]:
        """(h, w, 3) float32 of each output that ``outputs`` makes of the nodes of a scene's empty compositor."""
        scene.use_nodes, scene.render.use_compositing = True, True
        tree = scene.node_tree
        tree.nodes.clear()
        try:
            writer = tree.nodes.new("CompositorNodeOutputFile")
            writer.base_path = self._folder
            writer.format.file_format, writer.format.color_depth, writer.format.exr_codec = "OPEN_EXR", "32", "NONE"
            writer.file_slots.clear()
            wanted = outputs(tree.nodes)
            for name, output in wanted.items():
                writer.file_slots.new(f"{name}-")
                tree.links.new(output, writer.inputs[f"{name}-"])
            self._bpy.ops.render.render(scene=scene.name)
        finally:
            tree.nodes.clear()
            scene.render.use_compositing = False
        written = {name.partition("-")[0]: name for name in os.listdir(self._folder) if "-" in name}  # noqa: PTH208
        return {name: self._read(f"{self._folder}/{written[name]}") for name in wanted}


class Nodes:
    """A node tree that is built from empty."""

    def __init__(self, tree: Any) -> None:
        self._tree = tree
        tree.nodes.clear()

    def add(self, kind: str, name: str = "") -> Any:
        node = self._tree.nodes.new(kind)
        if name:
            node.name = name
        return node

    def link(self, output: Any, target: Any) -> None:
        self._tree.links.new(output, target)

    def color(self, rgb: Any) -> Any:
        node = self.add("ShaderNodeRGB")
        node.outputs[0].default_value = (*rgb, 1.0)
        return node.outputs[0]

    def feed_alike(self, target: Any, other: Any) -> None:
        """Give an input what another one has: its link, or its value."""
        if other.is_linked:
            self.link(other.links[0].from_socket, target)
        else:
            target.default_value = other.default_value

    def multiplied(self, output: Any, rgb: Any) -> Any:
        if tuple(rgb) == (1.0, 1.0, 1.0):
            return output
        return self._vector("MULTIPLY", output, rgb)

    def tinted(self, base: Any, share: float) -> Any:
        """White for 0, the hue of ``base`` at luminance 1 for 1."""
        if share <= 0:
            return self.color((1.0, 1.0, 1.0))
        gray = self.add("ShaderNodeRGBToBW")
        self.link(base, gray.inputs[0])
        hue = self._vector("DIVIDE", base, gray.outputs[0])
        return self._vector("MULTIPLY_ADD", hue, (share,) * 3, (1 - share,) * 3)

    def smoothstep(self, low: float, high: float, value: Any) -> Any:
        """0 below ``low``, 1 above ``high``, smooth between."""
        node = self.add("ShaderNodeMapRange")
        node.interpolation_type = "SMOOTHSTEP"
        self._feed(node, (value, low, high, 0.0, 1.0))
        return node.outputs[0]

    def between(self, first: Any, second: Any, share: Any) -> Any:
        """``first`` (1 − share) + ``second`` share."""
        return self.math("MULTIPLY_ADD", self.math("SUBTRACT", second, first), share, first)

    def scaled(self, vector: Any, factor: Any) -> Any:
        """A vector or colour times a number."""
        node = self.add("ShaderNodeVectorMath")
        node.operation = "SCALE"
        self.link(vector, node.inputs[0])
        self.link(factor, node.inputs["Scale"])
        return node.outputs[0]

    def mixed(self, share: Any, first: Any, second: Any) -> Any:
        """The first shader, with a share (a number or an output) of the second."""
        mix = self.add("ShaderNodeMixShader")
        if isinstance(share, float):
            mix.inputs[0].default_value = share
        else:
            self.link(share, mix.inputs[0])
        self.link(first, mix.inputs[1])
        self.link(second, mix.inputs[2])
        return mix.outputs[0]

    def math(self, operation: str, *operands: Any) -> Any:
        """A number from outputs and numbers."""
        node = self.add("ShaderNodeMath")
        node.operation = operation
        self._feed(node, operands)
        return node.outputs[0]

    def dot(self, vector: Any, direction: Any) -> Any:
        node = self.add("ShaderNodeVectorMath")
        node.operation = "DOT_PRODUCT"
        self._feed(node, (vector, tuple(direction)))
        return node.outputs["Value"]

    def _vector(self, operation: str, *operands: Any) -> Any:
        node = self.add("ShaderNodeVectorMath")
        node.operation = operation
        self._feed(node, operands)
        return node.outputs[0]

    def _feed(self, node: Any, operands: Any) -> None:
        for target, operand in zip(node.inputs, operands, strict=False):
            if isinstance(operand, int | float | tuple | list):
                target.default_value = operand
            else:
                self.link(operand, target)


class World:
    """The sky above the horizon, one colour below it."""

    def __init__(self, world: Any) -> None:
        world.use_nodes = True
        nodes = self._nodes = Nodes(world.node_tree)
        self._picture = nodes.add("ShaderNodeTexEnvironment")
        self._sky = nodes.add("ShaderNodeTexSky")
        self._sky.sky_type, self._sky.sun_disc = "NISHITA", False
        self._above = nodes.add("ShaderNodeBackground")
        self._below = nodes.add("ShaderNodeBackground")
        place = nodes.add("ShaderNodeTexCoord")
        parts = nodes.add("ShaderNodeSeparateXYZ")
        nodes.link(place.outputs["Generated"], parts.inputs[0])
        down = nodes.math("LESS_THAN", parts.outputs["Z"], 0.0)
        surface = nodes.mixed(down, self._above.outputs[0], self._below.outputs[0])
        nodes.link(surface, nodes.add("ShaderNodeOutputWorld").inputs["Surface"])

    def show(self, sky: dict[str, Any], strength: float) -> None:
        """Blender's sky of a sun ``rotation`` radians clockwise from +y, times ``strength``."""
        self._sky.sun_elevation, self._sky.sun_rotation = sky["elevation"], sky["rotation"] % (2 * math.pi)
        self._sky.dust_density = sky["dust"]
        self._nodes.link(self._sky.outputs["Color"], self._above.inputs["Color"])
        self._above.inputs["Strength"].default_value = strength
        self._below.inputs["Color"].default_value = (*sky["ground"], 1.0)

    def show_panorama(self, data: Any, sky: dict[str, Any], panorama: Any) -> None:
        """The sky of an equirectangular picture (H, W, 3), first row straight up."""
        old, image = self._picture.image, _float_image(data, "sky", panorama)
        self._picture.image = image
        if old is not None:
            data.images.remove(old)
        self._nodes.link(self._picture.outputs["Color"], self._above.inputs["Color"])
        self._above.inputs["Strength"].default_value = 1.0
        self._below.inputs["Color"].default_value = (*sky["ground"], 1.0)


def _air_group(bpy: Any) -> Any:
    """What the air between a surface and the camera does: fades it into the haze, exp(−extinction · distance)."""
    group = bpy.data.node_groups.new("air", "ShaderNodeTree")
    group.interface.new_socket("surface", in_out="INPUT", socket_type="NodeSocketShader")
    group.interface.new_socket("surface", in_out="OUTPUT", socket_type="NodeSocketShader")
    nodes = Nodes(group)
    given, result = nodes.add("NodeGroupInput"), nodes.add("NodeGroupOutput")
    extinction = nodes.add("ShaderNodeValue", "extinction")
    haze = nodes.add("ShaderNodeEmission", "haze")
    distance = nodes.add("ShaderNodeCameraData").outputs["View Distance"]
    clear = nodes.math("EXPONENT", nodes.math("MULTIPLY", distance, extinction.outputs[0]))
    hidden = nodes.math("SUBTRACT", 1.0, clear)
    seen = nodes.add("ShaderNodeLightPath").outputs["Is Camera Ray"]
    nodes.link(nodes.mixed(nodes.math("MULTIPLY", hidden, seen), given.outputs[0], haze.outputs[0]), result.inputs[0])
    return group


def _water_group(bpy: Any) -> Any:
    """Water on what faces up, as in the raster engine: full pores darken (Lekner and Dorf 1988,
    doi:10.1364/AO.27.001278), the film is smooth, fills the relief and reflects as water does, and stands in puddles and
    patches a metre or two wide.
    """
    group = bpy.data.node_groups.new("water", "ShaderNodeTree")
    sockets = {"Base Color": "Color", "Roughness": "Float", "Specular IOR Level": "Float"}
    for name, kind in {**sockets, "Metallic": "Float"}.items():
        group.interface.new_socket(name, in_out="INPUT", socket_type=f"NodeSocket{kind}")
    for name, kind in {**sockets, "Relief": "Float"}.items():
        group.interface.new_socket(name, in_out="OUTPUT", socket_type=f"NodeSocket{kind}")
    nodes = Nodes(group)
    given, result = nodes.add("NodeGroupInput").outputs, nodes.add("NodeGroupOutput").inputs
    geometry = nodes.add("ShaderNodeNewGeometry").outputs
    up, at = nodes.add("ShaderNodeSeparateXYZ"), nodes.add("ShaderNodeSeparateXYZ")
    nodes.link(geometry["Normal"], up.inputs[0])
    nodes.link(geometry["Position"], at.inputs[0])
    x, y = at.outputs["X"], at.outputs["Y"]

    def wave(along: Any, along_rate: float, across: Any, across_rate: float) -> Any:
        bent = nodes.math("MULTIPLY", nodes.math("SINE", nodes.math("MULTIPLY", across, across_rate)), 2.0)
        return nodes.math("SINE", nodes.math("MULTIPLY_ADD", along, along_rate, bent))

    dry = nodes.math("SUBTRACT", 1.0, given["Metallic"])
    wetness = nodes.add("ShaderNodeValue", "wetness").outputs[0]
    film = nodes.math("MULTIPLY", nodes.math("MULTIPLY", wetness, nodes.smoothstep(0.7, 0.95, up.outputs["Z"])), dry)
    pores = nodes.math("MULTIPLY", film, nodes.smoothstep(0.2, 0.6, given["Roughness"]))
    patch = nodes.math("MULTIPLY_ADD", nodes.math("MULTIPLY", wave(x, 1.9, y, 1.3), wave(y, 0.9, x, 0.7)), 0.5, 0.5)
    nodes.link(nodes.scaled(given["Base Color"], nodes.between(1.0, 0.5, pores)), result["Base Color"])
    smooth = nodes.between(given["Roughness"], nodes.between(0.32, 0.07, patch), film)
    nodes.link(smooth, result["Roughness"])
    # Half of the socket's range is a reflectance of 4 %.
    shining = nodes.math("MAXIMUM", given["Specular IOR Level"], 0.5 * 0.55)
    nodes.link(nodes.between(given["Specular IOR Level"], shining, film), result["Specular IOR Level"])
    nodes.link(nodes.between(1.0, 0.15, film), result["Relief"])
    return group


def _fill_dipped(light: Any, lamp: dict[str, Any]) -> None:
    """Give a spot light the emission of a dipped beam: `valerie.rendering.beams` has the formula."""
    light.use_nodes = True
    nodes, beam = Nodes(light.node_tree), lamp["beam"]
    # From the lamp to what it lights, in the world.
    way = nodes.add("ShaderNodeNewGeometry").outputs["Incoming"]
    ahead = nodes.dot(way, lamp["direction"])
    across = nodes.math("DIVIDE", nodes.dot(way, np.cross(lamp["direction"], lamp["up"]).tolist()), ahead)
    up = nodes.math("DIVIDE", nodes.dot(way, lamp["up"]), ahead)
    cut_off = nodes.math("MULTIPLY", nodes.math("MAXIMUM", across, 0.0), beam["rise"])
    below = nodes.smoothstep(0.0, beam["edge"], nodes.math("SUBTRACT", cut_off, up))
    cut = nodes.math("MULTIPLY_ADD", below, 1.0 - beam["stray"], beam["stray"])

    def fall(tangent: Any, spread: float) -> Any:
        off = nodes.math("MULTIPLY", tangent, 1.0 / spread)
        return nodes.math("MULTIPLY_ADD", off, off, 1.0)

    off_axis = nodes.math(
        "POWER", nodes.math("MULTIPLY", fall(across, beam["spread"][0]), fall(up, beam["spread"][1])), 2.0
    )
    emission = nodes.add("ShaderNodeEmission")
    nodes.link(nodes.math("DIVIDE", cut, off_axis), emission.inputs["Strength"])
    nodes.link(emission.outputs[0], nodes.add("ShaderNodeOutputLight").inputs["Surface"])


def _write_floats(scene: Any) -> None:
    settings = scene.render.image_settings
    settings.file_format, settings.color_mode = "OPEN_EXR", "RGB"
    settings.color_depth, settings.exr_codec = "32", "NONE"


def _layers(nodes: Any) -> Any:
    return nodes.new("CompositorNodeRLayers")


def _float_image(data: Any, name: str, pixels: Any) -> Any:
    """An image of (H, W, 3) float32 values, first row at the top, which nothing converts."""
    height, width, _ = pixels.shape
    image = data.images.new(name, width, height, float_buffer=True, alpha=False)
    image.colorspace_settings.name = "Linear Rec.709"
    rgba = np.ones((height, width, 4), np.float32)
    rgba[..., :3] = pixels[::-1]
    image.pixels.foreach_set(rgba.ravel())
    image.pack()
    return image


def _matrix(matrix: Any) -> Any:
    from mathutils import Matrix

    return Matrix(matrix.tolist())


def _die_with_parent() -> None:
    """Ask the kernel to end this process when its parent ends, however it ends (Linux)."""
    if sys.platform == "linux":
        parent = os.getppid()
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
        if os.getppid() != parent:
            os._exit(1)


def main(folder: str) -> None:
    """Answer requests until there are no more."""
    _die_with_parent()
    # Blender prints to standard output; the conversation goes over copies.
    requests, answers = os.dup(0), os.dup(1)
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    os.dup2(2, 1)
    pipe = Pipe(requests, answers)
    import bpy

    studio = Studio(bpy, folder, pipe)
    cpu = time.process_time()
    while (request := pipe.read()) is not None:
        header, arrays = request
        try:
            answer, made = getattr(studio, header["kind"])(header, arrays)
        except Exception as error:
            answer, made = {"error": f"{type(error).__name__}: {error}".strip()}, {}
        now = time.process_time()
        pipe.write({**answer, "cpu_seconds": now - cpu}, made)
        cpu = now
    # Blender's own end reports every block that it did not free, and takes its time.
    os._exit(0)


if __name__ == "__main__":
    main(sys.argv[1])
