"""Time in specs: sequences and trajectories, in both notations, against assignments that were worked out by hand."""

from typing import Any

import pytest

from tests.world.boxes import traffic
from valerie.errors import InvalidInputs
from valerie.runs.forecasting.forecast import plan
from valerie.runs.products.inputs import ProductInputs
from valerie.runs.products.pins import Pins
from valerie.runs.resolving.spec import ResolvedRun, parse, resolve
from valerie.scene.assets.manifest import Manifest
from valerie.scene.motion.trajectory import TIME_PATH, Trajectory

WALK = {"person-1": [["0 s", -2, 20], ["2 s", "200 cm", 20]]}


def run(street: Manifest, **more: Any) -> ResolvedRun:
    return resolve(parse({"name": "moving", "asset": "urban-street", "cameras": ["camera-1"], **more}), street)


def test_frames_follow_each_other_and_each_has_its_own_assignment(street: Manifest) -> None:
    resolved = run(street, sequence={"frames": 5, "step": "500 ms"}, trajectories=WALK)
    assert resolved.times.elapsed == (0.0, 0.5, 1.0, 1.5, 2.0)
    xs = [resolved.at({}, index)["scene.person-1.pos.x"] for index in range(5)]
    assert xs == pytest.approx([-2, -1, 0, 1, 2])
    assert resolved.at({"scene.sun-1.elevation": 20.0}, 3)["scene.sun-1.elevation"] == 20.0


def test_the_notations_mean_the_same(street: Manifest) -> None:
    keys = [{"time": 0, "pos.x": "-2 m", "pos.y": 20}, {"time": "2000 ms", "pos.x": 2.0, "pos.y": "20 m"}]
    trajectories: list[dict[str, Any]] = [
        {"sequence": [3, "100 ms", "1 s"], "trajectories": WALK},
        {"sequence": {"frames": 3, "step": 0.1, "start": 1}, "trajectories": {"person-1": {"keyframes": keys}}},
        {"sequence": [3, 0.1, 1], "trajectories": [["scene.person-1", [0, -2, 20], [2, 2, 20]]]},
        {"sequence": [3, 0.1, 1], "trajectories": [{"path": "person-1", "keyframes": keys}]},
    ]
    states = [[run(street, **trajectory).at({}, index) for index in range(3)] for trajectory in trajectories]
    assert all(state == states[0] for state in states)


def test_a_spec_without_time_keeps_its_assignments(street: Manifest) -> None:
    plain = parse({"name": "moving", "asset": "urban-street"})
    assert "sequence" not in plain.to_yaml()
    assignment = {"scene.person-1.pos.x": 3.0}
    resolved = resolve(plain, street)
    assert resolved.at(assignment, 0) is assignment
    assert resolved.seconds(assignment, 0) == 0.0
    assert parse({"name": "moving", "asset": "urban-street", "sequence": [2, 1]}).digest != plain.digest


def test_the_spec_survives_its_own_yaml() -> None:
    spec = parse({"name": "moving", "asset": "urban-street", "sequence": [2, "1 s"], "trajectories": WALK})
    assert parse(spec.to_yaml()) == spec


def test_keyframes_and_time_are_varied_like_any_parameter(street: Manifest) -> None:
    vary = {
        "time": {"homogeneous": {"from": "0 s", "to": "1 s", "step": "500 ms"}},
        "person-1.trajectory.key-2.pos.x": {"choice": [2, 6]},
    }
    resolved = run(street, trajectories=WALK, vary=vary)
    assert len(resolved.space) == 6
    xs = [resolved.at(point.values, 0)["scene.person-1.pos.x"] for point in resolved.space]
    assert xs == pytest.approx([-2, -2, -1, 0, 0, 2])
    assert [resolved.seconds(point.values, 0) for point in resolved.space] == [0, 0, 0.5, 0.5, 1, 1]


def test_a_constraint_may_speak_of_the_time(street: Manifest) -> None:
    vary = {"time": {"homogeneous": {"from": 0, "to": 2, "step": 1}}}
    resolved = run(street, trajectories=WALK, vary=vary, constraints=["time < 1.5"])
    assert [resolved.rejection(point.values) is None for point in resolved.space] == [True, True, False]


def test_the_asset_s_own_trajectories_move_where_time_is_asked_for(street: Manifest) -> None:
    own = Trajectory(path="scene.person-1", keyframes=({"time": 0, "pos.x": 0.0}, {"time": 1, "pos.x": 4.0}))
    manifest = street.model_copy(update={"trajectories": (own,)})
    assert run(manifest).times.motion is None
    assert run(manifest, sequence=[2, "500 ms"]).at({}, 1)["scene.person-1.pos.x"] == pytest.approx(2.0)
    assert run(manifest, constants={"time": 0.25}).at({TIME_PATH: 0.25}, 0)["scene.person-1.pos.x"] == pytest.approx(1)
    other = run(manifest, sequence=[2, 1], trajectories={"person-1": [[0, 5, 20]]})
    assert other.at({}, 1)["scene.person-1.pos.x"] == 5


def test_a_variant_is_legal_only_if_every_moment_is(street: Manifest) -> None:
    through = {"person-1": [[0, 3, 50], [4, -5, 50], [8, 3, 50]]}
    ends = run(street, sequence=[2, "8 s"], trajectories=through)
    assert ends.rejection({}) is None
    every = run(street, sequence=[5, "2 s"], trajectories=through)
    assert every.rejection({}) == "person-1 stands inside building-3 at 2 s"


def test_a_car_that_meets_a_cyclist_on_its_way_is_rejected_with_the_moment() -> None:
    boxes = traffic(movable=["scene.person-1", "scene.person-2", "scene.car-1"])
    way = {"car-1": [["0 s", 0, 40], ["4 s", 0, 20]]}
    resolved = run(boxes, sequence=[5, "1 s"], trajectories=way, constants={"bicycle-1.visible": True})
    (variant,) = resolved.space
    assert resolved.rejection(variant.values) == "car-1 and bicycle-1 overlap at 2 s"
    alone = run(boxes, sequence=[5, "1 s"], trajectories=way, constants={"bicycle-1.visible": False})
    assert alone.rejection(next(iter(alone.space)).values) is None


def test_what_stands_still_is_rendered_once(street: Manifest, pins: Pins) -> None:
    resolved = run(street, sequence=[4, "500 ms"], trajectories=WALK, cameras=["camera-1", "camera-2"])
    planned = plan(resolved, pins=pins)
    assert (planned.moments, planned.frames) == (4, 8)
    needed = {product.kind.value: product.needed for product in planned.products}
    assert (needed["background"], needed["layer"], needed["truth"]) == (2, 8, 8)
    standing = plan(run(street, sequence=[4, "500 ms"], trajectories={"person-1": [[0, 5, 20]]}), pins=pins)
    needed = {product.kind.value: product.needed for product in standing.products}
    assert (standing.frames, needed["background"], needed["layer"], needed["truth"]) == (4, 1, 1, 1)


def test_a_moment_shares_its_products_with_a_run_without_time(street: Manifest, pins: Pins) -> None:
    moving = run(
        street, sequence=[2, "1 s"], trajectories={"person-1": {"keyframes": WALK["person-1"], "facing": "kept"}}
    )
    still = run(street, constants={"person-1.pos.x": 0.0, "person-1.pos.y": 20.0})
    frames = [
        ProductInputs(one, asset_digest="a", pins=pins).frame(one.at(values, index), 0)
        for one, values, index in ((moving, {}, 1), (still, dict(still.space[0].values), 0))
    ]
    assert frames[0] == frames[1]


@pytest.mark.parametrize(
    ("change", "place", "text"),
    [
        ({"sequence": [0, 1]}, "sequence.frames", "out of bounds"),
        ({"sequence": [2, "0 s"]}, "sequence.step", "out of bounds"),
        ({"sequence": [2, "1 m"]}, "sequence.step", "does not fit"),
        ({"sequence": [2]}, "sequence", "two or three numbers"),
        ({"sequence": [90000, "1 s"]}, "sequence", "ends too late"),
        ({"sequence": {"frames": 2}}, "sequence.step", "missing"),
        ({"trajectories": {"person-7": [[0, 1, 1]]}}, "trajectories.person-7.path", "node or camera that can move"),
        ({"trajectories": {"person-1": [[0, 1]]}}, "trajectories.person-1.0", "three or four numbers"),
        ({"trajectories": {"person-1": [[0, 1, 1], [0, 1, 2]]}}, "trajectories.person-1.keyframes.1.time", "in order of time"),
        ({"trajectories": {"person-1": {"keyframes": [{"time": 0, "pos.x": "1 s"}]}}},
         "trajectories.person-1.keyframes.0.pos.x", "does not fit"),
        ({"trajectories": {"person-1": {"keyframes": [{"time": 0, "pos.xx": 1}]}}},
         "trajectories.person-1.keyframes.0.pos.xx", "pos.x"),
        ({"trajectories": [["person-1", [0, 1, 1]], ["person-1", [0, 1, 1]]]}, "trajectories.1", "listed twice"),
        ({"trajectories": WALK, "vary": {"person-1.pos.x": {"choice": [1, 2]}}}, "vary.person-1.pos.x", "follows the trajectory"),
        ({"trajectories": WALK, "constraints": ["person-1.pos.x < 3"]}, "constraints.0", "person-1.pos.x"),
        ({"constants": {"time": 1}}, "constants.time", "unknown parameter"),
        ({"trajectories": WALK, "sequence": [1000, 0.1], "design": "random", "count": 2000,
          "vary": {"time": {"uniform": {"from": 0, "to": 1}}}}, "sequence.frames", "are too many"),
    ],
)  # fmt: skip
def test_what_cannot_be_is_refused_at_its_place(
    street: Manifest, change: dict[str, Any], place: str, text: str
) -> None:
    with pytest.raises(InvalidInputs) as caught:
        run(street, **change)
    assert any(problem.field == place and text in str(problem) for problem in caught.value.problems), caught.value


def test_a_sequence_in_which_nothing_moves_is_pointed_out(street: Manifest) -> None:
    assert any("nothing moves" in text for text in run(street, sequence=[2, 1]).warnings)
    assert any("only the moment 0 s" in text for text in run(street, trajectories=WALK).warnings)
