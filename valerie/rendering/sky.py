"""The daylight sky: colour of the sun at the ground, radiance of the sky, and haze. Computed on the CPU, once per sun.

Single scattering in a spherical atmosphere after Nishita et al. 1993, "Display of the Earth taking into account
atmospheric scattering" (doi:10.1145/166117.166140), with an isotropic estimate of the higher orders. Rayleigh
coefficients and scale heights are those of Bruneton and Neyret 2008 (doi:10.1111/j.1467-8659.2008.01245.x), absorption
by ozone is that of Hillaire 2020 (doi:10.1111/cgf.14050); without it, the sky of a low sun is olive. Haze follows
from turbidity by its definition: the ratio of the vertical optical thickness of haze and air to that of air, at 550 nm.

Units. All radiances here and in the linear image are `EXPOSURE` × π × radiance. The sun's luminance at the ground is the
scene's `Sun.irradiance` at every elevation above `DUSK`. Its colour and the ratio of sky to sun follow from the model
(bounded for a low sun, see `_bounded`). Below `DUSK`, light falls as measured from sunset to night (`_dusk`). An irradiance
of 1 stands for `NOON_LUX`, which converts the candela of lamps to image values (`LUX`).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

from valerie.color import LUMINANCE
from valerie.scene.graph.model import CLEAR_VISIBILITY_M, Environment, Scene
from valerie.scene.light.weather import flakes_per_m3, snow_cover, snow_extinction, wetness

Array = NDArray[np.float64]

#: Image value of a white Lambertian surface that faces a sun of irradiance 1, without the sky. It is the exposure at which a
#: clear day looks right through the default tone curve at 0 EV (sunlit asphalt 0.15 … 0.3, middle grey in the sun 0.4).
EXPOSURE: Final = 2.4
#: Illuminance of a surface that faces a sun of irradiance 1, lux: a clear noon (IES Lighting Handbook; the sky adds
#: 10,000 … 20,000).
NOON_LUX: Final = 100_000.0
#: Image value of a white Lambertian surface per lux.
LUX: Final = EXPOSURE / NOON_LUX
#: Elevation of the sun, degrees, above which the day model applies unchanged.
DUSK: Final = 3.0
#: Illuminance by the glow of a city in a clear sky, lux: 0.016 cd/m² all over the sky (Kyba et al. 2015,
#: doi:10.1038/srep08409, urban sites).
NIGHT_LUX: Final = 0.05
#: Columns of the sky table over the azimuth relative to the sun (0 … π; the sky is symmetric).
AZIMUTHS: Final = 48
#: Rows of the sky table over elevation (0 … π/2, spaced by squares).
ELEVATIONS: Final = 40

#: Thickness of the fog layer, metres.
FOG_HEIGHT_M: Final = 60.0

_GROUND: Final = 6_360e3
_TOP: Final = 6_420e3
_RAYLEIGH: Final = np.array([5.8e-6, 13.5e-6, 33.1e-6])
_RAYLEIGH_HEIGHT: Final = 8_000.0
_MIE_HEIGHT: Final = 1_200.0
#: Absorption by ozone at 25 km, where it is densest, per metre. It falls to nothing over 15 km above and below.
_OZONE: Final = np.array([0.65e-6, 1.881e-6, 0.085e-6])
#: Haze scatters blue more than red: (λ / 550 nm)^−1.3 (Ångström 1929) at 680, 550 and 440 nm.
_MIE_SPECTRUM: Final = np.array([0.76, 1.0, 1.34])
_MIE_ALBEDO: Final = 0.9
_MIE_G: Final = 0.76
#: Share of the light scattered by haze that stays so close to its direction that it counts as not scattered: delta-Eddington
#: scaling (Joseph, Wiscombe and Weinman 1976, doi:10.1175/1520-0469(1976)033<2452:TDEAFR>2.0.CO;2). Single scattering would
#: lose it, and make the sky near the horizon too dark.
_MIE_FORWARD: Final = _MIE_G**2
#: Share of the extinction by haze that is left.
_MIE_LOSS: Final = 1 - _MIE_ALBEDO * _MIE_FORWARD
#: Colour of the sun above the atmosphere; slightly blue, so that noon light (sun and sky together) is white.
_SUN_ABOVE_AIR: Final = np.array([0.96, 1.0, 1.07])
_GROUND_ALBEDO: Final = 0.2
#: Albedo of fresh snow in a town, linear RGB (S. Warren, "Optical properties of snow", Rev. Geophys. 20, 1982,
#: doi:10.1029/RG020i001p00067, less the soot and dust of a street).
SNOW_ALBEDO: Final = np.array([0.80, 0.82, 0.85])
_BRIGHTEST_SKY: Final = 0.6
#: Elevation at which the sun's upper edge sets, degrees, without the refraction that the polynomials below include.
_SUNSET: Final = -0.8
#: Lowest elevation in degrees, and coefficients of the polynomial above it (see `twilight_lux`).
_TWILIGHTS: Final = (
    (-0.8, (2.88, 22.26, -207.64, 1034.30)),
    (-5.0, (2.88, 21.81, -258.11, -858.36)),
    (-12.0, (2.70, 12.17, -431.69, -1899.83)),
    (-18.0, (13.84, 262.72, 1447.42, 2797.93)),
)
#: Colour of the sky in deep twilight, when ozone has absorbed the yellow: about that of a black body at 15,000 K (Hulburt
#: 1953, doi:10.1364/JOSA.43.000113).
_TWILIGHT: Final = np.array([0.50, 0.85, 1.60])
_SAMPLES: Final = 20
_SUN_SAMPLES: Final = 8


@dataclass(frozen=True, slots=True, eq=False)
class Sky:
    """The light of one sun and one atmosphere. All colours are linear RGB in the image's unit.

    Attributes:
        sun_direction: (3,) unit vector towards the sun, in the world.
        sun: (3,) irradiance of a surface that faces the sun; zero when the sun is below the horizon.
        table: (ELEVATIONS, AZIMUTHS, 3) float32 sky radiance, see `sky_directions`.
        extinction: (3,) extinction coefficient of the air at the ground, per metre.
        haze: (3,) radiance of the horizon, into which distant things fade.
        ground: (3,) radiance of sunlit and skylit ground of albedo 0.2, or of snow.
        sky_irradiance: (3,) irradiance of a horizontal surface by the whole sky, without the sun.
        lux: illuminance of the ground by sun and sky.
        fog: the part of ``extinction`` by fog, rain and snowfall, per metre; 0 in clear air.
        wetness: wetness of surfaces that face up, 0 dry … 1 wet.
        drops: share of the image that rain streaks cross, 0 without rain.
        flakes: visible snowflakes per cubic metre of air.
        snow_depth: metres of lying snow.
        leaf_litter: share of level surfaces that leaves cover.
    """

    sun_direction: Array
    sun: Array
    table: NDArray[np.float32]
    extinction: Array
    haze: Array
    ground: Array
    sky_irradiance: Array
    lux: float
    fog: float
    wetness: float
    drops: float
    flakes: float
    snow_depth: float
    leaf_litter: float

    def radiance(self, directions: Array) -> Array:
        """Return the sky's radiance, (N, 3), in world directions above the horizon, (N, 3), from the nearest table entries."""
        elevation = np.arcsin(np.clip(directions[:, 2], 0, 1))
        horizontal = directions[:, :2] / np.maximum(np.linalg.norm(directions[:, :2], axis=1, keepdims=True), 1e-9)
        toward = self.sun_direction[:2] / max(float(np.linalg.norm(self.sun_direction[:2])), 1e-9)
        azimuth = np.arccos(np.clip(horizontal @ toward, -1, 1))
        row = np.clip(np.sqrt(elevation / (np.pi / 2)) * ELEVATIONS, 0, ELEVATIONS - 1).astype(int)
        column = np.clip(azimuth / np.pi * AZIMUTHS, 0, AZIMUTHS - 1).astype(int)
        radiance: Array = self.table[row, column].astype(np.float64)
        return radiance


def sky_of(scene: Scene) -> Sky:
    """Return the sky of a scene. In clear air without clouds, rain and snow it is exactly the clear sky's model."""
    sun, environment = scene.sun, scene.environment
    sun_color, table, extinction = _unit_sky(sun.elevation, environment.turbidity)
    if np.rad2deg(sun.elevation) < DUSK:
        sun_color, table = _dusk(sun_color, table, sun.elevation)
    table = table * (EXPOSURE * sun.irradiance * environment.sky_strength)
    sky_irradiance = _horizontal(table)
    direct = sun_color * (EXPOSURE * sun.irradiance)
    height = max(np.sin(sun.elevation), 0.0)
    if np.rad2deg(sun.elevation) < DUSK:
        table = table + NIGHT_LUX * LUX
        sky_irradiance = _horizontal(table)
    if environment.cloud_cover > 0:
        direct, table = _clouded(direct, table, sky_irradiance, height, environment.cloud_cover)
        sky_irradiance = _horizontal(table)
    haze = table[1].mean(axis=0)
    fog = fog_extinction(environment)
    if fog > 0:
        direct, table = _fogged(direct, table, sky_irradiance, height, fog)
        sky_irradiance = _horizontal(table)
        # Light in fog comes from all sides. Its share of the haze is the share of the fog in the extinction.
        share = fog / (fog + float(extinction[1]))
        haze = (1 - share) * haze + share * 0.7 * (sky_irradiance + direct * height)
        extinction = extinction + fog
    albedo = _GROUND_ALBEDO + snow_cover(environment.snow_depth) * (SNOW_ALBEDO - _GROUND_ALBEDO)
    ground = albedo * (direct * height + sky_irradiance)
    return Sky(
        sun_direction=scene.sun_direction(),
        sun=direct,
        table=table.astype(np.float32),
        extinction=extinction,
        haze=haze,
        ground=ground,
        sky_irradiance=sky_irradiance,
        lux=float((direct * height + sky_irradiance) @ LUMINANCE) / LUX,
        fog=fog,
        wetness=wetness(environment.rain),
        drops=0.0 if environment.rain <= 0 else float(np.clip(0.08 * environment.rain**0.5, 0.0, 0.5)),
        flakes=flakes_per_m3(environment.snowfall),
        snow_depth=environment.snow_depth,
        leaf_litter=environment.leaf_litter,
    )


def fog_extinction(environment: Environment) -> float:
    """Return the extinction coefficient of fog, rain and snowfall, per metre.

    Fog: Koschmieder 1924, −ln(0.02) / visibility, minus the value at `CLEAR_VISIBILITY_M`. Rain: 1.076 R^0.67 dB/km for R in
    mm/h (Carbonneau and Wisely 1998, doi:10.1117/12.326801). Snowfall: `snow_extinction`.
    """
    koschmieder = -np.log(0.02)
    fog = koschmieder * max(1 / environment.visibility - 1 / CLEAR_VISIBILITY_M, 0.0)
    rain = 1.076 * environment.rain**0.67 * np.log(10) / 10 / 1000 if environment.rain > 0 else 0.0
    return float(fog + rain + snow_extinction(environment.snowfall))


def _dusk(sun_color: Array, table: Array, elevation: float) -> tuple[Array, Array]:
    """Return sun and sky between `DUSK` and night, with measured brightness and bluer than the model.

    The illuminance of the ground changes, on a logarithmic scale, from the model's to that of Seidelmann (`twilight_lux`). Once
    the sun lights no visible air, the last light comes evenly from the whole sky.
    """
    degrees = float(np.rad2deg(elevation))
    model = float((sun_color * max(np.sin(elevation), 0.0) + _horizontal(table)) @ LUMINANCE) * NOON_LUX
    day = _smooth((degrees - _SUNSET) / (DUSK - _SUNSET))
    lux = model**day * twilight_lux(degrees) ** (1 - day)
    share = lux / model
    # The model's sun does not sink, which would lengthen the way of its light through ozone; so the hue passes to twilight's.
    blue, own = (color / float(color @ LUMINANCE) for color in (_TWILIGHT, _horizontal(table)))
    tinted = table * (blue / own) ** _smooth((DUSK - degrees) / 9.0)
    tinted *= float(_horizontal(table) @ LUMINANCE) / float(_horizontal(tinted) @ LUMINANCE) * share
    even = _smooth((-4.0 - degrees) / 8.0)
    table = (1 - even) * tinted + even * blue * float(_horizontal(tinted) @ LUMINANCE)
    return sun_color * share, table


def twilight_lux(degrees: float) -> float:
    """Return the illuminance of the ground by sun and a clear, moonless sky, for an elevation of −18° … 5° (below: night).

    log₁₀ E as polynomials of elevation / 90°: Janiczek and DeYoung 1987, "Computer programs for sun and moon illuminance",
    US Naval Observatory Circular 171, as in Seidelmann 1992, "Explanatory Supplement to the Astronomical Almanac", p. 491.
    """
    x = max(degrees, -18.0) / 90.0
    terms = next(terms for lowest, terms in _TWILIGHTS if x * 90.0 >= lowest)
    return float(10.0 ** sum(term * x**power for power, term in enumerate(terms)))


def _smooth(share: float) -> float:
    share = float(np.clip(share, 0.0, 1.0))
    return share * share * (3.0 - 2.0 * share)


def _clouded(direct: Array, table: Array, diffuse: Array, height: float, cover: float) -> tuple[Array, Array]:
    """Return sun and sky under clouds.

    A cloud cover N scales the global irradiance by 1 − 0.75 N^3.4 (Kasten and Czeplak 1980, doi:10.1016/0038-092X(80)90391-6),
    and the beam and the clear sky between the clouds by 1 − N. The rest is grey light from the clouds, with the distribution of
    the CIE overcast sky (Moon and Spencer 1942): radiance proportional to 1 + 2 sin(elevation).
    """
    clear_total = direct * height + diffuse
    total = (1 - 0.75 * cover**3.4) * clear_total
    beam, between = direct * (1 - cover), table * (1 - cover)
    cloud_light = np.maximum(total - beam * height - diffuse * (1 - cover), 0.0)
    grey = np.full(3, float(cloud_light @ LUMINANCE))
    overcast = ((1 + 2 * np.sin(_elevations())) / 3)[:, None, None] * np.ones((ELEVATIONS, AZIMUTHS, 3))
    return beam, between + overcast * (grey / _horizontal(overcast))


def _fogged(direct: Array, table: Array, diffuse: Array, height: float, fog: float) -> tuple[Array, Array]:
    """Return sun and sky below a layer of fog `FOG_HEIGHT_M` thick. Light that beam and sky lose comes from all sides.

    A share of 1 / (1 + 0.15 τ) of the scattered light reaches the ground (two-stream approximation with the forward scattering
    of droplets, asymmetry 0.85: Bohren 1987, doi:10.1119/1.15109).
    """
    thickness = fog * FOG_HEIGHT_M
    beam = np.exp(-thickness / max(height, 0.05))
    transmittance = np.exp(-thickness / np.maximum(np.sin(_elevations()), 0.02))[:, None, None]
    transmitted = table * transmittance
    loss = direct * height * (1 - beam) + np.maximum(diffuse - _horizontal(transmitted), 0.0)
    grey = np.full(3, float(loss @ LUMINANCE)) / (1 + 0.15 * thickness)
    veil = (1 - transmittance) * np.ones((ELEVATIONS, AZIMUTHS, 3))
    return direct * beam, transmitted + veil * (grey / np.maximum(_horizontal(veil), 1e-9))


def sky_directions() -> Array:
    """Return the directions of the table's entries, (ELEVATIONS, AZIMUTHS, 3) unit vectors with the sun's azimuth at +x."""
    elevation = _elevations()[:, None]
    azimuth = ((np.arange(AZIMUTHS) + 0.5) / AZIMUTHS * np.pi)[None, :]
    flat = np.cos(elevation)
    return np.stack(
        [flat * np.cos(azimuth), flat * np.sin(azimuth), np.broadcast_to(np.sin(elevation), (ELEVATIONS, AZIMUTHS))],
        axis=-1,
    )


def _horizontal(table: Array) -> Array:
    """Return the irradiance of the ground by a sky, (3,): the cosine-weighted mean over the hemisphere.

    The table spans half of the hemisphere; the other half is its mirror image.
    """
    elevation = _elevations()
    weight = np.cos(elevation) * np.sin(elevation) * np.gradient(elevation)
    mean: Array = (table.mean(axis=1) * weight[:, None]).sum(axis=0) / weight.sum()
    return mean


def _bounded(irradiance: float) -> float:
    """Return the factor that keeps the sky's irradiance below `_BRIGHTEST_SKY` of the sun's.

    The scene sets the sun's luminance at the ground. A low sun in hazy air would therefore have an enormous luminance above the
    atmosphere, and its sky would outshine everything. Below half of the bound, the factor is within 2 % of 1.
    """
    return float((1 + (irradiance / _BRIGHTEST_SKY) ** 4) ** -0.25)


def _elevations() -> Array:
    rows: Array = ((np.arange(ELEVATIONS) + 0.5) / ELEVATIONS) ** 2 * (np.pi / 2)
    return rows


@lru_cache(maxsize=64)
def _unit_sky(elevation: float, turbidity: float) -> tuple[Array, Array, Array]:
    """Return the colour of a sun with luminance 1 at the ground, its sky table, and the extinction at the ground per metre."""
    thickness = _RAYLEIGH[1] * _RAYLEIGH_HEIGHT
    mie = max(turbidity - 1.0, 0.0) * thickness / _MIE_HEIGHT
    # A sun at or below the horizon lights only the high air. The model's sun stays just above; `_dusk` sets its brightness.
    above = max(elevation, np.deg2rad(0.5))
    toward_sun = np.array([np.cos(above), 0.0, np.sin(above)])
    observer = np.array([[0.0, 0.0, _GROUND + 2.0]])
    transmitted = (_SUN_ABOVE_AIR * np.exp(-_thickness(observer, toward_sun[None], mie)))[0]
    strength = 1.0 / float(transmitted @ LUMINANCE)
    directions = sky_directions().reshape(-1, 3)
    first, scattering = _scattered(directions, toward_sun, mie)
    weight = (np.cos(_elevations()) * np.gradient(_elevations()))[:, None, None]
    mean_sky = (first.reshape(ELEVATIONS, AZIMUTHS, 3) * weight).sum(axis=(0, 1)) / (weight.sum() * AZIMUTHS)
    mean = 0.5 * mean_sky + 0.5 * _GROUND_ALBEDO * (transmitted * toward_sun[2] / np.pi + mean_sky)
    # Each order counts as isotropic light with the mean radiance of the previous order: a geometric series.
    returned = 0.5 * (scattering.reshape(ELEVATIONS, AZIMUTHS, 3) * weight).sum(axis=(0, 1)) / (weight.sum() * AZIMUTHS)
    higher = scattering * mean / (1 - np.minimum(returned, 0.9))
    table = ((first + higher) * strength * np.pi).reshape(ELEVATIONS, AZIMUTHS, 3)
    table = table * _bounded(float(_horizontal(table) @ LUMINANCE))
    risen = float(np.clip(np.rad2deg(elevation) / 0.5 + 0.5, 0, 1))
    return transmitted * strength * risen, table, _RAYLEIGH + mie * _MIE_SPECTRUM


def _scattered(directions: Array, toward_sun: Array, mie: float) -> tuple[Array, Array]:
    """Return the first-order radiance, (N, 3), per unit of sun, and the factor for the radiance of isotropic surroundings."""
    origin = np.array([0.0, 0.0, _GROUND + 2.0])
    length = _to_sphere(origin[None], directions, _TOP)
    edges = (np.linspace(0, 1, _SAMPLES + 1) ** 2.5)[None, :] * length[:, None]
    middle, step = (edges[:, 1:] + edges[:, :-1]) / 2, np.diff(edges, axis=1)
    points = origin + directions[:, None, :] * middle[..., None]
    height = np.maximum(np.linalg.norm(points, axis=-1) - _GROUND, 0)
    air, haze, ozone = _densities(height)
    haze *= mie
    extinction = air[..., None] * _RAYLEIGH + (haze * _MIE_LOSS)[..., None] * _MIE_SPECTRUM + ozone[..., None] * _OZONE
    travelled = np.cumsum(extinction * step[..., None], axis=1) - extinction * step[..., None] / 2
    to_sun = _thickness(points.reshape(-1, 3), np.broadcast_to(toward_sun, (points.size // 3, 3)), mie)
    reaching = np.exp(-travelled - to_sun.reshape(travelled.shape)) * _SUN_ABOVE_AIR
    cosine = directions @ toward_sun
    rayleigh_phase = 3 / (16 * np.pi) * (1 + cosine**2)
    g = _MIE_G
    mie_phase = (1 - g * g) / (4 * np.pi * (1 + g * g - 2 * g * cosine) ** 1.5)
    by_air = (reaching * (air * step)[..., None]).sum(axis=1) * _RAYLEIGH * rayleigh_phase[:, None]
    by_haze = (reaching * (haze * step)[..., None]).sum(axis=1) * (_MIE_ALBEDO * _MIE_SPECTRUM) * mie_phase[:, None]
    turned = haze * _MIE_ALBEDO * (1 - _MIE_FORWARD)
    scattered = air[..., None] * _RAYLEIGH + turned[..., None] * _MIE_SPECTRUM
    surrounding = (np.exp(-travelled) * scattered * step[..., None]).sum(axis=1)
    return by_air + by_haze, surrounding


def _thickness(points: Array, directions: Array, mie: float) -> Array:
    """Return the optical thickness from points to the top of the atmosphere, (N, 3); large where the ground is in the way."""
    length = _to_sphere(points, directions, _TOP)
    edges = (np.linspace(0, 1, _SUN_SAMPLES + 1) ** 2)[None, :] * length[:, None]
    middle, step = (edges[:, 1:] + edges[:, :-1]) / 2, np.diff(edges, axis=1)
    samples = points[:, None, :] + directions[:, None, :] * middle[..., None]
    height = np.maximum(np.linalg.norm(samples, axis=-1) - _GROUND, 0)
    air, haze, ozone = ((density * step).sum(axis=1)[:, None] for density in _densities(height))
    thickness: Array = air * _RAYLEIGH + haze * mie * _MIE_LOSS * _MIE_SPECTRUM + ozone * _OZONE
    return thickness


def _densities(height: Array) -> tuple[Array, Array, Array]:
    """Return the densities of air, haze and ozone at a height, metres, as shares of the largest."""
    ozone = np.maximum(1.0 - np.abs(height - 25_000.0) / 15_000.0, 0.0)
    return np.exp(-height / _RAYLEIGH_HEIGHT), np.exp(-height / _MIE_HEIGHT), ozone


def _to_sphere(points: Array, directions: Array, radius: float) -> Array:
    """Return the distance, (N,), from points inside a sphere around the origin to its surface along unit directions."""
    along = (points * directions).sum(axis=1)
    distance: Array = -along + np.sqrt(along**2 - (points**2).sum(axis=1) + radius**2)
    return distance
