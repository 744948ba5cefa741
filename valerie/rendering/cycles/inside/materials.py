# SPDX-License-Identifier: Apache-2.0
"""Surfaces as Blender's shader nodes."""

from __future__ import annotations

from typing import Any

import numpy as np

from .nodes import Nodes, new_group
from .pipe import ByName, Message
from .snow import snow_group


class Materials:
    """Blender's materials and textures, with the air, the water and the snow that all materials share."""

    def __init__(self, data: Any) -> None:
        self._data = data
        self._materials: ByName = {}
        self._textures: ByName = {}
        self._air: Any = _air_group(data)
        self._water: Any = _water_group(data)
        self._snow: Any = snow_group(data)

    def __getitem__(self, key: str) -> Any:
        return self._materials[key]

    def forget(self, materials: list[str], textures: list[str]) -> None:
        """Remove materials and textures by key."""
        for key in materials:
            self._data.materials.remove(self._materials.pop(key))
        for key in textures:
            self._data.images.remove(self._textures.pop(key))

    def show(self, light: Message) -> None:
        """Apply the water, the snow and the air of ``light`` to all materials."""
        self._snow.nodes["depth"].outputs[0].default_value = light["snow_depth"]
        self._water.nodes["wetness"].outputs[0].default_value = light["wetness"]
        self._air.nodes["extinction"].outputs[0].default_value = -light["extinction"]
        self._air.nodes["haze"].inputs["Color"].default_value = (*light["haze"], 1.0)

    def texture(self, header: Message, pixels: Any) -> None:
        """Add a texture, (H, W, 3 or 4) uint8. With ``color`` in the header its values are sRGB, otherwise linear data."""
        height, width, channels = pixels.shape
        image = self._data.images.new(header["key"], width, height, alpha=channels == 4)
        image.colorspace_settings.name = "sRGB" if header["color"] else "Non-Color"
        image.alpha_mode = "CHANNEL_PACKED"
        rgba = np.ones((height, width, 4), np.float32)
        rgba[..., :channels] = pixels[::-1] / np.float32(255)
        image.pixels.foreach_set(rgba.ravel())
        image.pack()
        self._textures[header["key"]] = image

    def material(self, header: Message) -> None:
        """Add a material: Blender's Principled BSDF with the values of ``header``."""
        material = self._data.materials.new(header["key"])
        material.use_nodes = True
        material.use_transparent_shadow = header["alpha_cutoff"] is not None or header["transmission"] > 0
        # The haze in front of a surface is an emission too, but not a light source to sample.
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
            image = nodes.add("ShaderNodeTexImage")
            image.image = self._textures[header["normal_texture"]]
            bumps = nodes.add("ShaderNodeNormalMap")
            bumps.uv_map = "uv"
            nodes.link(image.outputs["Color"], bumps.inputs["Color"])
            nodes.link(bumps.outputs["Normal"], principled.inputs["Normal"])
        for covered, tree in ((header["wet"], self._water), (header["snowy"], self._snow)):
            if not covered:
                continue
            cover = nodes.add("ShaderNodeGroup")
            cover.node_tree = tree
            for name in ("Metallic", "Base Color", "Roughness", "Specular IOR Level"):
                nodes.feed_alike(cover.inputs[name], principled.inputs[name])
                if name in cover.outputs:
                    nodes.link(cover.outputs[name], principled.inputs[name])
            for name in ("Traffic", "Soaks"):
                if name in cover.inputs:
                    cover.inputs[name].default_value = header[name.lower()]
            if header["normal_texture"] is not None:
                nodes.link(cover.outputs["Relief"], bumps.inputs["Strength"])
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


def _water_group(data: Any) -> Any:
    """Return the node group of water on surfaces that face up, as in the raster engine.

    Pores full of water darken a surface (Lekner and Dorf 1988, doi:10.1364/AO.27.001278). The film is smooth, fills the relief
    and reflects like water, except on soil and grass, into which it sinks. It lies in patches a metre or two wide.
    """
    sockets = {"Base Color": "Color", "Roughness": "Float", "Specular IOR Level": "Float"}
    group, nodes, source, result = new_group(
        data, "water", {**sockets, "Metallic": "Float", "Soaks": "Float"}, {**sockets, "Relief": "Float"}
    )
    geometry = nodes.add("ShaderNodeNewGeometry").outputs
    up, at = nodes.add("ShaderNodeSeparateXYZ"), nodes.add("ShaderNodeSeparateXYZ")
    nodes.link(geometry["Normal"], up.inputs[0])
    nodes.link(geometry["Position"], at.inputs[0])
    x, y = at.outputs["X"], at.outputs["Y"]

    def wave(along: Any, along_rate: float, across: Any, across_rate: float) -> Any:
        bent = nodes.math("MULTIPLY", nodes.math("SINE", nodes.math("MULTIPLY", across, across_rate)), 2.0)
        return nodes.math("SINE", nodes.math("MULTIPLY_ADD", along, along_rate, bent))

    dry = nodes.math("SUBTRACT", 1.0, source["Metallic"])
    wetness = nodes.add("ShaderNodeValue", "wetness").outputs[0]
    film = nodes.math("MULTIPLY", nodes.math("MULTIPLY", wetness, nodes.smoothstep(0.7, 0.95, up.outputs["Z"])), dry)
    pores = nodes.math("MULTIPLY", film, nodes.smoothstep(0.2, 0.6, source["Roughness"]))
    film = nodes.math("MULTIPLY", film, nodes.math("SUBTRACT", 1.0, source["Soaks"]))
    patch = nodes.math("MULTIPLY_ADD", nodes.math("MULTIPLY", wave(x, 1.9, y, 1.3), wave(y, 0.9, x, 0.7)), 0.5, 0.5)
    nodes.link(nodes.scaled(source["Base Color"], nodes.between(1.0, 0.5, pores)), result["Base Color"])
    smooth = nodes.between(source["Roughness"], nodes.between(0.32, 0.07, patch), film)
    nodes.link(smooth, result["Roughness"])
    # Half of the socket's range is a reflectance of 4 %.
    shining = nodes.math("MAXIMUM", source["Specular IOR Level"], 0.5 * 0.55)
    nodes.link(nodes.between(source["Specular IOR Level"], shining, film), result["Specular IOR Level"])
    nodes.link(nodes.between(1.0, 0.15, film), result["Relief"])
    return group
