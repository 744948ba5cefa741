# SPDX-License-Identifier: Apache-2.0
"""Lying snow as Blender's shader nodes."""

from __future__ import annotations

from typing import Any

from .nodes import Nodes, new_group

#: Wavelengths of the patches, metres, and their weights, as in the raster engine (``lying.glsl``).
_PATCHES = ((1.6, 0.36), (0.4, 0.27), (0.1, 0.2), (0.03, 0.17))
#: Standard deviation of Blender's noise without further octaves.
_DEVIATION = 0.16
_SNOW, _SLUSH = (0.80, 0.82, 0.85), (0.36, 0.34, 0.32)


def snow_group(data: Any) -> Any:
    """Return the node group of snow on surfaces that face up, as in the raster engine, but also below roofs.

    The share that snow covers is tanh(depth / 25 mm). Traffic compacts it, and keeps polished tracks bare and damp.
    """
    sockets = {"Base Color": "Color", "Roughness": "Float", "Specular IOR Level": "Float", "Metallic": "Float"}
    group, nodes, source, result = new_group(
        data, "snow", {**sockets, "Traffic": "Float"}, {**sockets, "Relief": "Float"}
    )
    geometry = nodes.add("ShaderNodeNewGeometry").outputs
    up, channels = nodes.add("ShaderNodeSeparateXYZ"), nodes.add("ShaderNodeSeparateColor")
    nodes.link(geometry["Normal"], up.inputs[0])
    nodes.link(source["Base Color"], channels.inputs[0])
    traffic, depth = source["Traffic"], nodes.add("ShaderNodeValue", "depth").outputs[0]

    def without(share: Any) -> Any:
        return nodes.math("SUBTRACT", 1.0, share)

    def product(first: Any, *others: Any) -> Any:
        for other in others:
            first = nodes.math("MULTIPLY", first, other)
        return first

    rough = source["Roughness"]
    polished = product(nodes.smoothstep(0.745, 0.77, rough), without(nodes.smoothstep(0.785, 0.81, rough)))
    worn = product(traffic, polished, without(nodes.smoothstep(0.16, 0.26, channels.outputs["Green"])))
    kept = product(without(product(traffic, 0.5)), without(product(worn, 0.94)))
    lying = product(depth, nodes.smoothstep(0.5, 0.85, up.outputs["Z"]), kept)
    cover = nodes.math("TANH", nodes.math("DIVIDE", lying, 0.025))
    snow = _patched(nodes, geometry["Position"], cover)
    damp = product(worn, without(snow), nodes.smoothstep(0.0, 0.02, depth))
    bare = nodes.scaled(source["Base Color"], nodes.between(1.0, 0.55, damp))
    dirt = product(traffic, nodes.between(0.2, 1.0, worn))
    white = nodes.blended(nodes.color(_SNOW), nodes.color(_SLUSH), dirt)
    nodes.link(nodes.blended(bare, white, snow), result["Base Color"])
    rough = nodes.between(source["Roughness"], 0.4, product(damp, 0.7))
    nodes.link(nodes.between(rough, 0.8, snow), result["Roughness"])
    # Half of the socket's range is a reflectance of 4 %.
    nodes.link(nodes.between(source["Specular IOR Level"], 0.25, snow), result["Specular IOR Level"])
    nodes.link(product(source["Metallic"], without(snow)), result["Metallic"])
    nodes.link(without(snow), result["Relief"])
    return group


def _patched(nodes: Nodes, position: Any, cover: Any) -> Any:
    """Return the share of a place that snow hides: patches with random borders, whose mean is ``cover``."""
    height: Any = 0.0
    for length, weight in _PATCHES:
        noise = nodes.add("ShaderNodeTexNoise")
        noise.noise_dimensions = "2D"
        nodes.link(position, noise.inputs["Vector"])
        noise.inputs["Scale"].default_value, noise.inputs["Detail"].default_value = 1.0 / length, 0.0
        height = nodes.math("MULTIPLY_ADD", nodes.math("SUBTRACT", noise.outputs[0], 0.5), weight, height)
    spread = _DEVIATION * sum(weight**2 for _, weight in _PATCHES) ** 0.5
    # The logistic curve is that of a normal distribution within 0.01.
    decay = nodes.math("EXPONENT", nodes.math("MULTIPLY", height, -1.702 / spread))
    rank = nodes.math("DIVIDE", 1.0, nodes.math("ADD", decay, 1.0))
    soft = nodes.math("MINIMUM", nodes.math("MINIMUM", cover, nodes.math("SUBTRACT", 1.0, cover)), 0.2)
    inside = nodes.math("DIVIDE", nodes.math("SUBTRACT", cover, rank), nodes.math("MAXIMUM", soft, 1e-4))
    return nodes.smoothstep(-1.0, 1.0, inside)
