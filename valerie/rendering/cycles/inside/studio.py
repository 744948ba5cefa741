# SPDX-License-Identifier: Apache-2.0
"""The requests that Blender answers.

Coordinate frames and units are those of VALERIE: world in metres, z up; a camera looks along −z; radiances are in the unit of the
returned image (linear Rec. 709, float32, first row at the top).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from .film import Film, take_threads, write_floats
from .light import BlenderLight
from .materials import Materials
from .pipe import ByName, Message, Pipe
from .placing import matrix_of

#: Devices in the order of preference of "auto".
_DEVICES = ("OPTIX", "CUDA", "HIP", "ONEAPI", "METAL")


class Studio:
    """Blender with one scene. A request changes only what differs from the last one."""

    def __init__(self, bpy: Any, folder: str, pipe: Pipe) -> None:
        self._bpy = bpy
        self._pipe = pipe
        self._film = Film(bpy, folder)

    def hello(self, header: Message, arrays: ByName) -> tuple[Message, ByName]:
        """Choose the device and report it. Keep the constants and reliefs of surfaces, as many as `Materials` uses."""
        self._threads = int(header["threads"])
        self._choice = str(header["device"]).upper()
        self._constants, self._reliefs = header["constants"], arrays["reliefs"]
        self._clear()
        return {"version": self._bpy.app.version_string, "device": self._device[0], "device_name": self._device[1]}, {}

    def reset(self, _: Message, __: ByName) -> tuple[Message, ByName]:
        """Clear the scene and Cycles' persistent data."""
        self._clear()
        return {}, {}

    def forget(self, header: Message, _: ByName) -> tuple[Message, ByName]:
        """Remove meshes, materials and textures, and the objects that use them."""
        data = self._bpy.data
        names = {*header["meshes"], *header["materials"]}
        for name in [name for name, (_, state) in self._objects.items() if names & {state[0], state[1]}]:
            data.objects.remove(self._objects.pop(name)[0])
        for key in header["meshes"]:
            data.meshes.remove(self._meshes.pop(key))
        self._materials.forget(header["materials"], header["textures"])
        return {}, {}

    def mesh(self, header: Message, arrays: ByName) -> tuple[Message, ByName]:
        """Add a mesh: positions (V, 3), normals (V, 3), uvs (V, 2; v points down), faces (F, 3).

        Panes of rooms also have ``right`` and ``down``, (F, 3), the sides of a cell.
        """
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
        for side in ("right", "down"):
            if side in arrays:
                mesh.attributes.new(side, "FLOAT_VECTOR", "FACE").data.foreach_set("vector", arrays[side].ravel())
        mesh.update(calc_edges=True)
        mesh.normals_split_custom_set_from_vertices(arrays["normals"])
        mesh.materials.append(None)
        self._meshes[header["key"]] = mesh
        return {}, {}

    def texture(self, header: Message, arrays: ByName) -> tuple[Message, ByName]:
        """Add a texture from ``image``; see `Materials.texture`."""
        self._materials.texture(header, arrays["image"])
        return {}, {}

    def material(self, header: Message, _: ByName) -> tuple[Message, ByName]:
        """Add a material; see `Materials.material`."""
        self._materials.material(header)
        return {}, {}

    def render(self, header: Message, arrays: ByName) -> tuple[Message, ByName]:
        """Render the border (x, y, w, h) and return its image, (h, w, 3) float32.

        With ``guides``, return the inputs of the denoiser instead; with ``index``, the object index pass, (h, w).
        """
        self._settings(header["settings"], header["size"], header["border"])
        self._camera_at(header["camera"])
        self._objects_at(header["objects"], arrays["matrices"])
        camera = header["camera"]
        pixel = camera["sensor_width_mm"] / (camera["focal_length_mm"] * header["size"][0])
        self._light_at(header["light"], arrays["sky"], pixel)
        self._light.lamps(header["lamps"])
        if header.get("index"):
            return {}, {"index": self._film.index(self._scene)}
        if header.get("guides"):
            return {}, self._film.guided(self._scene)
        return {}, {"pixels": self._film.image(self._scene)}

    def denoise(self, _: Message, arrays: ByName) -> tuple[Message, ByName]:
        """Denoise an image; see `Film.denoised`."""
        return {}, self._film.denoised(self._threads, arrays)

    def _chosen_device(self) -> tuple[str, str]:
        """Let Cycles use the chosen device, and return its kind and name; those of the processors if there is no such device."""
        if self._choice == "CPU":
            return "CPU", ""
        preferences = self._bpy.context.preferences.addons["cycles"].preferences
        offered = {entry[0] for entry in preferences.get_device_types(self._bpy.context)}
        for kind in _DEVICES if self._choice == "AUTO" else (self._choice,):
            if kind not in offered:
                continue
            names = {device.name for device in preferences.get_devices_for_type(kind) or () if device.type == kind}
            if names:
                preferences.compute_device_type = kind
                for device in preferences.devices:
                    device.use = device.type == kind
                return kind, ", ".join(sorted(names))
        return "CPU", ""

    def _clear(self) -> None:
        bpy = self._bpy
        bpy.ops.wm.read_factory_settings(use_empty=True)
        self._device = self._chosen_device()  # The factory settings render on the processors.
        bpy.app.handlers.render_stats.append(self._pipe.alive)
        self._meshes: ByName = {}
        self._objects: dict[str, tuple[Any, tuple[Any, ...]]] = {}
        self._materials = Materials(bpy.data, self._reliefs, self._constants)
        self._lighting: object = None
        scene = self._scene = bpy.context.scene
        scene.render.engine = "CYCLES"
        scene.render.use_persistent_data = True
        scene.render.use_compositing = scene.render.use_sequencer = False
        scene.render.resolution_percentage = 100
        take_threads(scene, self._threads)
        scene.cycles.device = "CPU" if self._device[0] == "CPU" else "GPU"
        write_floats(scene)
        self._camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
        scene.collection.objects.link(self._camera)
        scene.camera = self._camera
        self._light = BlenderLight(bpy.data, scene)

    def _settings(self, settings: Message, size: list[int], border: list[int] | None) -> None:
        render, cycles = self._scene.render, self._scene.cycles
        width, height = size
        render.resolution_x, render.resolution_y = width, height
        render.use_border = render.use_crop_to_border = border is not None
        if border is not None:
            x, y, w, h = border
            # Blender and Cycles each round these to whole pixels in single precision. On a pixel's edge, one of them may round to
            # the pixel below. A point inside the pixel is the same for both, and does not move any ray.
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

    def _camera_at(self, camera: Message) -> None:
        data = self._camera.data
        data.type, data.sensor_fit = "PERSP", "HORIZONTAL"
        data.lens, data.sensor_width = camera["focal_length_mm"], camera["sensor_width_mm"]
        data.clip_start, data.clip_end = camera["near"], camera["far"]
        self._camera.matrix_world = matrix_of(np.array(camera["matrix"]).reshape(4, 4))

    def _objects_at(self, entries: list[Message], matrices: Any) -> None:
        data = self._bpy.data
        # Noise depends on the order of the objects. From the first difference on, remove them and add them as in a new scene.
        names = [entry["name"] for entry in entries]
        unchanged = 0
        for name, present in zip(names, self._objects, strict=False):
            if name != present:
                break
            unchanged += 1
        for name in list(self._objects)[unchanged:]:
            data.objects.remove(self._objects.pop(name)[0])
        for entry, matrix in zip(entries, matrices, strict=True):
            name = entry["name"]
            state = (entry["mesh"], entry["material"], entry["index"], matrix.tobytes())
            thing, current = self._objects.get(name, (None, ()))
            if current == state:
                continue
            mesh = self._meshes[entry["mesh"]]
            if thing is None:
                thing = data.objects.new(name, mesh)
                self._scene.collection.objects.link(thing)
            elif current[0] != entry["mesh"]:
                thing.data = mesh
            slot = thing.material_slots[0]
            slot.link = "OBJECT"
            slot.material = self._materials[entry["material"]]
            thing.pass_index = entry["index"]
            thing.matrix_world = matrix_of(matrix)
            self._objects[name] = (thing, state)

    def _light_at(self, light: Message, sky: Any, pixel: float) -> None:
        state = (light, pixel, sky.tobytes())
        if self._lighting != state:
            self._light.show(light, sky)
            self._materials.show(light, pixel)
            self._lighting = state
