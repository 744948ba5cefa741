"""Worn asphalt, and the paving of the footways."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from urban_street.street.noise import Field, band_noise, hashed, smoothstep, stretched_noise, toward
from urban_street.texels import normal_map, roughness_map, srgb8

Image = NDArray[np.uint8]

#: Size of a road texture, metres across and along.
ROAD_TILE = (6.6, 13.2)
#: Size of the paving texture, metres across (house to kerb) and along.
PAVING_TILE = (2.6, 3.2)
_SIZE = 1024
#: Roughness of old, polished and fresh asphalt, of materials on and in it, of iron and its dirty parts.
_OLD, _POLISHED, _FRESH = 0.92, 0.76, 0.82
_OILY, _BITUMEN, _PAINT, _JOINT = 0.68, 0.62, 0.74, 0.96
_IRON, _DIRT = 0.50, 0.92
#: Distance from the border of a patch at which its seam has faded, metres.
_FADE = 0.15
#: Metallic share of worn iron; the rest is rust.
_BARE = 0.6


def _road_axes(width: float) -> tuple[Field, Field]:
    """Return the metres across, (1, W), and along, (H, 1), at the pixel centres of a road texture."""
    centre = ((np.arange(_SIZE) + 0.5) / _SIZE).astype(np.float32)
    across: Field = (centre * np.float32(width))[None]
    along: Field = (centre * np.float32(ROAD_TILE[1]))[:, None]
    return across, along


def _between(axis: Field, low: float, high: float) -> slice:
    """Return the pixels of one of the `_road_axes` between two places, metres."""
    return slice(*np.searchsorted(axis.ravel(), (low, high)))


def _kerbs(across: Field, width: float) -> Iterator[tuple[slice, Field]]:
    """Yield the columns within half a metre of each kerb, and their metres from it, (1, N)."""
    for edge, columns in (
        (across, _between(across, 0.0, 0.5)),
        (width - across, _between(across, width - 0.5, width)),
    ):
        yield columns, edge[:, columns]


@dataclass(frozen=True, slots=True, eq=False)
class _Layer:
    """The surface of a road at each pixel.

    Attributes:
        color: (H, W, 3) linear reflectance.
        roughness, metallic: (H, W), in [0, 1].
    """

    color: NDArray[np.floating]
    roughness: Field
    metallic: Field

    def images(self) -> tuple[Image, Image]:
        """Return the maps of colour and roughness."""
        return srgb8(self.color), roughness_map(self.roughness, self.metallic)


def aggregate(shape: tuple[int, int], rng: np.random.Generator, texel: tuple[float, float]) -> Field:
    """Return stones in bitumen, singly and in clumps of up to 0.6 m, as periodic noise of zero mean and unit variance.

    Args:
        shape: rows, columns.
        rng: source of random numbers.
        texel: size of a pixel in metres, across and down.
    """
    return band_noise(shape, rng, longest=0.6 / texel[0], slope=0.32, tall=texel[1] / texel[0])


def _streaks(rng: np.random.Generator) -> Field:
    """Return streaks along a road, (1024, 1024), of zero mean and unit variance, that end at the piece's ends."""
    along = ((np.arange(_SIZE) + 0.5) / _SIZE).astype(np.float32)[:, None]
    waves = np.stack([np.sin(np.pi * k * along) * np.sin(np.pi * along) for k in (1, 2, 3, 5)])
    profiles = gaussian_filter(rng.standard_normal((len(waves), _SIZE), np.float32), (0.0, 4.0), mode="wrap")
    mixed = np.tensordot(waves[..., 0].T, profiles, 1)
    streaks: Field = (mixed / mixed.std()).astype(np.float32)
    return streaks


def asphalt(
    rng: np.random.Generator, *, zebra: bool, lane: tuple[float, ...], width: float = ROAD_TILE[0]
) -> tuple[Image, Image]:
    """Return colour (1024, 1024, 3) and roughness (512, 512, 3) of one piece of carriageway with edges and markings.

    It is ``width`` × `ROAD_TILE`[1] metres. Tyres polish two bands of a lane. Oil, the bitumen of repairs and seams, and
    markings are smoother than old asphalt, and cracks are rougher. Lids are of worn iron. Rows run along the street. The first
    and the last row match, so pieces join in any order.

    Args:
        rng: source of random numbers.
        zebra: True if there is a crossing in the middle instead of lane marks.
        lane: edges of the driving lanes, metres from the left kerb, one more than there are lanes; empty for a road without
            lanes or markings.
        width: metres from kerb to kerb.
    """
    shape = (_SIZE, _SIZE)
    across, along = _road_axes(width)
    ends = smoothstep(0.0, 0.8, along) * smoothstep(
        0.0, 0.8, ROAD_TILE[1] - along
    )  # pieces must match, so the ends get no patch
    streaks = _streaks(rng.spawn(1)[0])
    albedo = np.full(shape, 0.115, np.float32)
    albedo *= 1.0 + 0.08 * band_noise(shape, rng, longest=500, shortest=40, tall=2.0) * ends
    grain = aggregate(shape, rng, (width / _SIZE, ROAD_TILE[1] / _SIZE))
    stones = band_noise(shape, rng, longest=4, slope=0.0)
    albedo *= np.exp(0.26 * grain - 0.034) + 0.16 * np.maximum(stones - 1.2, 0.0)
    roughness = (_OLD + 0.025 * grain).astype(np.float32)

    middles = [0.5 * (a + b) for a, b in pairwise(lane)] or [0.5 * width]
    for middle in middles:  # tyres polish two bands; oil drips between them
        for offset in (-0.72, 0.72):
            track = np.exp(-(((across - middle - offset) / 0.28) ** 2))
            albedo *= 1.0 - (0.15 + 0.05 * streaks) * track
            roughness = toward(roughness, _POLISHED, 0.9 * track)
        oil = np.exp(-(((across - middle) / 0.22) ** 2))
        albedo *= 1.0 - (0.13 + 0.05 * streaks) * oil
        roughness = toward(roughness, _OILY, 0.25 * oil)
    for centre in (0.5 * lane[0], 0.5 * (lane[-1] + width)) if lane else ():
        drips = smoothstep(0.6, 2.2, band_noise(shape, rng, longest=90, shortest=8)) * ends
        bay = np.exp(-(((across - centre) / 0.7) ** 2))
        albedo *= 1.0 - 0.35 * drips * bay
        roughness = toward(roughness, _OILY, drips * bay)
    albedo, roughness = _patches(albedo, roughness, rng, grain, width)
    cracks = _cracks(rng, width)
    albedo *= 1.0 - 0.6 * cracks * ends
    roughness = toward(roughness, 1.0, cracks * ends)
    # the old longitudinal seam between two lanes of the paver
    wander = middles[-1] + 1.5 + 0.02 * np.sin(along * 2.0 * np.pi * 3.0 / ROAD_TILE[1])
    seam = np.exp(-(((across - wander) / 0.012) ** 2))
    albedo *= 1.0 - 0.35 * seam
    roughness = toward(roughness, _BITUMEN, seam)

    color: Field = albedo[..., None] * (
        np.array([1.0, 0.985, 0.955], np.float32)
        + stones[..., None] * np.array([0.035, 0.0, -0.035], np.float32)  # stones are of warm and of cold greys
    )
    road = _Layer(color, roughness, np.zeros(shape, np.float32))
    road = _gutters(road, rng, across, along, width)
    road = _ironwork(road, rng, across, along, width)
    return _painted(road, rng, grain, _paint(across, along, lane, width, zebra=zebra)).images()


def _painted(road: _Layer, rng: np.random.Generator, grain: Field, paint: Field) -> _Layer:
    """Return the road with white markings, worn by traffic."""
    marked = np.nonzero(paint)
    if not len(marked[0]):
        return road
    color, roughness, grain = road.color.copy(), road.roughness.copy(), grain[marked]
    pattern = 0.5 * band_noise(paint.shape, rng, longest=60, shortest=3, slope=0.8)[marked] + 0.22 * grain
    cover = paint[marked] * (0.25 + 0.63 * smoothstep(-1.65, -0.25, pattern))
    white = np.array([0.60, 0.59, 0.56], np.float32) * (1.0 + 0.05 * grain[:, None])
    color[marked] = color[marked] * (1.0 - cover[:, None]) + white * cover[:, None]
    roughness[marked] = toward(roughness[marked], _PAINT, cover)
    return _Layer(color, roughness, road.metallic)


def _paint(across: Field, along: Field, lane: tuple[float, ...], width: float, *, zebra: bool) -> Field:
    """Return the cover of markings, (H, W) in 0…1."""
    if zebra:
        return _zebra_paint(across, along, width)
    return _lane_paint(across, along, lane) if lane else np.zeros((_SIZE, _SIZE), np.float32)


def setts(
    rng: np.random.Generator, *, zebra: bool, lane: tuple[float, ...], width: float = ROAD_TILE[0]
) -> tuple[Image, Image, Image]:
    """Return colour, normals (1024, 1024, 3) and roughness (512, 512, 3) of granite setts. Arguments as for `asphalt`."""
    shape = (_SIZE, _SIZE)
    across, along = _road_axes(width)
    columns, rows = round(width / 0.16), 120  # courses of 11 cm in 13.2 m
    wobble = band_noise(shape, rng, longest=50, shortest=14)
    v = along / (ROAD_TILE[1] / rows) + 0.10 * band_noise(shape, rng, longest=50, shortest=14)
    course = np.floor(v).astype(np.int64)
    u = across / (width / columns) + 0.5 * (course % 2) + 0.3 * hashed(course % rows, 11) + 0.10 * wobble
    stone = np.floor(u).astype(np.int64) * 977 + course % rows
    joint = 0.12 * np.minimum(0.5 - np.abs(u - np.floor(u) - 0.5), 0.5 - np.abs(v - course - 0.5))
    grain = band_noise(shape, rng, longest=6, slope=0.2)
    cloud = band_noise(shape, rng, longest=500, shortest=40)
    inside = smoothstep(0.004, 0.016, joint)
    tone = (0.10 + 0.13 * hashed(stone, int(rng.integers(2**31)))) * (1.0 + 0.08 * grain + 0.07 * cloud)
    roughness = (0.80 + 0.03 * grain).astype(np.float32)
    for middle in (0.5 * (a + b) for a, b in pairwise(lane)):  # wheels polish the stones' heads
        for offset in (-0.72, 0.72):
            track = np.exp(-(((across - middle - offset) / 0.30) ** 2))
            tone = tone * (1.0 + 0.16 * track)
            roughness = toward(roughness, 0.5, 0.9 * track)
    tone = tone * (0.30 + 0.70 * inside)
    warm = hashed(stone, int(rng.integers(2**31)))[..., None]
    color = tone[..., None] * (np.array([1.0, 0.98, 0.96]) * (1.0 - warm) + np.array([1.06, 0.96, 0.86]) * warm)
    roughness = toward(roughness, _JOINT, 1.0 - inside)
    layer = _Layer(color.astype(np.float32), roughness, np.zeros(shape, np.float32))
    layer = _gutters(layer, rng, across, along, width)
    layer = _ironwork(layer, rng, across, along, width)
    layer = _painted(layer, rng, grain, _paint(across, along, lane, width, zebra=zebra))
    height = 0.009 * smoothstep(0.0, 0.03, joint) + 0.0004 * grain
    picture, rough = layer.images()
    return picture, normal_map(height, (width / _SIZE, ROAD_TILE[1] / _SIZE)), rough


def _patches(
    albedo: Field, roughness: Field, rng: np.random.Generator, grain: Field, road: float
) -> tuple[Field, Field]:
    """Return albedo and roughness with refilled rectangular cuts, each with a tarred seam."""
    xs, ys = _road_axes(road)
    albedo, roughness = albedo.astype(np.float64), roughness.copy()
    for _ in range(int(rng.integers(2, 5))):
        width, length = rng.uniform(0.7, 2.2), rng.uniform(0.9, 3.6)
        x, y = rng.uniform(0.6, road - width - 0.6), rng.uniform(0.8, ROAD_TILE[1] - length - 0.8)
        rows, columns = _between(ys, y - _FADE, y + length + _FADE), _between(xs, x - _FADE, x + width + _FADE)
        at, across, along = (rows, columns), xs[:, columns], ys[rows]
        inside = np.minimum(np.minimum(across - x, x + width - across), np.minimum(along - y, y + length - along))
        fill = smoothstep(0.0, 0.02, inside)
        tone = rng.choice([0.68, 0.78, 1.16])
        albedo[at] *= 1.0 + fill * (tone * (1.0 + 0.04 * grain[at]) - 1.0)
        seam = np.exp(-((inside / 0.02) ** 2))
        albedo[at] *= 1.0 - 0.5 * seam
        # Patches darker than the road are fresh and still covered with binder.
        roughness[at] = toward(toward(roughness[at], _FRESH if tone < 1.0 else _OLD, fill), _BITUMEN, seam)
    return albedo, roughness


def _cracks(rng: np.random.Generator, width: float) -> Field:
    """Return wandering cracks that sometimes fork, (H, W) in 0…1."""
    mark = np.zeros((_SIZE, _SIZE), np.float32)
    for _ in range(9):
        steps = int(rng.integers(150, 700))
        heading = rng.uniform(0.0, 2.0 * np.pi) + np.cumsum(rng.normal(0.0, 0.12, steps))
        x = rng.uniform(0, _SIZE) + np.cumsum(np.cos(heading)) + rng.normal(0.0, 0.4, steps)
        y = rng.uniform(0, _SIZE) + np.cumsum(np.sin(heading)) * width / ROAD_TILE[1]
        depth = np.sin(np.linspace(0.0, np.pi, steps)) * rng.uniform(0.5, 1.0)
        np.maximum.at(mark, (y.astype(np.int64) % _SIZE, x.astype(np.int64) % _SIZE), depth.astype(np.float32))
    softened: Field = np.clip(gaussian_filter(mark, (0.45, 0.8), mode="wrap") * 2.6, 0.0, 1.0)
    return softened


def _gutters(layer: _Layer, rng: np.random.Generator, across: Field, along: Field, width: float) -> _Layer:
    """Return the road with two rows of setts along each kerb, and the dirt that collects there."""
    color, roughness = layer.color.copy(), layer.roughness.copy()
    for columns, edge in _kerbs(across, width):
        at = slice(None), columns
        row = np.floor(edge / 0.16)
        position = along / 0.165 + 0.5 * row  # 80 setts in 13.2 m
        stone = np.floor(position).astype(np.int64) % 80 * 7 + row.astype(np.int64)
        joint = np.minimum(
            np.abs(position - np.round(position)) * 0.165, np.abs(edge / 0.16 - np.round(edge / 0.16)) * 0.16
        )
        head = smoothstep(0.004, 0.02, joint)
        tone = (0.13 + 0.12 * hashed(stone, int(rng.integers(2**31)))) * (0.35 + 0.65 * head)
        inside = (edge < 0.32)[..., None]
        stone_color = tone[..., None] * np.array([1.0, 0.97, 0.93], np.float32)
        dirt = np.exp(-((edge / 0.10) ** 2))
        color[at] = np.where(inside, stone_color * (0.8 + 0.35 * color[at] / 0.115), color[at])
        color[at] *= (1.0 - 0.35 * dirt)[..., None]
        setts_roughness = toward(np.full_like(head, _JOINT), 0.78, head)
        roughness[at] = toward(np.where(inside[..., 0], setts_roughness, roughness[at]), 1.0, dirt)
    return _Layer(color, roughness, layer.metallic)


def _ironwork(layer: _Layer, rng: np.random.Generator, across: Field, along: Field, width: float) -> _Layer:
    """Return the road with a manhole in the lane and gullies in the gutters, of worn iron that is dirty in its low parts."""
    color, roughness, metallic = layer.color.astype(np.float64), layer.roughness.copy(), layer.metallic.copy()

    def cover(at: tuple[slice, slice], inside: NDArray[np.bool_], height: NDArray[np.floating]) -> None:
        iron = np.array([0.075, 0.07, 0.066], np.float32) * height[..., None]
        color[at] = np.where(inside[..., None], iron, color[at])
        high = height > 1.0
        roughness[at] = np.where(inside, np.where(high, _IRON, _DIRT), roughness[at])
        metallic[at] = np.where(inside & high, _BARE, metallic[at])

    x, y = width * 0.5 + rng.uniform(-0.9, 0.9), rng.uniform(1.5, ROAD_TILE[1] - 1.5)
    at = _between(along, y - 0.5, y + 0.5), _between(across, x - 0.5, x + 0.5)
    near_x, near_y = across[:, at[1]], along[at[0]]
    radius = np.hypot(near_x - x, near_y - y)
    studs = 0.75 + 0.5 * ((np.floor(near_x / 0.045) + np.floor(near_y / 0.045)) % 2)
    cover(at, radius < 0.36, np.where(radius < 0.27, studs, np.where(radius < 0.30, 0.35, 1.3)))
    color[at] *= (1.0 - 0.45 * np.exp(-(((radius - 0.37) / 0.025) ** 2)))[..., None]
    for columns, edge in _kerbs(across, width):
        y = rng.uniform(1.5, ROAD_TILE[1] - 1.5)
        rows = _between(along, y - 0.3, y + 0.3)
        inside = (np.abs(edge - 0.19) < 0.17) & (np.abs(along[rows] - y) < 0.25)
        slots = np.where(np.abs(((along[rows] - y) / 0.07) % 1.0 - 0.5) < 0.26, 0.18, 1.2)
        cover((rows, columns), inside, slots)
    return _Layer(color, roughness, metallic)


def _soft(edge_distance: NDArray[np.floating], softness: float = 0.012) -> Field:
    return smoothstep(-softness, softness, edge_distance)


def _lane_paint(across: Field, along: Field, lane: tuple[float, ...]) -> Field:
    """Return broken lines between lanes and parking bays, two dashes per piece, and the bays' cross marks."""
    dash = _soft(1.15 - np.abs((along % 6.6) - 3.3))
    paint = np.zeros((_SIZE, _SIZE), np.float32)
    for x in lane:
        paint = np.maximum(paint, _soft(0.06 - np.abs(across - x)) * dash)
    bays = _soft(0.05 - np.abs((along % 6.6) - 6.0))
    for low, high in ((lane[0] - 0.55, lane[0] + 0.06), (lane[-1] - 0.06, lane[-1] + 0.55)):
        paint = np.maximum(paint, bays * _soft(np.minimum(across - low, high - across)))
    return paint


def _zebra_paint(across: Field, along: Field, width: float) -> Field:
    """Return bars half a metre wide and four metres long; the narrowest road has seven."""
    bars = _soft(0.25 - np.abs(((across - 0.35) % 1.0) - 0.25))
    bars = bars * _soft(np.minimum(across - 0.33, width - 0.33 - across))
    return (bars * _soft(2.0 - np.abs(along - 0.5 * ROAD_TILE[1]))).astype(np.float32)


def relief(color: Image, rng: np.random.Generator, width: float = ROAD_TILE[0]) -> Image:
    """Return the normals, (1024, 1024, 3), for a road's colour.

    They show the aggregate, and grooves at cracks, seams, joints and the edges of lids. Pixels much darker than their
    surroundings within a hand's breadth are up to 5 mm lower. Markings are slightly higher.

    Args:
        color: the colour from `asphalt`.
        rng: source of the aggregate.
        width: metres from kerb to kerb.
    """
    shape = (_SIZE, _SIZE)
    # The product is the sum of the channels, much faster than along the short axis.
    mean = color.astype(np.float32) @ np.ones(3, np.float32) / 3.0
    tone = gaussian_filter(mean / 255.0, 1.0, mode="wrap")
    around = gaussian_filter(tone, 9.0, mode="wrap")
    groove = smoothstep(0.06, 0.30, (around - tone) / np.maximum(around, 0.05))
    paint = smoothstep(0.52, 0.62, tone)
    height = 0.0009 * band_noise(shape, rng, longest=12, slope=0.2, tall=2.0)
    height = height + 0.0015 * band_noise(shape, rng, longest=200, shortest=40) - 0.005 * groove + 0.002 * paint
    return normal_map(height.astype(np.float32), (width / _SIZE, ROAD_TILE[1] / _SIZE))


def paving(rng: np.random.Generator) -> tuple[Image, Image, Image]:
    """Return colour, normals (1024²) and roughness (512²) of a footway of granite slabs with setts on both sides."""
    shape = (_SIZE, _SIZE)
    centre = (np.arange(_SIZE, dtype=np.float32) + 0.5) / _SIZE
    across, along = (centre * PAVING_TILE[0])[None], (centre * PAVING_TILE[1])[:, None]
    wobble = band_noise(shape, rng, longest=60, shortest=12)
    slab = np.abs(across - 1.3) < 0.8
    # slabs 0.8 m wide in two staggered rows, four per tile
    row = np.floor((across - 0.5) / 0.8)
    position = along / 0.8 + 0.5 * row
    number = np.floor(position).astype(np.int64) % 4 * 5 + row.astype(np.int64)
    slab_joint = np.minimum(
        np.abs(position - np.round(position)) * 0.8, np.abs((across - 0.5) / 0.8 - np.round((across - 0.5) / 0.8)) * 0.8
    )
    # setts of 6.4 cm (50 in 3.2 m), with noise
    u, v = across / 0.062 + 0.16 * wobble, along / 0.064 + 0.16 * band_noise(shape, rng, longest=60, shortest=12)
    u = u + 0.5 * (np.floor(v) % 2)
    sett_joint = 0.063 * np.minimum(0.5 - np.abs(u - np.floor(u) - 0.5), 0.5 - np.abs(v - np.floor(v) - 0.5))
    stone = np.floor(u).astype(np.int64) * 977 + np.floor(v).astype(np.int64) % 50

    fine = band_noise(shape, rng, longest=5, slope=0.2)
    cloud = band_noise(shape, rng, longest=400, shortest=30)
    slab_tone = (0.29 + 0.07 * hashed(number, int(rng.integers(2**31)))) * (1.0 + 0.11 * fine + 0.05 * cloud)
    slab_head, sett_head = smoothstep(0.002, 0.010, slab_joint), smoothstep(0.002, 0.012, sett_joint)
    slab_tone = slab_tone * (0.4 + 0.6 * slab_head)
    sett_tone = (0.15 + 0.14 * hashed(stone, int(rng.integers(2**31)))) * (1.0 + 0.12 * fine + 0.08 * cloud)
    sett_tone = sett_tone * (0.38 + 0.62 * sett_head)
    tone = np.where(slab, slab_tone, sett_tone)
    tone *= 1.0 - 0.35 * np.exp(-((across / 0.09) ** 2))  # damp and dirt at the foot of the wall
    spots = smoothstep(1.9, 2.3, band_noise(shape, rng, longest=30, shortest=8))
    tone *= 1.0 - 0.4 * spots
    # Feet polish the slabs, most of all in the middle.
    polish = toward(np.full(shape, 0.87, np.float32), 0.79, np.exp(-(((across - 1.3) / 0.5) ** 2)))
    stones = np.where(slab, polish + 0.04 * (hashed(number, 5) - 0.5), 0.83) + 0.02 * fine + 0.03 * cloud
    roughness = toward(np.full(shape, _JOINT, np.float32), stones, np.where(slab, slab_head, sett_head))
    roughness = toward(roughness, 0.6, spots)
    height = np.where(slab, 0.004 * smoothstep(0.0, 0.008, slab_joint), 0.007 * smoothstep(0.0, 0.02, sett_joint))
    height = height + 0.0003 * fine
    color = tone[..., None] * np.where(slab[..., None], [1.0, 0.975, 0.93], [1.0, 0.98, 0.95])
    normals = normal_map(height, (PAVING_TILE[0] / _SIZE, PAVING_TILE[1] / _SIZE))
    return srgb8(color), normals, roughness_map(roughness)


def turf(rng: np.random.Generator) -> Image:
    """Return short grass, (256, 256, 3) sRGB, 2 m."""
    shape = (256, 256)
    blades = stretched_noise(shape, rng, rows=7, columns=3, slope=0.2)
    patches = band_noise(shape, rng, longest=200, shortest=20)
    tone = 0.11 * (1.0 + 0.35 * blades + 0.15 * patches)
    dry = smoothstep(0.5, 2.0, patches)[..., None]
    return srgb8(tone[..., None] * (np.array([0.75, 1.0, 0.28]) * (1.0 - dry) + np.array([1.15, 1.05, 0.5]) * dry))
