# SPDX-License-Identifier: Apache-2.0
"""Sun, sky and lamps as Blender's lights and shader nodes."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from .film import float_image
from .nodes import Nodes
from .pipe import Message
from .placing import matrix_of


class BlenderLight:
    """The light of a scene."""

    def __init__(self, data: Any, scene: Any) -> None:
        self._data = data
        self._collection = scene.collection
        self._lamps: list[Message] = []
        self._sun = data.objects.new("sun", data.lights.new("sun", "SUN"))
        scene.collection.objects.link(self._sun)
        scene.world = data.worlds.new("world")
        self._world = World(scene.world)

    def show(self, light: Message, sky: Any) -> None:
        """Light the scene with the sun and a sky, (H, W, 3), the zenith in the first row."""
        strength = max(light["sun"])
        lamp = self._sun.data
        # Energy 0 turns the sun off. Hiding the lamp and showing it again would change its place in Cycles' order, and with it
        # the noise. The radiance of a white Lambertian surface that faces the lamp is the energy divided by π.
        lamp.energy = math.pi * strength
        lamp.color = [value / strength for value in light["sun"]] if strength > 0 else (1.0, 1.0, 1.0)
        lamp.angle = light["angular_diameter"]
        self._sun.matrix_world = matrix_of(_shining_from(light["toward_sun"], (0.0, 0.0, 0.0)))
        self._world.show(self._data, sky, light["ground"])

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
        nodes = Nodes(world.node_tree)
        self._sky = nodes.add("ShaderNodeTexEnvironment")
        above = nodes.add("ShaderNodeBackground")
        self._below = nodes.add("ShaderNodeBackground")
        nodes.link(self._sky.outputs["Color"], above.inputs["Color"])
        place = nodes.add("ShaderNodeTexCoord")
        parts = nodes.add("ShaderNodeSeparateXYZ")
        nodes.link(place.outputs["Generated"], parts.inputs[0])
        down = nodes.math("LESS_THAN", parts.outputs["Z"], 0.0)
        surface = nodes.mixed(down, above.outputs[0], self._below.outputs[0])
        nodes.link(surface, nodes.add("ShaderNodeOutputWorld").inputs["Surface"])

    def show(self, data: Any, sky: Any, ground: list[float]) -> None:
        """Show an equirectangular image of the sky, (H, W, 3), the zenith in the first row, and the radiance of the ground."""
        old, self._sky.image = self._sky.image, float_image(data, "sky", sky)
        if old is not None:
            data.images.remove(old)
        self._below.inputs["Color"].default_value = (*ground, 1.0)


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
