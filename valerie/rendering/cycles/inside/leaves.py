# SPDX-License-Identifier: Apache-2.0
"""Fallen leaves as Blender's shader nodes, the same as in the raster engine (``lying.glsl``, ``lighting.frag.glsl``)."""

from __future__ import annotations

import math
from typing import Any

from .covers import Cover
from .nodes import Nodes
from .pipe import Message
from .terms import Term, random_of, relief, vector


def leaves_cover(data: Any, reliefs: list[Any], constants: Message) -> Cover:
    """Return the cover of leaves on level surfaces; ``reliefs`` are those of patches, then of decay in each layer.

    Wind and feet gather leaves in patches, and wheels sweep polished tracks. Each cell of a layer holds at most one leaf.
    """
    cover, c = Cover(data, "leaves", "Traffic"), constants
    nodes, position, traffic, grain = cover.nodes, cover.position, cover.own, cover.grain

    tracks = traffic * (1.0 - cover.dry_rough.step(*c["LEAVES_TRACK"]))
    swept = tracks * (1.0 - cover.dry_color.y.step(*c["SNOW_MARKING"]))
    everywhere, from_tracks = c["LEAVES_TAKEN"]
    level = cover.face.z.step(*c["LEAVES_LIE"]) * (1.0 - traffic * everywhere) * (1.0 - swept * from_tracks)
    patches, _ = relief(nodes, reliefs[0], position, (c["LEAVES_PATCH"],) * 2)
    covered = (cover.amount * level * patches * 2.0).clamped(0.0, 1.0)
    # A leaf fills a quarter of its cell. Four layers with this chance of a leaf hide the cover together.
    chance = ((1.0 - (1.0 - covered).of("POWER", 0.25)) * 4.0).of("MINIMUM", 1.0)

    yellow, rust, brown = (Term(nodes, nodes.color(c[f"LEAVES_{name}"])) for name in ("YELLOW", "RUST", "BROWN"))
    # The colours of the leaves times the share that they hide, and the share that they leave.
    seen: Term = vector(nodes)
    bare: Any = 1.0
    for i, decay in enumerate(reliefs[1:]):
        (edge, wider), (turn, further) = c["LEAVES_CELL"], c["LEAVES_TURN"]
        side, turned = edge + wider * i, turn + further * i
        place = _turned(nodes, position, math.cos(turned), math.sin(turned)) * (1.0 / side)
        corner = place.of("FLOOR")
        cell = vector(nodes, corner.x, corner.y, float(i))
        angle, kind, tone = (random_of(nodes, cell + offset) for offset in (3.0, 5.0, 7.0))
        shift = vector(nodes, *(random_of(nodes, cell + offset) for offset in (11.0, 13.0)))
        off = place - corner - (0.5, 0.5, 0.0) - (shift - (0.5, 0.5, 0.0)) * 0.16
        angle = angle * -2.0 * math.pi
        off = _turned(nodes, off, angle.of("COSINE"), angle.of("SINE"))
        # An oval with a tip at one end; its half width falls to 0 there.
        along, across = (off.x * (0.5 / 0.42) + 0.5).clamped(0.0, 1.0), off.y.of("ABSOLUTE")
        width = along.of("SQRT") * (1.0 - along * along) * (kind * 0.5 + 0.75) * (0.30 * 1.25)
        soft = (grain.length * (0.5 / side)).clamped(0.02, 0.08)  # wider borders would enlarge the leaf
        inside = 1.0 - (across - width).step((soft * -1.0).output, soft.output)
        inside = inside * off.x.of("ABSOLUTE").of("LESS_THAN", 0.42) * random_of(nodes, cell).of("LESS_THAN", chance)
        leaf = brown.to(rust, kind.step(0.2, 0.5)).to(yellow, kind.step(0.55, 0.8))
        # A pale midrib, and darker patches of decay.
        rib = (1.0 - across.step(0.008, 0.03)) * 0.5 + 1.0
        rotten, _ = relief(nodes, decay, position, (c["LEAVES_DECAY"],) * 2)
        leaf = leaf * (tone * 0.7 + 0.55) * rib * (1.0 - rotten * grain.seen(c["LEAVES_DECAY"]) * 0.35)
        seen, bare = seen.to(leaf, inside), (1.0 - inside) * bare
    near = grain.seen(0.25)
    seen = (rust.to(yellow, 0.4) * covered * 0.85).to(seen, near)
    hidden = covered.to(1.0 - bare, near)

    cover.change(
        cover.color * (1.0 - hidden) + seen,
        cover.rough.to(c["LEAVES_ROUGHNESS"], hidden),
        cover.specular,
        cover.metallic * (1.0 - hidden),
        cover.normal.to(cover.face, hidden * 0.7).of("NORMALIZE"),
    )
    return cover


def _turned(nodes: Nodes, place: Term, cosine: Any, sine: Any) -> Term:
    """Return a place turned about z, at z = 0."""
    return vector(nodes, place.x * cosine - place.y * sine, place.x * sine + place.y * cosine)
