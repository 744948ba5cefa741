import math
from decimal import Decimal
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import TypeAdapter
from scipy.stats import truncnorm

from valerie.errors import InvalidInput
from valerie.parameters.definitions import ParameterDefinition
from valerie.parameters.distributions import Choice, Constant, Distribution, Gaussian, Homogeneous, Uniform


def define(**given: Any) -> ParameterDefinition:
    return ParameterDefinition.model_validate(
        {"path": "scene.person-1.pos.x", "type": "FLOAT", "default": 0, "affects": "geometry", **given}
    )


FLOAT = define(minimum=-100, maximum=100, unit="m")
INT = define(type="INT", minimum=0, maximum=10)
ANGLE = define(type="ANGLE")
CHARACTER = define(type="CATEGORICAL", choices=("black-outfit", "yellow-shirt", "absent"), default="absent")


def values(distribution: Distribution, definition: ParameterDefinition = FLOAT) -> list[Any]:
    count = distribution.count(definition)
    assert count is not None
    return [distribution.value(k, definition) for k in range(count)]


def homogeneous(minimum: float, maximum: float, step: float) -> Homogeneous:
    return Homogeneous(minimum=minimum, maximum=maximum, step=step)


def test_the_papers_ranges_include_both_ends() -> None:
    assert values(homogeneous(1.5, 5.5, 1.0)) == [1.5, 2.5, 3.5, 4.5, 5.5]
    assert values(homogeneous(4.0, 5.0, 1.0)) == [4.0, 5.0]


def test_steps_are_counted_in_decimals() -> None:
    assert values(homogeneous(0, 1, 0.1)) == [0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0]


def test_a_maximum_that_is_no_multiple_is_not_reached() -> None:
    distribution = homogeneous(0, 10, 3)
    assert values(distribution) == [0.0, 3.0, 6.0, 9.0]
    assert not distribution.reaches_maximum()
    assert homogeneous(0, 9, 3).reaches_maximum()


def test_the_maximum_is_reached_within_a_billionth_of_a_step_and_never_passed() -> None:
    above = homogeneous(0, 1, 0.33333333334)
    assert values(above) == [0.0, 0.33333333334, 0.66666666668, 1.0]
    assert above.reaches_maximum()
    assert len(values(homogeneous(0, 1, 0.3333334))) == 3


@given(
    st.decimals(-50, 50, places=3), st.decimals("0.001", 10, places=3), st.integers(0, 200),
    st.decimals("0.001", "0.999", places=3),
)  # fmt: skip
def test_a_range_has_as_many_values_as_whole_steps_fit(low: Decimal, step: Decimal, n: int, rest: Decimal) -> None:
    high = low + n * step + rest * step
    if high > 100:
        return
    distribution = homogeneous(float(low), float(high), float(step))
    drawn_values = values(distribution)
    assert drawn_values == [float(low + k * step) for k in range(n + 1)]
    assert all(distribution.minimum <= value <= distribution.maximum for value in drawn_values)


def test_a_full_turn_drops_its_end_since_it_is_its_start() -> None:
    assert values(homogeneous(0, 360, 45), ANGLE) == [0.0, 45.0, 90.0, 135.0, 180.0, 225.0, 270.0, 315.0]
    assert values(homogeneous(-180, 180, 90), ANGLE) == [180.0, 270.0, 0.0, 90.0]
    assert values(homogeneous(0, 360, 360), ANGLE) == [0.0]


def test_an_angle_keeps_an_end_that_does_not_coincide_with_the_start() -> None:
    assert values(homogeneous(0, 90, 45), ANGLE) == [0.0, 45.0, 90.0]
    assert values(homogeneous(0, 360, 50), ANGLE) == [0.0, 50.0, 100.0, 150.0, 200.0, 250.0, 300.0, 350.0]


def test_a_turn_given_in_radians_is_still_eight_headings() -> None:
    turn = math.degrees(2 * math.pi)
    assert len(values(homogeneous(0, turn, math.degrees(math.pi / 4)), ANGLE)) == 8


def test_a_float_keeps_the_end_that_an_angle_drops() -> None:
    assert len(values(homogeneous(0, 360, 45), define(maximum=360))) == 9


def test_a_step_longer_than_the_range_gives_the_minimum_alone() -> None:
    assert values(homogeneous(2, 3, 5)) == [2.0]
    assert values(homogeneous(2, 2, 5)) == [2.0]


def test_a_tiny_step_is_counted_by_arithmetic() -> None:
    assert homogeneous(0, 100, 1e-12).count(FLOAT) == 10**14 + 1


def test_an_int_gives_ints() -> None:
    assert repr(values(homogeneous(0, 10, 5), INT)) == "[0, 5, 10]"


@pytest.mark.parametrize(
    ("given", "field"),
    [
        ({"minimum": 1, "maximum": 0, "step": 1}, "minimum"),
        ({"minimum": 0, "maximum": 1, "step": 0}, "step"),
        ({"minimum": 0, "maximum": 1, "step": -1}, "step"),
    ],
)
def test_a_contradiction_is_refused_by_field(given: dict[str, float], field: str) -> None:
    with pytest.raises(InvalidInput) as problem:
        Homogeneous(**given)
    assert problem.value.field == field


@pytest.mark.parametrize(
    ("distribution", "definition", "field"),
    [
        (homogeneous(-200, 0, 1), FLOAT, "minimum"),
        (homogeneous(0, 101, 1), FLOAT, "maximum"),
        (homogeneous(0.5, 5, 1), INT, "minimum"),
        (homogeneous(0, 5, 0.5), INT, "step"),
        (homogeneous(0, 400, 10), ANGLE, "maximum"),
        (homogeneous(-10, 10, 10), define(type="ANGLE", minimum=0, maximum=90), "minimum"),
        (homogeneous(0, 100, 10), define(type="ANGLE", minimum=0, maximum=90), "maximum"),
        (homogeneous(0, 1, 1), CHARACTER, "distribution"),
        (Gaussian(mean=0, standard_deviation=1), CHARACTER, "distribution"),
        (Gaussian(mean=1e6, standard_deviation=1), FLOAT, "mean"),
        (Uniform(), define(), "minimum"),
        (Uniform(minimum=0, maximum=101), FLOAT, "maximum"),
        (Uniform(minimum=200), FLOAT, "minimum"),
        (Uniform(minimum=1.2, maximum=1.8), INT, "minimum"),
        (Choice(values=("yellow-shirt", "red")), CHARACTER, "values.1"),
        (Choice(values=(0, 360)), ANGLE, "values.1"),
        (Choice(values=(1, 1.0)), FLOAT, "values.1"),
        (Constant(value="1"), FLOAT, "value"),
    ],
)
def test_what_does_not_fit_the_declaration_is_refused_by_field(
    distribution: Distribution, definition: ParameterDefinition, field: str
) -> None:
    with pytest.raises(InvalidInput) as problem:
        distribution.check(definition)
    assert problem.value.field == field


def test_an_angle_range_is_compared_modulo_a_turn() -> None:
    homogeneous(370, 380, 5).check(define(type="ANGLE", minimum=0, maximum=90))


@pytest.mark.parametrize(
    ("mean", "deviation", "low", "high"),
    [(0, 1, -1, 2), (5, 2, -100, 100), (0, 1, 3, 6), (0, 1, -6, -3), (50, 3, 0, 20), (0, 10, 0, 0.5)],
)
def test_a_gaussian_is_the_truncated_normal_of_scipy(mean: float, deviation: float, low: float, high: float) -> None:
    definition = define(minimum=low, maximum=high, default=low)
    gaussian = Gaussian(mean=mean, standard_deviation=deviation)
    gaussian.check(definition)
    for u in (1e-6, 0.1, 0.25, 0.5, 0.9, 1 - 1e-6):
        expected = truncnorm.ppf(u, (low - mean) / deviation, (high - mean) / deviation, loc=mean, scale=deviation)
        assert math.isclose(float(gaussian.quantile(u, definition)), expected, rel_tol=1e-6, abs_tol=1e-8)


@given(st.floats(0, 1, exclude_max=True), st.floats(-100, 100), st.floats(1e-3, 1e3))
def test_a_gaussian_never_leaves_the_declared_range(u: float, mean: float, deviation: float) -> None:
    value = Gaussian(mean=mean, standard_deviation=deviation).quantile(u, FLOAT)
    assert isinstance(value, float)
    assert -100 <= value <= 100


def test_a_gaussian_heading_around_north_falls_on_both_sides() -> None:
    gaussian = Gaussian(mean=0, standard_deviation=10)
    assert gaussian.quantile(0.25, ANGLE) == pytest.approx(353.2551, abs=1e-4)
    assert gaussian.quantile(0.75, ANGLE) == pytest.approx(6.7449, abs=1e-4)


def test_a_gaussian_over_a_part_of_the_circle_finds_the_nearest_copy_of_the_range() -> None:
    definition = define(type="ANGLE", minimum=300, maximum=359, default=300)
    gaussian = Gaussian(mean=0, standard_deviation=10)
    drawn_values = [float(gaussian.quantile(u, definition)) for u in np.linspace(0, 0.999, 50)]
    assert all(300 <= value <= 359 for value in drawn_values)
    # Of the copy around 360, the range leaves the part below 359.
    median = truncnorm.median(-6.0, -0.1, loc=360, scale=10)
    assert gaussian.quantile(0.5, definition) == pytest.approx(median, abs=1e-6)


def test_a_gaussian_int_is_symmetric_and_within_the_range() -> None:
    gaussian = Gaussian(mean=5, standard_deviation=4)
    drawn_values = [gaussian.quantile(u, INT) for u in (np.arange(10_000) + 0.5) / 10_000]
    counts = np.bincount(drawn_values, minlength=11)
    assert len(counts) == 11
    assert np.abs(counts - counts[::-1]).max() <= 1
    assert counts.argmax() == 5


def test_continuous_distributions_take_the_mid_quantiles_in_a_grid() -> None:
    assert values(Uniform(minimum=0, maximum=10, count=5)) == [1.0, 3.0, 5.0, 7.0, 9.0]
    gaussian = values(Gaussian(mean=0, standard_deviation=1, count=3))
    assert gaussian == pytest.approx([-0.9674215661, 0.0, 0.9674215661], abs=1e-9)


def test_without_count_a_continuous_distribution_has_no_grid() -> None:
    assert Uniform().count(FLOAT) is None
    assert Gaussian(mean=0, standard_deviation=1).count(FLOAT) is None


def test_a_uniform_without_ends_takes_the_declared_ones() -> None:
    assert Uniform().quantile(0.25, FLOAT) == -50.0


def test_a_uniform_int_gives_every_whole_number_equal_weight() -> None:
    drawn_values = [Uniform().quantile(u, INT) for u in (np.arange(1100) + 0.5) / 1100]
    assert np.bincount(drawn_values).tolist() == [100] * 11


def test_listed_values_have_equal_weight() -> None:
    choice = Choice(values=("black-outfit", "yellow-shirt", "absent"))
    drawn_values = [choice.quantile(u, CHARACTER) for u in (np.arange(300) + 0.5) / 300]
    assert [drawn_values.count(value) for value in choice.values] == [100, 100, 100]
    steps = [homogeneous(0, 10, 3).quantile(u, FLOAT) for u in (np.arange(400) + 0.5) / 400]
    assert [steps.count(value) for value in (0.0, 3.0, 6.0, 9.0)] == [100] * 4


def test_the_last_quantile_is_the_last_value() -> None:
    below_one = math.nextafter(1.0, 0.0)
    assert homogeneous(0, 0.9, 0.1).quantile(below_one, FLOAT) == 0.9
    assert float(Uniform(minimum=0, maximum=3).quantile(below_one, FLOAT)) <= 3.0


@pytest.mark.parametrize(
    "distribution",
    [homogeneous(0, 1, 0.5), Gaussian(mean=0, standard_deviation=1, count=3), Uniform(), Choice(values=(1, 2)),
     Constant(value="absent")],
)  # fmt: skip
def test_a_distribution_survives_json(distribution: Distribution) -> None:
    adapter: TypeAdapter[Distribution] = TypeAdapter(Distribution)
    assert adapter.validate_json(adapter.dump_json(distribution)) == distribution
