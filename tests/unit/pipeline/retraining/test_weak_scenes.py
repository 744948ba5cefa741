import math

import numpy as np
import pytest

from valerie.analysis.findings.region import Arc, Bound, Choices, Range, Region
from valerie.errors import InvalidInput
from valerie.pipeline.retraining.crowds import crowd_asset
from valerie.pipeline.retraining.training_frames import FrameSettings, SceneCount, frames_of
from valerie.pipeline.retraining.training_scenes import REVISION, draw_scene
from valerie.pipeline.retraining.weak_scenes import TargetRegion
from valerie.rendering.base import View
from valerie.rendering.visibility import measure
from valerie.testing.assets import simple_asset


def region(**bounds: Bound) -> Region:
    return Region(bounds={name.replace("__", "."): bound for name, bound in bounds.items()})


def test_what_is_known_before_drawing_is_read_from_the_scene_itself() -> None:
    crowd = crowd_asset(simple_asset())
    drawn = [draw_scene(crowd, np.random.default_rng(seed)) for seed in range(60)]
    low_sun = TargetRegion(Region(bounds={"scene.sun-1.elevation": Range(low=0, high=30)}))
    near = TargetRegion(region(distance_m=Range(low=0, high=12)))
    agreed = 0
    for one in drawn:
        camera = one.scene.cameras[one.camera].position
        persons = [n for n in one.scene.nodes.values() if n.path in crowd.manifest.persons and n.visible]
        distances = [float(np.linalg.norm(node.transform[:3, 3] - camera)) for node in persons]
        assert near.possible(one) == any(d <= 12 for d in distances)
        if persons:
            assert low_sun.possible(one) == (math.degrees(one.scene.sun.elevation) <= 30)
            agreed += 1
    assert agreed > 20


def test_a_scene_without_persons_is_in_no_region() -> None:
    crowd = crowd_asset(simple_asset())
    empty = next(
        one
        for seed in range(100)
        if not any(
            (one := draw_scene(crowd, np.random.default_rng(seed))).scene.nodes[path].visible
            for path in crowd.manifest.persons
        )
    )
    assert not TargetRegion(Region()).possible(empty)


def test_one_person_must_meet_all_bounds_of_persons() -> None:
    crowd = crowd_asset(simple_asset())
    look = crowd.manifest.definition("scene.person-1.character").choices[0]
    bounds: dict[str, Bound] = {"heading": Arc(start=0, width=60), "character": Choices(names=(look,))}
    target = TargetRegion(Region(bounds=bounds))
    assert target.as_made == 0.5
    drawn = [draw_scene(crowd, np.random.default_rng(seed)) for seed in range(150)]
    hits = sum(target.possible(scene) for scene in drawn)
    apart = [TargetRegion(Region(bounds={name: bound})) for name, bound in bounds.items()]
    assert 0 < hits < sum(all(part.possible(scene) for part in apart) for scene in drawn)


def test_broad_frames_are_spread_evenly_and_none_are_targeted_without_a_region() -> None:
    some = region(distance_m=Range(low=1, high=2))
    for share, expected in ((0.0, 12), (0.5, 6), (0.25, 9)):
        settings = FrameSettings(region=some, broad_share=share)
        assert sum(settings.is_targeted(number) for number in range(12)) == expected
    assert not FrameSettings().is_targeted(0)


def test_seeds_may_begin_later_but_not_in_another_split() -> None:
    assert list(FrameSettings(sites=2, first_seed=5000).seeds()) == [5000, 5001]
    with pytest.raises(InvalidInput, match="first_seed"):
        FrameSettings(sites=2, first_seed=950).seeds()


@pytest.mark.gl
def test_frames_show_someone_in_the_region_as_a_run_would_measure_it() -> None:
    from valerie.rendering.ground_truth import TruthPass

    asset = simple_asset()
    bounds = region(distance_m=Range(low=4, high=14), occlusion_rate=Range(low=0.0, high=0.3))
    settings = FrameSettings(per_site=3, width=96, height=54, region=bounds)
    draws = SceneCount()
    frames = list(frames_of(asset, 1000, settings, draws))
    assert len(frames) == 3
    assert draws.count >= 3
    # The oracle: which draws lie in the region, by measuring them all.
    crowd, view_size = crowd_asset(asset), (96, 54)
    truth_pass, target, hits = TruthPass(), TargetRegion(bounds), 0
    for attempt in range(20):
        drawn = draw_scene(crowd, np.random.default_rng([REVISION, 1000, 0, attempt]))
        view = View(drawn.camera, *view_size)
        truth = truth_pass.truth(drawn.scene, view)
        inside = any(
            one.undefined_reason is None
            and one.distance_m is not None
            and 4 <= one.distance_m <= 14
            and one.occlusion_rate is not None
            and one.occlusion_rate <= 0.3
            for one in measure(truth, drawn.scene, view)
        )
        assert target.hit(drawn, truth, view) == inside
        assert not inside or target.possible(drawn)
        hits += inside
    assert 0 < hits < 20
    truth_pass.close()


@pytest.mark.gl
def test_a_region_that_no_scene_shows_is_told() -> None:
    settings = FrameSettings(per_site=1, width=96, height=54, region=region(distance_m=Range(low=500, high=600)))
    with pytest.raises(InvalidInput, match=r"site 1000 .*distance_m 500 … 600"):
        next(frames_of(simple_asset(), 1000, settings, most_draws=30))
