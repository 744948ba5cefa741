"""Test the effect of each declared parameter against a table by hand; the rest of the scene must stay unchanged."""

import math
from collections.abc import Callable, Iterator
from dataclasses import asdict, replace
from unittest.mock import ANY

import pytest

from urban_street.human import CHARACTERS
from urban_street.pedestrians import aid_classes
from valerie.parameters.definitions import ParameterDefinition, Value
from valerie.parameters.odd import OddAttribute
from valerie.scene.assets.asset import SceneAsset, asset_manifest, load_asset
from valerie.scene.assets.sensor_parameters import SENSOR_PARAMETERS
from valerie.scene.graph.model import Scene
from valerie.scene.graph.naming import ROOT
from valerie.scene.variation.variant import apply

MANIFEST = asset_manifest("urban-street")[0]
#: Values that show everything, since parameters of absent things have no effect.
EVERYTHING_SHOWN: dict[str, Value] = {
    "scene.person-2.character": "red-coat",
    "scene.car-101.kind": "suv",
    "scene.bicycle-101.visible": True,
    "scene.car-102.kind": "van",
    "scene.motorcycle-101.visible": True,
    "scene.truck-101.visible": True,
    "scene.car-103.kind": "camper",
    "scene.truck-102.kind": "box-truck",
    "scene.bus-101.visible": True,
}

#: Nodes of strollers, pushed bicycles and the like, which are there whoever the person is.
AIDS = aid_classes([path.removeprefix(f"{ROOT}.") for path in MANIFEST.persons])
#: One property of one thing of the scene, such as ``scene.car-1 x`` or ``sky rain``, and its value.
Facts = dict[str, object]
#: Returns the expected differences from the path of the thing, the value of its parameter and the scene before.
Expected = Callable[[str, Value, Facts], Facts]


def facts_of(scene: Scene) -> Facts:
    return dict(_facts(scene))


def _facts(scene: Scene) -> Iterator[tuple[str, object]]:
    for path, node in scene.nodes.items():
        for axis, value in zip("xyz", node.transform[:3, 3], strict=True):
            yield f"{path} {axis}", float(value)
        # Directions of its own axes: right, ahead (a node faces its +y), up.
        for name, direction in zip(("right", "ahead", "up"), node.transform[:3, :3].T, strict=True):
            yield f"{path} {name}", tuple(map(float, direction))
        yield f"{path} shown", node.visible
        yield f"{path} meshes", tuple(id(mesh) for mesh in node.meshes)
        yield f"{path} light", node.light
        if node.figure is not None:
            for field, held in asdict(node.figure.stance).items():
                yield f"{path} {field}", held
    for name, material in scene.materials.items():
        for field, look in asdict(material).items():
            yield f"{name} {field}", look
    for camera in scene.cameras.values():
        for axis, value in zip("xyz", camera.position, strict=True):
            yield f"{camera.path} {axis}", float(value)
        yield f"{camera.path} looks along", tuple(map(float, -camera.transform[:3, 2]))
        yield f"{camera.path} slope of its right side", float(camera.transform[2, 0])
        for field in ("focal_length_mm", "sensor_width_mm", "near", "far"):
            yield f"{camera.path} {field}", getattr(camera, field)
    for field in ("azimuth", "elevation", "angular_diameter"):
        yield f"sun {field}", math.degrees(getattr(scene.sun, field))
    yield "sun irradiance", scene.sun.irradiance
    for field, weather in asdict(scene.environment).items():
        yield f"sky {field}", weather


def near(value: object, tolerance: float = 1e-9) -> object:
    return pytest.approx(value, abs=tolerance)


def trigonometry(*degrees: float) -> list[float]:
    """Return cosine and sine of each angle in turn."""
    return [function(math.radians(angle)) for angle in degrees for function in (math.cos, math.sin)]


def itself(name: str) -> Expected:
    """Expect that the property ``name`` takes the value."""
    return lambda thing, value, _: {f"{thing} {name}": near(value) if isinstance(value, float) else value}


def of(owner: str, name: str) -> Expected:
    return lambda _thing, value, _before: {f"{owner} {name}": near(value) if isinstance(value, float) else value}


def turned(thing: str, value: Value, _: Facts) -> Facts:
    """Expect a turn counter-clockwise seen from above; at 0 the thing faces +y with +x on its right."""
    cos, sin = trigonometry(float(value))
    return {f"{thing} right": near((cos, sin, 0.0)), f"{thing} ahead": near((-sin, cos, 0.0))}


def resized(thing: str, value: Value, before: Facts) -> Facts:
    """Expect each of its axes to have the length of the value, instead of 1."""
    axes = {f"{thing} {name}": before[f"{thing} {name}"] for name in ("right", "ahead", "up")}
    return {
        fact: near(tuple(float(value) * part for part in axis))
        for fact, axis in axes.items()
        if isinstance(axis, tuple)
    }


def table_value(definition: ParameterDefinition, value: Value) -> Value:
    """Return the value of a row; rows of houses hold offsets from the default, since each stands elsewhere."""
    if not definition.path.startswith(f"{ROOT}.building-"):
        return value
    return float(definition.check(definition.default)) + float(value)


def below(thing: str, name: str, before: Facts) -> list[str]:
    """Return the paths directly below a thing that have a property ``name``."""
    paths = [fact.removesuffix(f" {name}") for fact in before if fact.endswith(f" {name}")]
    return [path for path in paths if path.rpartition(".")[0] == thing]


def another_character(thing: str, value: Value, before: Facts) -> Facts:
    seen = [path for path in below(thing, "shown", before) if before[f"{path} shown"]]
    if value == "absent":
        return {f"{path} shown": False for path in (thing, *seen)}
    hidden = {f"{path} shown": False for path in seen if path not in AIDS}
    changed: Facts = {**hidden, f"{thing}.{value} shown": True}
    if not before[f"{thing} shown"]:
        changed |= {f"{path} shown": True for path in (thing, *AIDS) if path == thing or path.startswith(f"{thing}.")}
        # An absent person's clothes have no parameters; now they read 0.8.
        start = f"{thing.removeprefix('scene.')}/"
        rough = [
            fact for fact in before if fact.startswith(start) and "/cloth-" in fact and fact.endswith(" roughness")
        ]
        changed |= {fact: 0.8 for fact in rough if before[fact] != 0.8}
    return changed


def another_face(thing: str, value: Value, before: Facts) -> Facts:
    (seen,) = (path for path in below(thing, "shown", before) if before[f"{path} shown"])
    hidden = {f"{seen} shown": False}
    return hidden | {f"{thing} shown": False} if value == "absent" else hidden | {f"{thing}.{value} shown": True}


def held(name: str, *, already: str = "") -> Expected:
    """Expect another stance of every character of the person, and another shape of all but the one ``already`` so."""

    def expected(thing: str, value: Value, before: Facts) -> Facts:
        holders = below(thing, name, before)
        characters = [path for path in holders if path not in AIDS]
        assert len(characters) == len(CHARACTERS)
        reshaped = [path for path in characters if path != f"{thing}.{already}"]
        return {f"{path} {name}": value for path in holders} | {f"{path} meshes": ANY for path in reshaped}

    return expected


def worn(name: str) -> Expected:
    """Expect the change on all clothes of the person, as any character, and on no skin, hair, shoe or bag."""

    def expected(thing: str, value: Value, before: Facts) -> Facts:
        start = f"{thing.removeprefix('scene.')}/"
        clothes = [
            fact for fact in before if fact.startswith(start) and "/cloth-" in fact and fact.endswith(f" {name}")
        ]
        assert len(clothes) >= 2 * len(CHARACTERS)  # one part for the legs and one for the body of each
        return {fact: near(value) for fact in clothes}

    return expected


def painted_yellow(thing: str, _: Value, before: Facts) -> Facts:
    start = f"{thing.removeprefix('scene.')}/paint-"
    paints = {fact.rpartition(" ")[0] for fact in before if fact.startswith(start)}
    assert paints
    # The paint is a yellow without metal, under lacquer.
    look = {"base_color": near((0.62, 0.42, 0.02)), "metallic": 0.0, "roughness": near(0.2)}
    return {f"{paint} {field}": value for paint in paints for field, value in look.items()}


def appears(which: str) -> Expected:
    """Expect the hidden thing to appear, with all nodes below its child ``which`` (or with all nodes)."""

    def expected(thing: str, _: Value, before: Facts) -> Facts:
        inside = f"{thing}.{which}" if which else thing
        paths = [fact for fact in before if fact.endswith(" shown") and fact.startswith((f"{inside}.", f"{inside} "))]
        assert len(paths) > 4
        return dict.fromkeys([f"{thing} shown", *paths], True)

    return expected


#: Yaw, pitch and roll in degrees.
VIEWS = {"scene.camera-1": (0.0, 0.0, 0.0), "scene.camera-2": (358.0, 0.0, 0.0), "scene.camera-3": (2.5, -1.0, 0.0)}


def looking(which: int) -> Expected:
    """Expect a camera along +y at yaw 0 and to the left above 0; pitch turns it up, roll lowers its right side."""

    def expected(thing: str, value: Value, before: Facts) -> Facts:
        angles = list(VIEWS[thing])
        angles[which] = float(value)
        cos_yaw, sin_yaw, cos_pitch, sin_pitch, _, sin_roll = trigonometry(*angles)
        if which == 2:
            return {f"{thing} slope of its right side": near(-sin_roll * cos_pitch)}
        return {f"{thing} looks along": near((-sin_yaw * cos_pitch, cos_yaw * cos_pitch, sin_pitch))}

    return expected


def sun_at(azimuth: float, elevation: float) -> Expected:
    """Expect a sun by hand: cos H = cos(15° · hours from noon), with the day's equation of time and declination."""
    return lambda *_: {"sun azimuth": near(azimuth, 1.0), "sun elevation": near(elevation, 0.5)}


def rows_of(vehicle: str) -> dict[str, list[tuple[Value, Expected]]]:
    """Return the rows of a vehicle in traffic that has a single kind."""
    return {
        f"{vehicle} visible": [(True, appears(""))],
        f"{vehicle} pos.x": [(1.0, itself("x"))],
        f"{vehicle} pos.y": [(35.0, itself("y"))],
        f"{vehicle} heading": [(70.0, turned)],
        f"{vehicle} colour": [("yellow", painted_yellow)],
    }


#: Class of the thing and attribute to values, with the change that each makes.
TABLE: dict[str, list[tuple[Value, Expected]]] = {
    "person pos.x": [
        (1.0, itself("x")),
        (-2.0, lambda thing, *_: {f"{thing} x": -2.0, f"{thing} z": 0.12}),
    ],  # on the kerb
    "person pos.y": [(33.0, itself("y"))],
    "person heading": [(70.0, turned)],
    "person character": [("blue-dress", another_character), ("absent", another_character)],
    "person pose": [("waving", held("pose")), ("standing", held("pose")), ("phone", held("pose"))],
    "person gait_phase": [(0.25, held("gait_phase"))],
    "person carries": [("shopping-bag", held("carries", already="green-parka"))],  # who has one of her own
    "person cloth.metallic": [(0.35, worn("metallic"))],
    "person cloth.roughness": [(0.35, worn("roughness"))],
    "person cloth.specular_tint": [(0.35, worn("specular_tint"))],
    "car kind": [("estate", appears("estate")), ("van", appears("van"))],
    "car pos.x": [(1.0, itself("x"))],
    "car pos.y": [(33.0, itself("y"))],
    "car heading": [(70.0, turned)],
    "car colour": [("yellow", painted_yellow)],
    "car door-2.rot.z": [(50.0, turned)],
    **rows_of("bicycle"),
    **rows_of("motorcycle"),
    "truck kind": [("flatbed-truck", appears("flatbed-truck"))],
    **rows_of("truck"),
    **rows_of("bus"),
    "building pos.x": [(0.75, itself("x"))],
    "building pos.y": [(-1.5, itself("y"))],
    "building rot.z": [(4.0, turned)],
    "building scale": [(-0.125, resized)],
    "traffic-sign face": [("stop", another_face), ("absent", another_face)],
    "sun azimuth": [(250.0, of("sun", "azimuth"))],
    "sun elevation": [(12.0, of("sun", "elevation")), (-8.0, of("sun", "elevation"))],
    "sun irradiance": [(0.5, of("sun", "irradiance"))],
    "sun time_of_day": [(9.0, sun_at(121.0, 23.4))],
    "sun day_of_year": [(172, sun_at(169.0, 63.1))],
    "sun latitude": [(20.0, sun_at(160.6, 68.9))],
    "sun longitude": [(25.0, sun_at(190.6, 39.5))],
    "sun utc_offset": [(3.0, sun_at(135.6, 30.9))],
    "environment turbidity": [(6.0, of("sky", "turbidity"))],
    "environment cloud_cover": [(0.5, of("sky", "cloud_cover"))],
    "environment visibility": [(300.0, of("sky", "visibility"))],
    "environment rain": [(8.0, of("sky", "rain"))],
    "environment street_lamps": [("on", of("sky", "street_lamps")), ("off", of("sky", "street_lamps"))],
    "environment car_lamps": [("on", of("sky", "car_lamps")), ("off", of("sky", "car_lamps"))],
    "camera pos.x": [(1.0, itself("x"))],
    "camera pos.y": [(33.0, itself("y"))],
    "camera pos.z": [(3.0, itself("z"))],
    "camera yaw": [(70.0, looking(0))],
    "camera pitch": [(-20.0, looking(1))],
    "camera roll": [(30.0, looking(2))],
    "camera focal_length_mm": [(35.0, itself("focal_length_mm"))],
}


def row_of(path: str) -> tuple[str, str]:
    """Return the thing that a parameter belongs to, and its row in the table."""
    _, thing, attribute = path.split(".", 2)
    return f"{ROOT}.{thing}", f"{thing.rpartition('-')[0]} {attribute}"


@pytest.mark.parametrize(
    "definition", [d for d in MANIFEST.parameters if d.path.startswith(f"{ROOT}.")], ids=lambda d: d.path
)
def test_a_parameter_changes_what_it_names_and_nothing_else(asset: SceneAsset, definition: ParameterDefinition) -> None:
    thing, row = row_of(definition.path)
    if ".door-" in definition.path:
        thing = definition.path.removesuffix(".rot.z")
    others = {path: value for path, value in EVERYTHING_SHOWN.items() if path != definition.path}
    scene = apply(others, asset)
    before = facts_of(scene)
    rows = [(table_value(definition, value), expected) for value, expected in TABLE[row]]
    others_than_default = [(value, expected) for value, expected in rows if value != definition.default]
    assert others_than_default
    for value, expected in others_than_default:
        changed = apply({**others, definition.path: value}, asset)
        after = facts_of(changed)
        assert after.keys() == before.keys()
        different = {fact: content for fact, content in after.items() if content != before[fact]}
        assert different == expected(thing, value, before)


def test_every_row_of_the_table_is_of_a_parameter() -> None:
    assert {row_of(d.path)[1] for d in MANIFEST.parameters if d.path.startswith(f"{ROOT}.")} == TABLE.keys()


#: The weather of single seasons, with its attribute of the operational design domain.
SEASONAL = {
    "snowfall": OddAttribute.SNOWFALL,
    "snow_depth": OddAttribute.DRIVABLE_AREA_SURFACE,
    "leaf_litter": OddAttribute.DRIVABLE_AREA_SURFACE,
}


@pytest.mark.parametrize(
    ("season", "expected"),
    [
        ("summer", set()),
        ("spring", {"snowfall", "snow_depth"}),
        ("autumn", set(SEASONAL)),
        ("winter", set(SEASONAL)),
    ],
)
def test_a_street_declares_the_weather_of_its_season(season: str, expected: set[str]) -> None:
    manifest = asset_manifest({"name": "urban-street", "season": season})[0]
    more = {d.path: d for d in manifest.parameters if d.path not in MANIFEST.by_path}
    assert set(more) == {f"scene.environment-1.{name}" for name in expected}
    for path, definition in more.items():
        assert (definition.default, definition.minimum) == (0.0, 0.0)
        assert definition.odd == SEASONAL[path.rpartition(".")[2]]


def test_weather_of_a_season_changes_the_environment_alone() -> None:
    winter = load_asset({"name": "urban-street", "season": "winter"})
    values = {"snowfall": 2.0, "snow_depth": 0.05, "leaf_litter": 0.3}
    clear = apply({}, winter)
    scene = apply({f"scene.environment-1.{name}": value for name, value in values.items()}, winter)
    assert scene.environment == replace(clear.environment, **values)
    assert dict(scene.nodes) == dict(clear.nodes)


def test_every_parameter_of_the_sensor_is_declared() -> None:
    declared = {d.path.removeprefix("sensor."): d for d in MANIFEST.parameters if d.path.startswith("sensor.")}
    assert set(declared) == set(SENSOR_PARAMETERS)
    for name, row in SENSOR_PARAMETERS.items():
        assert (declared[name].type, declared[name].unit, declared[name].default) == (row.type, row.unit, row.neutral)
