# SPDX-License-Identifier: Apache-2.0
"""Surfaces as Blender's shader nodes."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from .covers import CHANGED, DRY, Cover
from .leaves import leaves_cover
from .nodes import Nodes, new_group
from .pipe import ByName, Message
from .rooms import behind_pane
from .snow import snow_cover
from .terms import Term
from .water import water_cover


class Materials:
    """Blender's materials and textures, with the air, the water, the leaves and the snow that all materials share.

    Args:
        reliefs: corners of random relief, (layers, H, W, 4) uint8: four of snow, three of water, five of leaves.
        constants: `valerie.rendering.surface_constants.CONSTANTS`.
    """

    def __init__(self, data: Any, reliefs: Any, constants: Message) -> None:
        self._data = data
        self._constants = constants
        self._materials: ByName = {}
        self._textures: ByName = {}
        images = [byte_image(data, f"relief-{i}", corners, "Non-Color") for i, corners in enumerate(reliefs)]
        self._air: Any = _air_group(data)
        self._snow: Cover = snow_cover(data, images[:4], constants)
        self._water: Cover = water_cover(data, images[4:7], constants)
        self._leaves: Cover = leaves_cover(data, images[7:], constants)

    def __getitem__(self, key: str) -> Any:
        return self._materials[key]

    def forget(self, materials: list[str], textures: list[str]) -> None:
        """Remove materials and textures by key."""
        for key in materials:
            self._data.materials.remove(self._materials.pop(key))
        for key in textures:
            self._data.images.remove(self._textures.pop(key))

    def show(self, light: Message, pixel: float) -> None:
        """Apply cover and air of ``light`` to all materials; ``pixel`` is a pixel's size at 1 m, in metres."""
        self._snow.show(light["snow_depth"], pixel)
        self._water.show(light["wetness"], pixel)
        self._leaves.show(light["leaf_litter"], pixel)
        self._air.nodes["extinction"].outputs[0].default_value = -light["extinction"]
        self._air.nodes["haze"].inputs["Color"].default_value = (*light["haze"], 1.0)

    def texture(self, header: Message, pixels: Any) -> None:
        """Add a texture, (H, W, 3 or 4) uint8. With ``color`` in the header its values are sRGB, otherwise linear data."""
        space = "sRGB" if header["color"] else "Non-Color"
        self._textures[header["key"]] = byte_image(self._data, header["key"], pixels, space)

    def material(self, header: Message) -> None:
        """Add a material: Blender's Principled BSDF with the values of ``header``."""
        material = self._data.materials.new(header["key"])
        material.use_nodes = True
        material.use_transparent_shadow = header["alpha_cutoff"] is not None or header["transmission"] > 0
        # The haze in front of a surface is an emission too, but not a light source to sample.
        lights = any(header["emissive"]) and not header["lens"] and header["rooms"] is None
        material.cycles.emission_sampling = "AUTO" if lights else "NONE"
        nodes = Nodes(material.node_tree)
        principled = nodes.add("ShaderNodeBsdfPrincipled")
        base: Any = nodes.color(header["base_color"])
        alpha = None
        if header["base_color_texture"] is not None:
            image = nodes.image(self._textures[header["base_color_texture"]])
            base, alpha = nodes.multiplied(image["Color"], header["base_color"]), image["Alpha"]
        nodes.link(base, principled.inputs["Base Color"])
        for name in ("metallic", "roughness"):
            principled.inputs[name.capitalize()].default_value = header[name]
        if header["roughness_texture"] is not None:
            image = nodes.image(self._textures[header["roughness_texture"]])
            channels = nodes.add("ShaderNodeSeparateColor")
            nodes.link(image["Color"], channels.inputs["Color"])
            for name, channel in (("metallic", "Blue"), ("roughness", "Green")):
                factor = nodes.math("MULTIPLY", channels.outputs[channel], header[name])
                nodes.link(factor, principled.inputs[name.capitalize()])
        # A specular of 1 is a reflectance of 4 % (index of refraction 1.5), which is half of the socket's range.
        principled.inputs["Specular IOR Level"].default_value = 0.5 * header["specular"]
        nodes.link(nodes.tinted(base, header["specular_tint"]), principled.inputs["Specular Tint"])
        principled.inputs["Emission Color"].default_value = (*header["emissive"], 1.0)
        principled.inputs["Emission Strength"].default_value = 1.0 if any(header["emissive"]) else 0.0
        if header["lens"]:
            # The lamp in front of the lens gives the light. Only the camera sees the glow.
            camera_ray = nodes.add("ShaderNodeLightPath").outputs["Is Camera Ray"]
            nodes.link(camera_ray, principled.inputs["Emission Strength"])
        if header["normal_texture"] is not None:
            bumps = nodes.add("ShaderNodeNormalMap")
            bumps.uv_map = "uv"
            nodes.link(nodes.image(self._textures[header["normal_texture"]])["Color"], bumps.inputs["Color"])
            nodes.link(bumps.outputs["Normal"], principled.inputs["Normal"])
        if header["rooms"] is not None:
            self._show_rooms(nodes, principled, header)
        self._cover(nodes, principled, header)
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
            # Surfaces behind the pane add their own haze, over the whole distance.
            pane = nodes.add("ShaderNodeBsdfTransparent")
            surface = nodes.mixed(header["transmission"], surface, pane.outputs["BSDF"])
        if not header["double_sided"]:
            # The camera does not see back faces, but they block light: the inside of a closed body is dark.
            camera_ray = nodes.add("ShaderNodeLightPath").outputs["Is Camera Ray"]
            hidden = nodes.math("MULTIPLY", nodes.add("ShaderNodeNewGeometry").outputs["Backfacing"], camera_ray)
            surface = nodes.mixed(hidden, surface, nodes.add("ShaderNodeBsdfTransparent").outputs["BSDF"])
        nodes.link(surface, nodes.add("ShaderNodeOutputMaterial").inputs["Surface"])
        self._materials[header["key"]] = material

    def _show_rooms(self, nodes: Nodes, principled: Any, header: Message) -> None:
        """Show rooms behind a pane, as its diffuse colour by day. Lit rooms shine for the camera and for mirrors only."""
        rooms, constants = header["rooms"], self._constants
        lit = any(header["emissive"])
        pane = behind_pane(nodes, self._textures[rooms["texture"]], rooms, constants, lit=lit)
        color = pane.color * tuple(header["base_color"])
        nodes.link(pane.normal.output, principled.inputs["Normal"])
        # As an output, since a value may not exceed 1.
        specular = nodes.math("ADD", 0.5 * header["specular"] * constants["GLAZING"], 0.0)
        nodes.link(specular, principled.inputs["Specular IOR Level"])
        if pane.lamps is not None:
            path, fresnel = nodes.add("ShaderNodeLightPath").outputs, nodes.add("ShaderNodeFresnel")
            mirrored = math.sqrt(0.04 * header["specular"] * constants["GLAZING"])
            fresnel.inputs["IOR"].default_value = (1 + mirrored) / (1 - mirrored)
            nodes.link(pane.normal.output, fresnel.inputs["Normal"])
            seen = Term(nodes, path["Is Camera Ray"]).of("MAXIMUM", path["Is Glossy Ray"])
            strength = pane.lamps * (1.0 - Term(nodes, fresnel.outputs[0])) * seen
            nodes.link((color * tuple(header["emissive"])).output, principled.inputs["Emission Color"])
            nodes.link(strength.output, principled.inputs["Emission Strength"])
            color = color * (1.0 - pane.lamps)
        nodes.link(color.output, principled.inputs["Base Color"])

    def _cover(self, nodes: Nodes, principled: Any, header: Message) -> None:
        """Cover a surface with the leaves, then the water, then the snow that lie on it."""
        lying = (("strewn", self._leaves), ("wet", self._water), ("snowy", self._snow))
        covers = [cover for covered, cover in lying if header[covered]]
        if covers and not principled.inputs["Normal"].is_linked:
            nodes.link(nodes.add("ShaderNodeNewGeometry").outputs["Normal"], principled.inputs["Normal"])
        groups = []
        for cover in covers:
            group = nodes.add("ShaderNodeGroup")
            group.node_tree = cover.tree
            for name in DRY:
                nodes.feed_alike(group.inputs[f"Dry {name}"], principled.inputs[name])
            group.inputs[cover.own_name].default_value = header[cover.own_name.lower()]
            groups.append(group)
        for group in groups:
            for name in CHANGED:
                nodes.feed_alike(group.inputs[name], principled.inputs[name])
                nodes.link(group.outputs[name], principled.inputs[name])


def byte_image(data: Any, name: str, pixels: Any, space: str) -> Any:
    """Return a Blender image of pixels, (H, W, 3 or 4) uint8, first row at the top, in a colour space of Blender's."""
    height, width, channels = pixels.shape
    image = data.images.new(name, width, height, alpha=channels == 4)
    image.colorspace_settings.name = space
    image.alpha_mode = "CHANNEL_PACKED"
    rgba = np.ones((height, width, 4), np.float32)
    rgba[..., :channels] = pixels[::-1] / np.float32(255)
    image.pixels.foreach_set(rgba.ravel())
    image.pack()
    return image


def _air_group(data: Any) -> Any:
    """Return the node group that fades a surface into the haze before it: transmittance exp(−extinction · distance)."""
    group, nodes, source, result = new_group(data, "air", {"surface": "Shader"}, {"surface": "Shader"})
    extinction = nodes.add("ShaderNodeValue", "extinction")
    haze = nodes.add("ShaderNodeEmission", "haze")
    distance = nodes.add("ShaderNodeCameraData").outputs["View Distance"]
    clear = nodes.math("EXPONENT", nodes.math("MULTIPLY", distance, extinction.outputs[0]))
    hidden = nodes.math("SUBTRACT", 1.0, clear)
    camera_ray = nodes.add("ShaderNodeLightPath").outputs["Is Camera Ray"]
    share = nodes.math("MULTIPLY", hidden, camera_ray)
    nodes.link(nodes.mixed(share, source[0], haze.outputs[0]), result[0])
    return group
