"""Estimate from the spec alone if a run has few backgrounds for its frames."""

from __future__ import annotations

from collections.abc import Sequence
from math import prod
from typing import Final

from valerie.parameters.blocks import POINTS, Block
from valerie.parameters.space import ParameterSpace
from valerie.runs.resolving.motion import Times
from valerie.scene.assets.manifest import Manifest
from valerie.scene.variation.variant import picture_paths_without_movables

#: A run has few backgrounds if it has at least this many frames for each of them.
_FRAMES_PER_BACKGROUND: Final = 10


def few_backgrounds(space: ParameterSpace, manifest: Manifest, cameras: Sequence[str], times: Times) -> bool:
    """Return True if there are at most a tenth as many pictures of backgrounds as frames.

    Both numbers follow from the designs, without examining single variants: rejected ones count too, and blocks count as if
    they shared no background.
    """
    moments = len(times.elapsed)
    moved = () if times.motion is None else times.motion.moved
    backgrounds = 0
    for camera in cameras:
        paths = picture_paths_without_movables(manifest, camera)
        if paths.intersection(moved):
            backgrounds += space.size * moments
            continue
        backgrounds += sum(
            min(size, _combinations(space, block, paths))
            for block, size in zip(space.blocks, space.block_sizes, strict=True)
        )
    return backgrounds * _FRAMES_PER_BACKGROUND <= space.size * len(cameras) * moments


def _combinations(space: ParameterSpace, block: Block, paths: frozenset[str]) -> int:
    """Return the largest number of combinations of ``paths`` in a block; the size of the space if they are continuous."""
    if block.design == POINTS:
        return len({tuple(sorted((path, point[path]) for path in paths & point.keys())) for point in block.points})
    counts = [
        variation.distribution.count(space.definitions[variation.path])
        for variation in block.variations
        if variation.path in paths
    ]
    return prod(space.size if count is None else count for count in counts)
