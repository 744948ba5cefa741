"""The map between values and the unit cube, both ways."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.stats import truncnorm

from valerie.errors import InvalidInput, UnknownName
from valerie.guided.domain import Axis, Domain
from valerie.parameters.blocks import Variation
from valerie.parameters.definitions import ParameterDefinition
from valerie.parameters.distributions import Choice, Distribution, Gaussian, Homogeneous, Uniform


def define(name: str, **arguments: Any) -> ParameterDefinition:
    return ParameterDefinition.model_validate(
        {"path": f"scene.{name}", "type": "FLOAT", "default": 0, "affects": "geometry", **arguments}
    )


DEFINITIONS = (
    define("x", minimum=-10, maximum=10),
    define("distance", minimum=0, maximum=100),
    define("far", minimum=60, maximum=100, default=60),
    define("heading", type="ANGLE"),
    define("turn", type="ANGLE"),
    define("people", type="INT", minimum=0, maximum=6),
    define("lamps", type="INT", minimum=0, maximum=6),
    define("lane", minimum=0, maximum=3),
    define("coat", type="CATEGORICAL", choices=("red", "black"), default="red"),
    define("lit", type="BOOL", default=False),
)
DISTRIBUTIONS: tuple[Distribution, ...] = (
    Uniform(),
    Gaussian(mean=20, standard_deviation=15),
    Gaussian(mean=20, standard_deviation=15),
    Uniform(),
    Homogeneous(minimum=0, maximum=360, step=45),
    Uniform(),
    Gaussian(mean=2, standard_deviation=2),
    Homogeneous(minimum=0, maximum=3, step=1.5),
    Choice(values=("black", "red")),
    Choice(values=(False, True)),
)


def domain() -> Domain:
    names = [definition.name for definition in DEFINITIONS]
    return Domain(DEFINITIONS, [Variation(*pair) for pair in zip(names, DISTRIBUTIONS, strict=True)])


def test_values_become_the_point_that_has_these_values() -> None:
    everything = domain()
    for point in np.random.default_rng(0).random((200, everything.dimensions)):
        values = everything.values(point)
        back = everything.point(values)
        again = everything.values(back)
        for path, value in values.items():
            assert again[path] == (pytest.approx(value, abs=1e-7) if isinstance(value, float) else value), path
        continuous = [axis is Axis.CONTINUOUS for axis in everything.axes]
        np.testing.assert_allclose(back[continuous], point[continuous], atol=1e-7)


def test_the_values_of_many_points_are_those_of_each() -> None:
    everything = domain()
    points = np.random.default_rng(1).random((50, everything.dimensions))
    points[:2] = [[0.0], [1.0]]
    variants = everything.variants(points)
    assert variants == [everything.values(point) for point in points]
    assert {type(value) for values in variants for value in values.values()} == {float, int, str, bool}


def test_a_quantile_is_the_share_of_the_truncated_normal_distribution_below_the_value() -> None:
    everything = domain()
    values = everything.values(np.full(everything.dimensions, 0.5)) | {"scene.distance": 37.0, "scene.far": 75.0}
    point = everything.point(values)
    assert point[1] == pytest.approx(truncnorm(-20 / 15, 80 / 15, 20, 15).cdf(37), abs=1e-9)
    assert point[2] == pytest.approx(truncnorm(40 / 15, 80 / 15, 20, 15).cdf(75), abs=1e-9)


def test_points_with_the_same_values_become_the_same_point() -> None:
    everything = domain()
    points = np.full((2, everything.dimensions), 0.2)
    points[1, 4:] = 0.21
    first, second = everything.snapped(points)
    np.testing.assert_array_equal(first, second)
    assert everything.values(first) == pytest.approx(everything.values(points[0]))


def test_a_full_turn_is_periodic_and_its_shorter_way_is_taken() -> None:
    everything = domain()
    assert np.flatnonzero(everything.periodic).tolist() == [3, 4]
    steps = everything.steps(np.full(everything.dimensions, 0.9), np.full(everything.dimensions, 0.1))
    assert steps[3] == pytest.approx(0.2)
    assert steps[0] == pytest.approx(-0.8)


@pytest.mark.parametrize("steps", [Uniform(minimum=0, maximum=90), Homogeneous(minimum=0, maximum=180, step=45)])
def test_a_part_of_a_turn_is_not_periodic(steps: Distribution) -> None:
    assert not Domain(DEFINITIONS, [Variation("heading", steps)]).periodic.any()


@pytest.mark.parametrize(
    ("name", "value"), [("distance", 101), ("lane", 1.0), ("people", 2.5), ("coat", "green"), ("x", -11)]
)
def test_a_value_outside_the_domain_is_refused_by_name(name: str, value: Any) -> None:
    everything = domain()
    values = everything.values(np.full(everything.dimensions, 0.5))
    with pytest.raises(InvalidInput, match=name):
        everything.point(values | {f"scene.{name}": value})


def test_a_value_may_have_a_unit_and_one_out_of_range_names_the_range() -> None:
    everything = domain()
    values = everything.values(np.full(everything.dimensions, 0.5))
    with_unit = everything.point(values | {"scene.heading": "90 deg"})
    np.testing.assert_array_equal(with_unit, everything.point(values | {"scene.heading": 90}))
    with pytest.raises(InvalidInput, match=r"x: .*got 11.*-10…10"):
        everything.point(values | {"scene.x": 11.0})


def test_a_missing_value_and_an_unknown_parameter_are_named() -> None:
    with pytest.raises(InvalidInput, match="x: the parameter has no value"):
        domain().point({})
    with pytest.raises(InvalidInput, match=r"distence: unknown varied parameter 'distence'; did you mean distance"):
        domain().point({"distence": 3})
    with pytest.raises(UnknownName, match="distance"):
        Domain(DEFINITIONS, [Variation("distence", Uniform())])
    with pytest.raises(InvalidInput, match=r"vary\.1.*twice"):
        Domain(DEFINITIONS, [Variation("x", Uniform()), Variation("scene.x", Uniform())])


def test_the_operational_density_is_conditional_on_legal_variants() -> None:
    domain = Domain(
        DEFINITIONS,
        [Variation("x", Uniform()), Variation("lit", Choice(values=(False, True)))],
        lambda variants: ["in a house" if values["scene.x"] > 5 else None for values in variants],
    )
    points = domain.draw(np.random.default_rng(0), 2000)
    assert points.shape == (2000, 2)
    assert domain.legal(points).all()
    assert domain.legal(np.array([[0.74, 0.0], [0.76, 0.0]])).tolist() == [True, False]
    assert np.histogram(points[:, 0], 5, (0, 0.75))[0] == pytest.approx(400, abs=90)
    nowhere = Domain(DEFINITIONS, [Variation("x", Uniform())], lambda variants: ["everywhere a house"] * len(variants))
    with pytest.raises(InvalidInput, match="hardly any variant is legal"):
        nowhere.draw(np.random.default_rng(0), 10)


def test_models_see_a_circle_for_a_full_turn_and_no_order_among_choices() -> None:
    everything = domain()
    middle = np.full((1, everything.dimensions), 0.5)
    places = {"heading": 3, "coat": 8}

    def apart(name: str, first: float, second: float) -> float:
        ends = np.repeat(middle, 2, axis=0)
        ends[:, places[name]] = first, second
        return float(np.linalg.norm(np.diff(everything.features(ends), axis=0)))

    assert apart("heading", 0.0, 0.999) == pytest.approx(0.001, rel=0.01)
    assert apart("heading", 0.2, 0.21) == pytest.approx(0.01, rel=0.01)
    assert (apart("coat", 0.1, 0.4), apart("coat", 0.1, 0.9)) == pytest.approx((0, 1))
