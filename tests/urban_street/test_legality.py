"""Legal and illegal places in the street."""

import re

import numpy as np
import pytest
import shapely

from tests.sampling import enough_to_show
from valerie.parameters.definitions import ParameterDefinition, ParameterType, Value
from valerie.scene.assets.asset import asset_manifest
from valerie.scene.legality.rejection import rejection_reason, rejection_reasons


def test_places_in_the_street_are_judged_by_the_distance_to_the_obstacles() -> None:
    manifest, _ = asset_manifest("urban-street")
    hidden = (*(f"scene.{name}" for name in ("car-101", "car-102", "car-103", "truck-102")),
              *(d.path.removesuffix(".visible") for d in manifest.parameters
              if d.path.endswith(".visible") and not d.default))  # fmt: skip
    there = [
        shapely.Polygon(obstacle.polygon)
        for obstacle in manifest.obstacles
        if not f"{obstacle.path}.".startswith(tuple(f"{path}." for path in hidden))
    ]
    tree, radius = shapely.STRtree(there), manifest.person_radius_m
    places = np.random.default_rng(5).uniform((-10, 0), (20, 100), (2000, 2))
    nearest = tree.query_nearest(shapely.points(places), return_distance=True, all_matches=False)[1]
    x0, y0, x1, y1 = manifest.extent
    judged = 0
    for (x, y), distance in zip(places.tolist(), nearest.tolist(), strict=True):
        if (
            abs(distance - radius) > 0.0013 * radius
        ):  # round corners have 64 sides, up to r (1 − cos π/64) inside the circle
            judged += 1
            reason = rejection_reason({"scene.person-1.pos.x": x, "scene.person-1.pos.y": y}, manifest)
            assert (reason is None) == (distance > radius and x0 <= x <= x1 and y0 <= y <= y1), (x, y)
    assert judged >= enough_to_show(0.0016)


@pytest.mark.parametrize("arguments", [{}, {"seed": 3, "lanes": 2}, {"side_street": "none", "persons": 8}])
def test_the_places_of_the_streets_own_vehicles_are_legal(arguments: dict[str, Value]) -> None:
    manifest, _ = asset_manifest({"name": "urban-street", **arguments})
    everything = {definition.path: definition.check(definition.default) for definition in manifest.parameters}
    assert rejection_reason(everything, manifest) is None
    hidden = [path for path, value in everything.items() if path.endswith(".visible") and value is False]
    assert len(hidden) == 4
    shown: dict[str, Value] = {**everything, **dict.fromkeys(hidden, True)}
    for path in ("car-101", "car-102", "car-103", "truck-102"):
        for kind in manifest.by_path[f"scene.{path}.kind"].choices:
            assert rejection_reason({**shown, f"scene.{path}.kind": kind}, manifest) is None


def _drawn(definition: ParameterDefinition, rng: np.random.Generator) -> Value:
    """Draw a value, mostly near that of the asset's author, since elsewhere most places are illegal."""
    if definition.choices:
        return definition.choices[rng.integers(len(definition.choices))]
    if definition.type is ParameterType.BOOL:
        return bool(rng.integers(2))
    low, high = definition.minimum, definition.maximum
    assert low is not None
    assert high is not None
    number = rng.normal(float(definition.default), 2.0) if rng.random() < 0.8 else rng.uniform(low, high)
    return definition.check(min(max(number, low), high))


@pytest.mark.parametrize(
    "given",
    [
        r"person-\d+\.(pos\.[xy]|heading|pose|character)",
        r"person-1\.pos\.[xy]|environment-1\.(rain|snowfall)",
        r"(person-1|car-\d+|truck-\d+|bus-\d+)\.(pos\.[xy]|heading|kind|visible)",
        r"camera-1\.pos\.[xyz]|car-\d+\.pos\.[xy]|building-\d+\.(pos\.[xy]|scale)",
    ],
)
@pytest.mark.parametrize(
    "name", ["urban-street", "street-crossing", "rural-road", "car-park", "bus-stop", "motorway-exit"]
)
def test_many_variants_at_once_are_judged_as_one_by_one(name: str, given: str) -> None:
    manifest, _ = asset_manifest({"name": name, "season": "winter"} if "snowfall" in given else name)
    paths = [path for path in manifest.by_path if re.fullmatch(rf"scene\.({given})", path)]
    rng = np.random.default_rng(11)
    few = rng.choice(paths, min(len(paths), 5), replace=False).tolist()
    for chosen in (paths, few):
        variants = [{path: _drawn(manifest.by_path[path], rng) for path in chosen} for _ in range(150)]
        variants += [{path: value for path, value in v.items() if path != chosen[0]} for v in variants[:5]]
        one_by_one = [rejection_reason(variant, manifest) for variant in variants]
        assert rejection_reasons(variants, manifest) == one_by_one
        assert rejection_reasons(variants[:3], manifest) == one_by_one[:3]
        assert len(set(one_by_one)) > 2


def test_a_car_that_drives_does_not_drive_through_one_that_is_parked() -> None:
    manifest, _ = asset_manifest("urban-street")
    x, y = (manifest.by_path[f"scene.car-1.pos.{axis}"].default for axis in "xy")
    driving: dict[str, Value] = {"scene.car-101.kind": "sedan", "scene.car-101.pos.x": 1.6, "scene.car-101.pos.y": y}
    assert rejection_reason(driving, manifest) == "car-1 and car-101 overlap"
    assert rejection_reason({**driving, "scene.car-101.pos.x": 2.4}, manifest) is None
    assert rejection_reason({**driving, "scene.car-101.kind": "absent"}, manifest) is None
    assert rejection_reason({"scene.car-1.pos.x": float(x) - 1.0}, manifest) == "car-1 leaves its level ground"


def test_in_the_street_a_car_that_drives_over_a_camera_is_rejected() -> None:
    manifest, _ = asset_manifest("urban-street")
    x, y, z = (float(manifest.by_path[f"scene.camera-1.pos.{axis}"].default) for axis in "xyz")
    driving: dict[str, Value] = {"scene.car-101.kind": "van", "scene.car-101.pos.x": x, "scene.car-101.pos.y": y + 6}
    low = {"scene.camera-1.pos.z": 1.2}
    for assignment in (driving, driving | low):
        assert rejection_reason(assignment, manifest) is None, (x, y, z)
    over = {**driving, "scene.car-101.pos.y": y}
    assert rejection_reason(over | low, manifest) == "camera-1 is inside car-101"
    assert rejection_reason({**over, "scene.car-101.kind": "absent"}, manifest) is None
