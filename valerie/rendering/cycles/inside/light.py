# SPDX-License-Identifier: Apache-2.0
"""Sun, sky and lamps as Blender's lights and shader nodes."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from .film import Film, float_image, write_floats
from .nodes import Nodes
from .pipe import Message
from .placing import matrix_of

#: Width and height of the panorama that measures the sky, pixels.
_SKY_SIZE = (64, 32)


class SkyMeter:
    """Measures the luminance of Blender's sky."""

    def __init__(self, bpy: Any, film: Film) -> None:
        self._bpy = bpy
        self._film = film
        self._skies: dict[tuple[float, float], float] = {}

    def luminance(self, sky: Message) -> float:
        """Return the luminance of a white Lambertian surface under Blender's sky at strength 1, measured in a panorama."""
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
            write_floats(scene)
            try:
                radiance = self._film.image(scene) @ np.array([0.2126, 0.7152, 0.0722])
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


class BlenderLight:
    """The light of a scene."""

    def __init__(self, data: Any, scene: Any, meter: SkyMeter) -> None:
        self._data = data
        self._collection = scene.collection
        self._meter = meter
        self._lamps: list[Message] = []
        self._sun = data.objects.new("sun", data.lights.new("sun", "SUN"))
        scene.collection.objects.link(self._sun)
        scene.world = data.worlds.new("world")
        self._world = World(scene.world)

    def show(self, light: Message, sky: Message, panorama: Any) -> None:
        """Light the scene with the sun, and with Blender's sky or a panorama."""
        strength = max(light["sun"])
        lamp = self._sun.data
        # Energy 0 turns the sun off. Hiding the lamp and showing it again would change its place in Cycles' order, and with it
        # the noise. The radiance of a white Lambertian surface that faces the lamp is the energy divided by π.
        lamp.energy = math.pi * strength
        lamp.color = [value / strength for value in light["sun"]] if strength > 0 else (1.0, 1.0, 1.0)
        lamp.angle = light["angular_diameter"]
        self._sun.matrix_world = matrix_of(_shining_from(light["toward_sun"], (0.0, 0.0, 0.0)))
        if panorama is not None:
            self._world.show_panorama(self._data, sky, panorama)
        else:
            self._world.show(
                sky, strength=sky["irradiance"] / self._meter.luminance(sky) if sky["irradiance"] > 0 else 0.0
            )

    def lamps(self, entries: list[Message]) -> None:
        """Set the point and spot lights. If any differs, create all of them again, so that they keep the order of the list."""
        if entries == self._lamps:
            return
        data = self._data
        for index in range(len(self._lamps)):
            data.lights.remove(data.lights[f"lamp-{index}"])  # the object goes with its light
        for index, lamp in enumerate(entries):
            spot = lamp["outer"] <= 0.5 * math.pi
            light = data.lights.new(f"lamp-{index}", "SPOT" if spot else "POINT")
            light.energy, light.color, light.shadow_soft_size = lamp["energy"], lamp["color"], lamp["radius"]
            if spot:
                # Blender's blend is the share of the cone over which the light fades, from the rim inwards.
                light.spot_size = 2 * lamp["outer"]
                light.spot_blend = 1 - math.tan(lamp["inner"] / 2) / math.tan(lamp["outer"] / 2)
            if lamp["beam"] is not None:
                _fill_dipped(light, lamp)
            thing = data.objects.new(f"lamp-{index}", light)
            thing.matrix_world = matrix_of(_shining_from(-np.array(lamp["direction"]), lamp["position"]))
            self._collection.objects.link(thing)
        self._lamps = entries


class World:
    """A sky above the horizon and a uniform colour below it."""

    def __init__(self, world: Any) -> None:
        world.use_nodes = True
        nodes = self._nodes = Nodes(world.node_tree)
        self._panorama = nodes.add("ShaderNodeTexEnvironment")
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

    def show(self, sky: Message, strength: float) -> None:
        """Show Blender's sky times ``strength``; the sun stands ``rotation`` radians clockwise from +y."""
        self._sky.sun_elevation, self._sky.sun_rotation = sky["elevation"], sky["rotation"] % (2 * math.pi)
        self._sky.dust_density = sky["dust"]
        self._nodes.link(self._sky.outputs["Color"], self._above.inputs["Color"])
        self._above.inputs["Strength"].default_value = strength
        self._below.inputs["Color"].default_value = (*sky["ground"], 1.0)

    def show_panorama(self, data: Any, sky: Message, panorama: Any) -> None:
        """Show the sky of an equirectangular image, (H, W, 3), zenith in the first row."""
        old, image = self._panorama.image, float_image(data, "sky", panorama)
        self._panorama.image = image
        if old is not None:
            data.images.remove(old)
        self._nodes.link(self._panorama.outputs["Color"], self._above.inputs["Color"])
        self._above.inputs["Strength"].default_value = 1.0
        self._below.inputs["Color"].default_value = (*sky["ground"], 1.0)


def _shining_from(toward: Any, position: Any) -> Any:
    """Return the pose, (4, 4), of a lamp that shines along its own −z, away from ``toward``."""
    toward = np.array(toward)
    side = np.cross((0.0, 1.0, 0.0) if abs(toward[2]) > 0.9 else (0.0, 0.0, 1.0), toward)
    side /= np.linalg.norm(side)
    pose = np.eye(4)
    pose[:3, :3] = np.stack([side, np.cross(toward, side), toward], axis=1)
    pose[:3, 3] = position
    return pose


def _fill_dipped(light: Any, lamp: Message) -> None:
    """Give a spot light the emission of a dipped beam (formula in `valerie.rendering.beams`)."""
    light.use_nodes = True
    nodes, beam = Nodes(light.node_tree), lamp["beam"]
    # The direction from the lamp to the lit point, in the world.
    ray = nodes.add("ShaderNodeNewGeometry").outputs["Incoming"]
    ahead = nodes.dot(ray, lamp["direction"])
    across = nodes.math("DIVIDE", nodes.dot(ray, np.cross(lamp["direction"], lamp["up"]).tolist()), ahead)
    up = nodes.math("DIVIDE", nodes.dot(ray, lamp["up"]), ahead)
    cut_off = nodes.math("MULTIPLY", nodes.math("MAXIMUM", across, 0.0), beam["rise"])
    below = nodes.smoothstep(0.0, beam["edge"], nodes.math("SUBTRACT", cut_off, up))
    cut = nodes.math("MULTIPLY_ADD", below, 1.0 - beam["stray"], beam["stray"])

    def falloff(tangent: Any, spread: float) -> Any:
        off = nodes.math("MULTIPLY", tangent, 1.0 / spread)
        return nodes.math("MULTIPLY_ADD", off, off, 1.0)

    off_axis = nodes.math(
        "POWER", nodes.math("MULTIPLY", falloff(across, beam["spread"][0]), falloff(up, beam["spread"][1])), 2.0
    )
    emission = nodes.add("ShaderNodeEmission")
    nodes.link(nodes.math("DIVIDE", cut, off_axis), emission.inputs["Strength"])
    nodes.link(emission.outputs[0], nodes.add("ShaderNodeOutputLight").inputs["Surface"])
