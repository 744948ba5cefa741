import itertools
from typing import Any

import numpy as np
import pytest

from tests.world.boxes import traffic
from valerie.runs.forecasting.costs import Cost, CostBasis, CostKey, CostTable
from valerie.runs.forecasting.forecast import plan
from valerie.runs.forecasting.plan import Plan
from valerie.runs.products.inputs import ProductInputs
from valerie.runs.products.pins import Pins
from valerie.runs.products.states import ProductKind
from valerie.runs.resolving.spec import ResolvedRun, parse, resolve
from valerie.scene.assets.manifest import Manifest
from valerie.scene.legality.rejection import rejection_reason

FUNCTIONS = ["deeplabv3plus-small", "semantic-fpn-small"]
PLACES = {
    "sun-1.azimuth": {"choice": [100, 200]},
    "person-1.pos.x": {"homogeneous": {"from": "-4 m", "to": "4 m", "step": "2 m"}},
    "person-1.pos.y": {"homogeneous": {"from": "30 m", "to": "50 m", "step": "20 m"}},
}


def resolved(street: Manifest, **given: Any) -> ResolvedRun:
    document = {"name": "one", "asset": "urban-street", "functions": FUNCTIONS, "infer_backgrounds": False, **given}
    return resolve(parse(document), street, asset_digest="a", max_variants=None)


def products(run: Plan) -> dict[str, tuple[int, int]]:
    return {
        f"{product.kind}{product.maker and ' '}{product.maker}": (product.needed, product.present)
        for product in run.products
    }


def every_digest(run: ResolvedRun, pins: Pins) -> dict[str, set[str]]:
    """The oracle: each product of each legal frame, one by one."""
    inputs = ProductInputs(run, asset_digest=run.asset_digest, pins=pins)
    digests: dict[str, set[str]] = {
        kind: set() for kind in ("background", "layer", "truth", "prediction", "evaluation")
    }
    for assignment, camera in itertools.product(run.space, range(len(run.cameras))):
        if rejection_reason(assignment.values, run.manifest) or run.space.violated(assignment.values):
            continue
        frame = inputs.frame(assignment.values, camera)
        digests["background"].add(frame.products.background)
        digests["layer"].add(frame.products.layer)
        digests["truth"].add(frame.products.truth)
        digests["prediction"] |= {evaluation.prediction for evaluation in frame.evaluations}
        digests["evaluation"] |= {evaluation.scores for evaluation in frame.evaluations}
    return digests


def test_a_plan_counts_the_places_that_a_car_cannot_take(pins: Pins) -> None:
    places = {"car-1.pos.x": {"choice": [0, 4.6]}, "car-1.pos.y": {"choice": [9, 20, 30]}}
    run = resolved(traffic(), vary=places, constants={"bicycle-1.visible": True})
    forecast = plan(run, pins=pins)
    assert forecast.rejected == {
        "person-1 stands inside car-1": 1,
        "car-1 leaves its level ground": 3,
        "car-1 and bicycle-1 overlap": 1,
    }
    assert forecast.accepted == 1


def test_a_plan_counts_variants_frames_and_products(street: Manifest, pins: Pins) -> None:
    run = resolved(street, vary=PLACES, constraints=["person-1.pos.x != 4"])
    forecast = plan(run, pins=pins)
    # Of 5 × 2 places, the building takes (-4, 50), (-2, 50) and (0, 50), the constraint (4, 30) and (4, 50).
    assert forecast.variants == 20
    assert forecast.rejected == {
        "person-1 stands inside building-3": 6,
        "the constraint person-1.pos.x != 4 is not met": 4,
    }
    assert (forecast.accepted, forecast.frames, forecast.evaluations) == (10, 30, 60)
    assert products(forecast) == {
        "background raster": (6, 0),
        "layer raster": (30, 0),
        "truth": (15, 0),
        "prediction deeplabv3plus-small": (30, 0),
        "prediction semantic-fpn-small": (30, 0),
        "evaluation": (60, 0),
    }
    assert (forecast.renders, forecast.inferences) == (51, 60)
    assert not forecast.estimated
    assert forecast.units == {"sun-1.azimuth": "deg", "person-1.pos.x": "m", "person-1.pos.y": "m"}


def test_the_counts_are_those_of_all_frames_one_by_one(street: Manifest, pins: Pins) -> None:
    run = resolved(street, vary=PLACES, sensors=[{"name": "a"}, {"name": "b", "gamma": 2}])
    expected = {kind: len(digests) for kind, digests in every_digest(run, pins).items()}
    counts: dict[str, int] = dict.fromkeys(expected, 0)
    for product in plan(run, pins=pins).products:
        counts[product.kind] += product.needed
    assert counts == expected


def test_what_is_there_already_is_not_made_again(street: Manifest, pins: Pins) -> None:
    run = resolved(street, vary=PLACES)
    stored = set().union(*every_digest(run, pins).values())
    again = plan(run, pins=pins, present=lambda digests: digests & stored)
    assert (again.renders, again.inferences, again.cpu_seconds, again.bytes) == (0, 0, 0, 0)
    assert all(product.needed == product.present for product in again.products)


def test_adding_a_function_only_infers(street: Manifest, pins: Pins) -> None:
    before = resolved(street, vary=PLACES, functions=FUNCTIONS[:1])
    stored = set().union(*every_digest(before, pins).values())
    more = plan(resolved(street, vary=PLACES), pins=pins, present=lambda digests: digests & stored)
    assert more.renders == 0
    assert more.inferences == products(more)["prediction semantic-fpn-small"][0]
    assert products(more)["prediction deeplabv3plus-small"][1] == more.inferences


def test_without_workers_it_is_unknown_what_is_there_already_and_the_plan_says_so(street: Manifest) -> None:
    forecast = plan(resolved(street, vary=PLACES), present=lambda digests: digests)
    assert forecast.renders > 0
    assert {product.present for product in forecast.products} == {None}
    assert all(product["present"] is None for product in forecast.model_dump(mode="json")["products"])
    assert forecast.warnings == ()
    assert "products stored already are counted, too" in forecast.notes[-1]


def test_recorded_timings_are_preferred_and_the_plan_says_which_it_took(street: Manifest, pins: Pins) -> None:
    run = resolved(street, vary=PLACES)
    shipped = plan(run, pins=pins)
    recorded = plan(
        run,
        pins=pins,
        costs=CostTable({CostKey(ProductKind.LAYER, "raster", 960, 540): Cost(2.0, 1000.0)}),
    )
    basis = {(product.kind, product.maker): product.basis for product in recorded.products}
    assert basis[ProductKind.LAYER, "raster"] is CostBasis.RECORDED
    assert basis[ProductKind.TRUTH, ""] is CostBasis.SHIPPED
    (layer,) = (product for product in recorded.products if product.kind is ProductKind.LAYER)
    assert (layer.cpu_seconds, layer.bytes) == (2.0 * layer.needed, 1000 * layer.needed)
    assert "recorded here: layer raster" in recorded.cost_basis
    assert "recorded" not in shipped.cost_basis
    assert shipped.cpu_seconds > 0


def test_an_engine_of_ones_own_is_guessed_to_be_the_dearest() -> None:
    table = CostTable()
    own, basis = table.cost(CostKey(ProductKind.BACKGROUND, "own", 960, 540))
    known = [
        table.cost(CostKey(ProductKind.BACKGROUND, name, 960, 540))[0] for name in ("raster", "pyrender", "cycles")
    ]
    assert basis is CostBasis.GUESSED
    assert own == max(known)


def test_a_plan_costs_what_the_engines_settings_ask_for(street: Manifest) -> None:
    def cpu_seconds(**settings: object) -> float:
        forecast = plan(resolved(street, vary=PLACES, renderer={"name": "cycles", **settings}))
        return sum(product.cpu_seconds for product in forecast.products if product.maker == "cycles")

    assert cpu_seconds(samples=256) == pytest.approx(4 * cpu_seconds(quality="standard"))


def test_shipped_costs_grow_with_pixels_and_are_all_positive() -> None:
    table = CostTable()
    for kind, maker in (("background", "raster"), ("layer", "raster"), ("truth", ""), ("evaluation", ""),
                        ("prediction", FUNCTIONS[0]), ("prediction", FUNCTIONS[1])):  # fmt: skip
        small, basis = table.cost(CostKey(ProductKind(kind), maker, 480, 270))
        large, _ = table.cost(CostKey(ProductKind(kind), maker, 1920, 1080))
        assert basis is CostBasis.SHIPPED
        assert 0 < small.cpu_seconds < large.cpu_seconds
        assert 0 < small.bytes < large.bytes


def test_truths_share_their_statics_wherever_a_camera_stands(street: Manifest, pins: Pins) -> None:
    def truth(**more: Any) -> Any:
        forecast = plan(
            resolved(street, vary={"person-1.pos.y": {"choice": [8, 9, 10]}, **more}, cameras=["camera-1"]), pins=pins
        )
        return next(product for product in forecast.products if product.kind is ProductKind.TRUTH)

    table = CostTable()
    each, statics = table.cost(CostKey(ProductKind.TRUTH, "", 960, 540))[0], table.statics(960, 540)
    assert truth().bytes == pytest.approx(3 * each.bytes + statics.bytes, abs=2)
    moved = truth(**{"camera-1.yaw": {"choice": [0, 5]}})
    assert moved.needed == 6
    assert moved.bytes == pytest.approx(6 * each.bytes + 2 * statics.bytes, abs=2)
    assert statics.bytes > 10 * each.bytes


def test_a_start_is_part_of_a_plan_where_no_workers_run(street: Manifest, pins: Pins) -> None:
    running, cold = plan(resolved(street), pins=pins), plan(resolved(street))
    assert running.start_cpu_seconds == 0
    assert cold.start_cpu_seconds > 10
    assert cold.cpu_seconds == pytest.approx(running.cpu_seconds + cold.start_cpu_seconds)


def test_what_few_products_cost_is_believed_only_where_the_shipped_table_is_silent() -> None:
    known, own = (CostKey(ProductKind.LAYER, name, 960, 540) for name in ("raster", "own"))
    few = {known: Cost(99.0, 9.0), own: Cost(7.0, 9.0)}
    table = CostTable({}, few)
    assert table.cost(known) == CostTable().cost(known)
    assert table.cost(own) == (Cost(7.0, 9.0), CostBasis.RECORDED)
    assert CostTable(few).cost(known) == (Cost(99.0, 9.0), CostBasis.RECORDED)


def test_the_first_and_last_variants_are_shown_by_the_names_of_the_spec(street: Manifest, pins: Pins) -> None:
    run = resolved(
        street,
        parameters=[["p1", "scene.person-1.pos.x", "FLOAT", 0, 20]],
        vary=[["p1", "HOMOGENEOUS", 0, 9, 1]],
        constants={"person-1.pos.y": 50},
    )
    forecast = plan(run, pins=pins)
    assert [one.index for one in (*forecast.first, *forecast.last)] == [0, 1, 2, 7, 8, 9]
    assert forecast.first[0].values == {"person-1.pos.y": 50.0, "p1": 0.0}
    assert forecast.first[0].rejection == "person-1 stands inside building-3"
    assert forecast.last[-1].rejection is None
    single = plan(resolved(street), pins=pins)
    assert [one.index for one in (*single.first, *single.last)] == [0]


def test_a_run_whose_variants_are_all_rejected_is_warned_of(street: Manifest, pins: Pins) -> None:
    forecast = plan(resolved(street, constants={"person-1.pos.x": -5, "person-1.pos.y": 50}), pins=pins)
    assert (forecast.accepted, forecast.frames, forecast.renders) == (0, 0, 0)
    assert "every variant is rejected" in forecast.warnings[-1]


LARGE = [
    ["sun-1.azimuth", "CHOICE", 100, 200],
    ["person-1.pos.x", "HOMOGENEOUS", -10, 19.99, 0.01],
    ["person-1.pos.y", "HOMOGENEOUS", 0, 99.9, 0.1],
]


def test_a_large_run_is_estimated_from_a_seeded_sample_and_marked_so(street: Manifest, pins: Pins) -> None:
    run = resolved(street, vary=LARGE)
    found, again = plan(run, pins=pins), plan(run, pins=pins)
    assert found == again
    assert found.estimated
    assert found.sample == 2000
    assert found.variants == 2 * 3000 * 1000
    # The building covers 10 of 30 m across and 20 of 100 m along, and a margin around it.
    share = found.rejected["person-1 stands inside building-3"] / found.variants
    assert share == pytest.approx(1 / 15, rel=0.25)
    assert found.accepted + sum(found.rejected.values()) == found.variants
    needed = products(found)
    assert needed["background raster"][0] == 6
    assert needed["layer raster"][0] == pytest.approx(found.frames, rel=0.05)
    assert any("estimated from a sample of 2,000" in warning for warning in found.warnings)


def test_reuse_is_estimated_from_the_sample_as_well(street: Manifest, pins: Pins) -> None:
    def half(digests: set[str]) -> set[str]:
        return {digest for digest in digests if digest[0] in "01234567"}

    forecast = plan(resolved(street, vary=LARGE), pins=pins, present=half)
    needed, present = products(forecast)["layer raster"]
    assert present / needed == pytest.approx(0.5, abs=0.03)


def test_estimated_products_that_repeat_are_not_counted_in_proportion(street: Manifest, pins: Pins) -> None:
    # A place, seen under a thousand suns: one truth for each camera and place, however large the space.
    run = resolved(
        street,
        vary=[
            ["person-1.pos.x", "HOMOGENEOUS", 1, 19, 1],
            ["sun-1.azimuth", "HOMOGENEOUS", 0, 359.9, 0.1],
            ["sun-1.elevation", "HOMOGENEOUS", 10, 40, 1],
        ],
    )
    forecast = plan(run, pins=pins)
    assert forecast.estimated
    assert products(forecast)["truth"][0] == pytest.approx(19 * 3, abs=2)


def test_the_estimate_of_distinct_products_is_near_the_truth(street: Manifest, pins: Pins) -> None:
    """Half-way between all different and all seen: 3 × 1000 truths, each seen about twice in the sample."""
    run = resolved(
        street,
        vary=[
            ["person-1.pos.x", "HOMOGENEOUS", 1, 19, 0.018],
            ["sun-1.azimuth", "HOMOGENEOUS", 0, 359, 1],
        ],
    )
    assert products(plan(run, pins=pins))["truth"][0] == pytest.approx(3 * 1001, rel=0.15)


@pytest.mark.parametrize("frames", [2_000, 100_000])
def test_of_a_long_sequence_few_moments_are_examined(
    street: Manifest, pins: Pins, monkeypatch: pytest.MonkeyPatch, frames: int
) -> None:
    looked_at: list[object] = []

    def looked(assignment: Any, manifest: Manifest) -> str | None:
        looked_at.append(assignment)
        return rejection_reason(assignment, manifest)

    def crossing(count: int) -> ResolvedRun:
        # One of the two starts leads through a building.
        way = [[0, 12, 40], [100, 18, 40]]
        return resolved(
            street, sequence={"frames": count, "step": f"{100_000 / count:g} ms"}, trajectories={"person-1": way},
            vary=[["person-1.trajectory.start", "HOMOGENEOUS", 0, 0.004, 0.001]],
        )  # fmt: skip

    exact = plan(crossing(100), pins=pins)
    monkeypatch.setattr("valerie.runs.resolving.resolution.rejection_reason", looked)
    found = plan(crossing(frames), pins=pins)
    assert found.estimated
    assert not exact.estimated
    assert len(looked_at) < 2_000
    assert found.accepted == exact.accepted
    assert found.frames == found.accepted * frames * len(found.cameras)
    assert any(f"{frames:,} moments of 5 variants" in warning for warning in found.warnings)
    needed, before = products(found), products(exact)
    assert needed["background raster"] == before["background raster"]
    assert needed["layer raster"][0] == pytest.approx(before["layer raster"][0] * frames / 100, rel=0.05)


def test_a_billion_variants_are_planned_without_being_listed(street: Manifest, pins: Pins) -> None:
    run = resolved(
        street,
        vary=[["person-1.pos.x", "HOMOGENEOUS", 0, 19.9999, 0.0001], ["person-1.pos.y", "HOMOGENEOUS", 0, 99.99, 0.01]],
    )
    forecast = plan(run, pins=pins)
    assert forecast.variants == 2 * 10**9
    assert forecast.last[-1].index == 2 * 10**9 - 1


def test_digests_that_end_in_zero_bytes_are_asked_for_whole(street: Manifest, pins: Pins) -> None:
    digests_asked: set[str] = set()

    def remember(digests: set[str]) -> set[str]:
        digests_asked.update(digests)
        return set()

    run = resolved(street, vary=[["person-1.pos.x", "HOMOGENEOUS", 1, 19, 0.02]], cameras=["camera-1"])
    plan(run, pins=pins, present=remember)
    expected = set().union(*every_digest(run, pins).values())
    assert digests_asked == expected
    assert np.any([digest.endswith("00") for digest in expected]), "the case must occur"


def test_a_plan_survives_json(street: Manifest, pins: Pins) -> None:
    forecast = plan(resolved(street, vary=PLACES), pins=pins)
    assert Plan.model_validate_json(forecast.model_dump_json()) == forecast
    assert {"variants", "frames", "renders", "cpu_seconds", "bytes", "warnings"} <= set(forecast.model_dump())
