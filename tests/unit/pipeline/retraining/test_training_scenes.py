import math
from dataclasses import replace

import numpy as np
import pytest
import shapely

from valerie.errors import InvalidInput
from valerie.pipeline.retraining.crowds import crowd_asset
from valerie.pipeline.retraining.training_scenes import TrainingScene, draw_scene
from valerie.scene.assets.asset import SceneAsset
from valerie.scene.assets.manifest import Manifest
from valerie.scene.graph.model import Scene, Texture
from valerie.scene.legality.ground import ground_height
from valerie.sensing.settings import SensorSetting
from valerie.testing.assets import simple_asset

PERSONS = tuple(f"scene.person-{n}" for n in range(1, 6))


@pytest.fixture(scope="module")
def crowd() -> SceneAsset:
    return crowd_asset(simple_asset())


@pytest.fixture(scope="module")
def drawn(crowd: SceneAsset) -> list[TrainingScene]:
    return [draw_scene(crowd, np.random.default_rng(seed)) for seed in range(150)]


def shown(scene: Scene) -> list[str]:
    return [path for path in PERSONS if scene.nodes[path].visible]


def materials_of(scene: Scene, person: str) -> set[str]:
    return {mesh.material for path, node in scene.nodes.items() if path.startswith(person) for mesh in node.meshes}


def test_a_copied_person_has_all_parts_its_own_instance_and_its_own_materials(crowd: SceneAsset) -> None:
    nodes = crowd.base.nodes
    assert {"scene.person-3", "scene.person-3.red-coat", "scene.person-3.blue-coat"} <= set(nodes)
    assert {node.instance_id for path, node in nodes.items() if path.startswith("scene.person-3")} == {24003}
    assert all(node.movable for path, node in nodes.items() if path.startswith("scene.person-3"))
    assert materials_of(crowd.base, "scene.person-3").isdisjoint(materials_of(crowd.base, "scene.person-1") - {"skin"})


def test_a_copied_person_varies_like_the_first(crowd: SceneAsset) -> None:
    by_path = crowd.manifest.by_path
    for path in by_path:
        if path.startswith("scene.person-1."):
            assert path.replace("person-1", "person-3") in by_path
    assert crowd.manifest.persons == crowd.manifest.movable == crowd.manifest.grounded == PERSONS


def test_the_asset_itself_stays_as_it_was(crowd: SceneAsset) -> None:
    assert "scene.person-3" not in simple_asset().base.nodes
    assert crowd.digest != simple_asset().digest


def test_an_asset_without_persons_is_refused() -> None:
    asset = simple_asset()
    fields = {name: getattr(asset.manifest, name) for name in Manifest.model_fields}
    empty = Manifest.model_validate(fields | {"persons": (), "parameters": ()})
    with pytest.raises(InvalidInput, match="no person"):
        crowd_asset(replace(asset, manifest=empty))


def test_frames_show_from_nobody_to_five(drawn: list[TrainingScene]) -> None:
    counts = np.bincount([len(shown(frame.scene)) for frame in drawn], minlength=6)
    assert (counts >= 5).all()


def test_everybody_stands_on_the_ground_outside_obstacles(drawn: list[TrainingScene], crowd: SceneAsset) -> None:
    obstacles = [shapely.Polygon(footprint.polygon) for footprint in crowd.manifest.obstacles]
    for frame in drawn:
        for path in shown(frame.scene):
            x, y, z = frame.scene.nodes[path].transform[:3, 3]
            assert z == ground_height(crowd.manifest, x, y)
            assert not any(polygon.contains(shapely.Point(x, y)) for polygon in obstacles)


def test_most_people_are_in_view(drawn: list[TrainingScene]) -> None:
    within_view = []
    for frame in drawn:
        camera = frame.scene.cameras[frame.camera]
        for path in shown(frame.scene):
            at = np.linalg.inv(camera.transform) @ frame.scene.nodes[path].transform[:, 3]
            half = math.atan(0.5 * camera.sensor_width_mm / camera.focal_length_mm)
            within_view.append(at[2] < 0 and abs(math.atan2(at[0], -at[2])) < half)
    assert 0.6 < np.mean(within_view) < 1.0


def test_no_camera_stands_in_an_obstacle(drawn: list[TrainingScene], crowd: SceneAsset) -> None:
    building = shapely.Polygon(crowd.manifest.obstacles[0].polygon)
    for frame in drawn:
        assert not building.contains(shapely.Point(*frame.scene.cameras[frame.camera].position[:2]))


def test_clothes_come_in_many_colours_and_other_things_keep_theirs(drawn: list[TrainingScene]) -> None:
    coats = {frame.scene.materials["person-1/cloth-red-coat"].base_color for frame in drawn}
    assert len(coats) > 100
    assert np.std([color[0] for color in coats]) > 0.1
    assert {frame.scene.materials["paint"].base_color for frame in drawn} == {(0.1, 0.2, 0.5)}


def test_colours_are_valid_reflectances(drawn: list[TrainingScene]) -> None:
    for frame in drawn:
        for material in frame.scene.materials.values():
            assert all(0.0 <= channel <= 1.0 for channel in material.base_color)


def test_light_and_sensor_vary(drawn: list[TrainingScene]) -> None:
    assert len({frame.scene.sun.azimuth for frame in drawn}) > 100
    assert {frame.sensor.curve for frame in drawn} == {"srgb", "filmic", "aces"}
    assert len({frame.sensor.exposure_ev for frame in drawn}) > 50


def test_half_of_the_frames_are_what_a_run_shows_that_varies_people_and_sun(
    drawn: list[TrainingScene], crowd: SceneAsset
) -> None:
    plain = [frame for frame in drawn if frame.sensor == SensorSetting()]
    # Four standard deviations of a binomial share.
    assert abs(len(plain) / len(drawn) - 0.5) < 4 * math.sqrt(0.25 / len(drawn))
    weather = crowd.base.environment
    for frame in plain:
        assert replace(frame.scene.environment, turbidity=weather.turbidity) == weather
        assert frame.scene.sun_direction()[2] > 0
        moved = frame.scene.cameras[frame.camera].position - crowd.base.cameras[frame.camera].position
        assert (np.abs(moved) <= (0.7, 2.0, 0.8)).all()


def test_scenes_of_equal_settings_differ_in_what_moves(crowd: SceneAsset) -> None:
    for seed in range(8):
        one, other = (
            draw_scene(crowd, np.random.default_rng(number), setting=np.random.default_rng(seed)) for number in (1, 2)
        )
        assert one.scene.environment == other.scene.environment
        assert one.scene.sun == other.scene.sun
        assert one.camera == other.camera
        np.testing.assert_array_equal(
            one.scene.cameras[one.camera].transform, other.scene.cameras[other.camera].transform
        )
        still = [path for path, node in one.scene.nodes.items() if not node.movable]
        assert all(one.scene.nodes[path] is other.scene.nodes[path] for path in still)
        assert one.scene.materials != other.scene.materials


def test_equal_generators_draw_equal_scenes(crowd: SceneAsset) -> None:
    one, other = (draw_scene(crowd, np.random.default_rng(5)) for _ in range(2))
    assert one.sensor == other.sensor
    assert one.scene.sun == other.scene.sun
    assert one.scene.materials == other.scene.materials
    for path, node in one.scene.nodes.items():
        np.testing.assert_array_equal(node.transform, other.scene.nodes[path].transform)
    camera = one.scene.cameras[one.camera]
    np.testing.assert_array_equal(camera.transform, other.scene.cameras[other.camera].transform)


def test_a_dyed_texture_gets_a_grey_twin_that_keeps_the_weave() -> None:
    asset = simple_asset()
    weave = np.zeros((4, 4, 3), np.uint8)
    weave[..., 0], weave[..., 1] = 120, 100
    weave[::2] //= 2
    name = "person-1/cloth-red-coat"
    scene = replace(
        asset.base,
        textures={**asset.base.textures, "yellow": Texture("yellow", weave)},
        materials={**asset.base.materials, name: replace(asset.base.materials[name], base_color_texture="yellow")},
    )
    crowd = crowd_asset(replace(asset, base=scene))
    grey = crowd.base.textures["neutral/yellow"].image
    assert (grey[..., 0] == grey[..., 1]).all()
    assert (grey[..., 0] == grey[..., 2]).all()
    assert grey[1, 0, 0] > 1.5 * grey[0, 0, 0]
    used = {
        draw_scene(crowd, np.random.default_rng(seed)).scene.materials[name].base_color_texture for seed in range(30)
    }
    assert used == {"yellow", "neutral/yellow"}


def test_a_character_that_the_asset_leaves_out_of_training_changes_no_draw(crowd: SceneAsset) -> None:
    """A street may show one body in two outfits; training would else see that body twice as often."""
    asset = simple_asset()
    manifest, scene = asset.manifest, asset.base
    extra = "scene.person-1.extra"
    shown = next(node for node in scene.nodes.values() if node.parent == "scene.person-1")
    parameters = tuple(
        definition.model_copy(update={"choices": ("extra", *definition.choices)})
        if definition.path == "scene.person-1.character"
        else definition
        for definition in manifest.parameters
    )
    training = manifest.training.model_copy(update={"left_out": (extra,)})
    more = SceneAsset(
        Manifest.model_validate(
            {name: getattr(manifest, name) for name in Manifest.model_fields}
            | {"parameters": parameters, "training": training}
        ),
        asset.digest,
        replace(scene, nodes={**scene.nodes, extra: replace(shown, path=extra, visible=False)}),
    )
    larger = crowd_asset(more)
    for seed in range(10):
        without, drawn = (draw_scene(each, np.random.default_rng(seed)).scene for each in (crowd, larger))
        assert drawn.materials == without.materials
        assert drawn.sun == without.sun
        placed = [{p: (n.visible, n.transform.tobytes()) for p, n in s.nodes.items()} for s in (without, drawn)]
        assert placed[0] == placed[1]
