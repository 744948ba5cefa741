"""The asset pack ``urban-street``: a generated street with houses, trees, traffic, pedestrians, three cameras and the sun.

Vehicles in traffic are hidden by default and then cost nothing. Parked ones belong to the background, so each value of a varied
colour or door needs its own background. All vehicles have nodes for body, doors and wheels.

The cameras (50 mm on a 36 mm wide sensor: 39.6° × 22.9° at 16:9) stand at y = −12 m, so that each of the paper's
positions (x −2…7 m, y 5…35 m; section 6.1) is at least 17 m from every optical centre and inside every image. The truth pass
measured the following at 960×540 over these positions and both characters, with mixed headings (seed 0; *alone* is the share of
the image without occlusion):

==== ============ ===================
y    distance     pixel area, alone
==== ============ ===================
5    17.1…18.4 m  0.58…0.82 %
11   23.0…24.0 m  0.32…0.45 %
17   29.0…29.8 m  0.20…0.28 %
23   35.0…35.7 m  0.14…0.19 %
29   41.0…41.6 m  0.11…0.14 %
35   47.0…47.5 m  0.07…0.11 %
==== ============ ===================

In 24…33 % of a camera's frames the person is occluded by 5…75 %, and in about half by more than 5 %; 8…13 % of the persons are
fully hidden (``valerie plan --truth-only``). The paper's 17…38.2 m correspond to y 5…26.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from pydantic import Field

from urban_street.pedestrians import PLACES
from urban_street.site import CameraPlace, Pack, Site, draw_season, nearest_cars, numbered, picked
from urban_street.street.layout import layout_street
from urban_street.street.plan import PEOPLE_Y, StreetSettings
from urban_street.traffic_places import UNTRAINED, WAITING, traffic
from urban_street.varied_houses import varied_houses, ways
from valerie.scene.assets.asset import AssetArguments, PackSettings

#: In the lane at a driver's height; near the left kerb, turned slightly right; higher on the right, as in a van.
CAMERAS: Final = {
    "camera-1": CameraPlace((2.5, -12.0, 1.4), 0.0, 0.0),
    "camera-2": CameraPlace((0.6, -12.0, 1.3), 358.0, 0.0),
    "camera-3": CameraPlace((4.6, -12.0, 2.2), 2.5, -1.0),
}
#: Number of parked cars with parameters: those nearest to the places of people.
_PARKED: Final = 3


class Settings(StreetSettings, PackSettings):
    """The arguments of the street: those of `StreetSettings`, and the number of persons."""

    persons: int = Field(default=2, ge=1, le=len(PLACES))


def site(settings: Settings) -> Site:
    """Plan a street in milliseconds."""
    layout = layout_street(settings)
    return Site(
        name="urban-street",
        title="Urban street",
        description=f"A generated street of {settings.length_m:.0f} m with houses, trees, vehicles and pedestrians.",
        layout=layout,
        cameras=CAMERAS,
        people=numbered(PLACES[: settings.persons]),
        vehicles=traffic(layout),
        waiting=WAITING,
        parked=nearest_cars(layout, _PARKED, PEOPLE_Y),
        houses=tuple(varied_houses(layout)),
        ways=tuple(ways(layout)),
        untrained=UNTRAINED,
        positions="the generated street, wider than the paper's positions (section 6.1)",
    )


def draw_arguments(rng: np.random.Generator) -> AssetArguments:
    """Draw the arguments of a training street, except its seed, with ``rng``."""
    return {
        **draw_season(rng),
        "surface": picked(rng, {"asphalt": 0.85, "paving": 0.15}),
        "side_street": picked(rng, {"right": 0.4, "left": 0.25, "both": 0.15, "none": 0.2}),
        "lanes": int(rng.choice([1, 2, 3], p=[0.65, 0.25, 0.1])),
        "pavement_width_m": round(float(rng.uniform(2.2, 4.5)), 2),
        "setback_m": float(rng.choice([0.0, 0.0, 0.0, 2.5])),
    }


#: Its revision is part of the asset's digest. Raise it whenever the street, the characters, cameras or defaults change.
PACK: Final = Pack(7, Settings, site, draw_arguments)
REVISION: Final = PACK.REVISION
make_manifest, make_scene = PACK.make_manifest, PACK.make_scene
