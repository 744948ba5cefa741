import itertools
import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from valerie.errors import InvalidInput, UnknownName
from valerie.parameters.blocks import Block, Variation
from valerie.parameters.definitions import ParameterDefinition
from valerie.parameters.distributions import Choice, Constant, Distribution, Gaussian, Homogeneous, Uniform
from valerie.parameters.samplers import SAMPLERS
from valerie.parameters.samplers.base import UnitPoints
from valerie.parameters.space import ParameterSpace
from valerie.statistics.replicates import replicates

X, Y, HEADING = "scene.person-1.pos.x", "scene.person-1.pos.y", "scene.person-1.heading"
CHARACTER = "scene.person-1.character"


def define(path: str, **given: Any) -> ParameterDefinition:
    return ParameterDefinition.model_validate(
        {"path": path, "type": "FLOAT", "minimum": 0, "maximum": 100, "default": 0, "affects": "geometry", **given}
    )


DEFINITIONS = (
    define(X, name="p1"),
    define(Y),
    define(HEADING, type="ANGLE", minimum=None, maximum=None),
    define(
        CHARACTER, type="CATEGORICAL", minimum=None, maximum=None, choices=("black-outfit", "yellow-shirt"),
        default="yellow-shirt",
    ),
)  # fmt: skip


def steps(minimum: float, maximum: float, step: float) -> Homogeneous:
    return Homogeneous(minimum=minimum, maximum=maximum, step=step)


def block(design: str = "grid", count: int | None = None, /, **distributions: Distribution) -> Block:
    paths = {"x": X, "y": Y, "heading": HEADING, "character": CHARACTER}
    return Block(
        design=design, count=count, variations=tuple(Variation(paths[name], d) for name, d in distributions.items())
    )


def test_the_papers_example_has_ten_variants_the_right_most_fastest() -> None:
    space = ParameterSpace(DEFINITIONS, [block(x=steps(1.5, 5.5, 1.0), y=steps(4.0, 5.0, 1.0))])
    assert len(space) == 10
    assert [tuple(a.values.values()) for a in space][:4] == [(1.5, 4.0), (1.5, 5.0), (2.5, 4.0), (2.5, 5.0)]


AXES = st.lists(st.integers(1, 6), min_size=1, max_size=4)


@given(st.lists(AXES, min_size=1, max_size=3), st.data())
@settings(max_examples=60)
def test_a_space_is_the_sequence_of_its_blocks_products(blocks: list[list[int]], data: st.DataObject) -> None:
    names = ("x", "y", "heading", "character")
    limits = {"character": 2}

    def axis(name: str, count: int) -> Distribution:
        if name == "character":
            return Choice(values=("yellow-shirt", "black-outfit")[: min(count, limits["character"])])
        return steps(0, count - 1, 1)

    space = ParameterSpace(
        DEFINITIONS, [block(**{n: axis(n, c) for n, c in zip(names, counts, strict=False)}) for counts in blocks]
    )
    expected = [
        (i, values)
        for i, counts in enumerate(blocks)
        for values in itertools.product(*(
            ("yellow-shirt", "black-outfit")[:count] if name == "character" else [float(k) for k in range(count)]
            for name, count in zip(names, counts, strict=False)
        ))
    ]  # fmt: skip
    assert len(space) == sum(
        math.prod(min(c, 2) if n == "character" else c for n, c in zip(names, counts, strict=False))
        for counts in blocks
    )
    listed = list(space)
    assert [(a.block, tuple(a.values.values())) for a in listed] == expected
    index = data.draw(st.integers(0, len(space) - 1))
    assert space[index] == listed[index]
    stop = data.draw(st.integers(index, len(space)))
    assert [values for _, values in space.values(index, stop)] == [dict(a.values) for a in listed[index:stop]]


@given(
    design=st.sampled_from(sorted(SAMPLERS)), count=st.integers(1, 200), seed=st.integers(0, 2**63 - 1), data=st.data()
)
@settings(max_examples=60)
def test_sampled_variants_follow_from_the_index_and_stay_in_range(
    design: str, count: int, seed: int, data: st.DataObject
) -> None:
    def space() -> ParameterSpace:
        sampled = block(
            design, count, x=Uniform(minimum=3, maximum=7), y=Gaussian(mean=99, standard_deviation=5),
            heading=Uniform(), character=Choice(values=("black-outfit", "yellow-shirt")),
        )  # fmt: skip
        return ParameterSpace(DEFINITIONS, [block(x=steps(0, 2, 1)), sampled], seed=seed)

    listed = list(space())
    assert len(listed) == len(space()) == 3 + count
    for assignment in listed[3:]:
        x, y, heading, character = (assignment.values[path] for path in (X, Y, HEADING, CHARACTER))
        assert 3 <= float(x) <= 7
        assert 0 <= float(y) <= 100
        assert 0 <= float(heading) < 360
        assert character in ("black-outfit", "yellow-shirt")
    index = data.draw(st.integers(0, 2 + count))
    assert space()[index] == listed[index]


def test_each_replicate_of_a_latin_hypercube_has_one_value_per_stratum() -> None:
    sampled = block("latin_hypercube", 80, x=Uniform(), y=Uniform(minimum=0, maximum=50))
    space = ParameterSpace(DEFINITIONS, [block(x=steps(0, 2, 1)), sampled])
    for number in range(8):
        drawn = [space[3 + i] for i in np.flatnonzero(replicates(80) == number).tolist()]
        assert sorted(int(float(a.values[X]) // 10) for a in drawn) == list(range(10))
        assert sorted(int(float(a.values[Y]) // 5) for a in drawn) == list(range(10))


@pytest.mark.parametrize("design", ["sobol", "latin_hypercube", "halton"])
def test_listed_values_are_drawn_with_equal_weight(design: str) -> None:
    space = ParameterSpace(
        DEFINITIONS, [block(design, 256, x=steps(0, 30, 10), character=Choice(values=("black-outfit", "yellow-shirt")))]
    )
    drawn = [a.values[X] for a in space]
    assert {value: drawn.count(value) for value in (0.0, 10.0, 20.0, 30.0)} == pytest.approx(
        dict.fromkeys((0.0, 10.0, 20.0, 30.0), 64), abs=2
    )


def test_a_smaller_sobol_design_is_the_beginning_of_a_larger_one() -> None:
    small, large = (ParameterSpace(DEFINITIONS, [block("sobol", n, x=Uniform())], seed=5) for n in (48, 128))
    assert [a.values for a in small] == [large[i].values for i in range(48)]


def test_a_constant_among_the_varied_leaves_the_draws_as_they_are() -> None:
    plain = ParameterSpace(DEFINITIONS, [block("sobol", 8, x=Uniform())])
    beside = ParameterSpace(DEFINITIONS, [block("sobol", 8, y=Constant(value=3), x=Uniform())])
    assert [a.values[X] for a in plain] == [a.values[X] for a in beside]
    assert {a.values[Y] for a in beside} == {3.0}


def test_blocks_of_one_design_draw_different_points_and_so_do_other_seeds() -> None:
    sampled = block("random", 4, x=Uniform())
    space = ParameterSpace(DEFINITIONS, [sampled, sampled], seed=0)
    other = ParameterSpace(DEFINITIONS, [sampled], seed=1)
    assert len({a.values[X] for a in (*space, *other)}) == 12


def test_the_draws_of_a_seed_do_not_change_between_releases() -> None:
    space = ParameterSpace(DEFINITIONS, [block(design, 40, x=Uniform()) for design in sorted(SAMPLERS)], seed=0)
    # Two points of each of the first two replicates.
    drawn = {
        design: [round(float(space[40 * number + i].values[X]), 6) for i in (0, 8, 1, 9)]
        for number, design in enumerate(sorted(SAMPLERS))
    }
    assert drawn == {
        "halton": [66.169603, 16.169603, 28.213919, 78.213919],
        "latin_hypercube": [94.043664, 78.097916, 82.611188, 4.769309],
        "random": [84.061949, 7.593738, 20.928628, 29.688168],
        "sobol": [74.587716, 18.397766, 99.172715, 44.194866],
    }


def test_a_billion_variants_are_counted_and_indexed_without_being_listed() -> None:
    fine = steps(0, 99.999, 0.001)
    space = ParameterSpace(DEFINITIONS, [block(x=fine, y=fine), block(x=steps(0, 1, 1))])
    assert len(space) == 10**10 + 2
    assert dict(space[1_234_567_890].values) == {X: 12.345, Y: 67.89}
    assert space[-1].values == {X: 1.0}
    assert space.block_of(10**10) == 1


def test_a_space_beyond_what_len_can_hold_is_still_exact() -> None:
    finest = steps(0, 100, 1e-10)
    space = ParameterSpace(DEFINITIONS, [block(x=finest, y=finest)])
    assert space.size == (10**12 + 1) ** 2
    assert space[space.size - 1].values == {X: 100.0, Y: 100.0}


@given(st.lists(AXES, min_size=1, max_size=2), st.data())
def test_lines_are_the_variants_that_differ_in_one_parameter_only(blocks: list[list[int]], data: st.DataObject) -> None:
    names = ("x", "y", "heading")
    given_blocks = [
        block(**{name: steps(0, count - 1, 1) for name, count in zip(names, counts, strict=False)}) for counts in blocks
    ]
    space = ParameterSpace(DEFINITIONS, given_blocks)
    index = data.draw(st.integers(0, len(space) - 1))
    here = space[index]
    for path, line in space.lines(index).items():
        others = {name: value for name, value in here.values.items() if name != path}
        expected = [
            one.index
            for one in space
            if one.block == here.block and others == {k: v for k, v in one.values.items() if k != path}
        ]
        assert list(line) == expected
    assert space.lines(index).keys() == here.values.keys()


@pytest.mark.parametrize("index", [-11, 10, 10**12])
def test_an_index_outside_is_an_index_error(index: int) -> None:
    space = ParameterSpace(DEFINITIONS, [block(x=steps(0, 9, 1))])
    with pytest.raises(IndexError):
        space[index]


def test_points_come_as_they_are_listed_with_the_constants_beside_them() -> None:
    space = ParameterSpace(
        DEFINITIONS,
        [Block(design="points", points=({"p1": 3, HEADING: 360}, {"p1": 4}), constants={Y: 7})],
        constants={"p1": 1, Y: 2},
    )
    assert [a.values for a in space] == [{X: 3.0, Y: 7.0, HEADING: 0.0}, {X: 4.0, Y: 7.0}]


def test_without_blocks_a_space_is_the_constants_alone() -> None:
    assert [a.values for a in ParameterSpace(DEFINITIONS, constants={"p1": 1})] == [{X: 1.0}]


def test_a_continuous_distribution_in_a_grid_takes_its_mid_quantiles() -> None:
    space = ParameterSpace(DEFINITIONS, [block(x=Uniform(minimum=0, maximum=4, count=2), y=steps(0, 1, 1))])
    assert [tuple(a.values.values()) for a in space] == [(1.0, 0.0), (1.0, 1.0), (3.0, 0.0), (3.0, 1.0)]


def test_a_constraint_rejects_without_moving_the_indexes() -> None:
    space = ParameterSpace(DEFINITIONS, [block(x=steps(0, 3, 1))], constraints=["p1 != 2", "person-1.pos.y < 1"])
    reasons = [space.violated(a.values) for a in space]
    assert reasons == [None, None, "the constraint p1 != 2 is not met", None]


def test_a_parameter_may_have_further_names() -> None:
    space = ParameterSpace(
        DEFINITIONS, constants={"across": 3}, constraints=["across < 4 and p1 > 2"], aliases={"across": X}
    )
    assert space[0].values == {X: 3.0}
    assert space.violated(space[0].values) is None


def test_varied_is_what_has_more_than_one_value() -> None:
    space = ParameterSpace(
        DEFINITIONS,
        [
            block(heading=Uniform(count=2), x=Constant(value=1)),
            Block(design="points", points=({"p1": 1}, {"p1": 2}), constants={CHARACTER: "black-outfit"}),
        ],
        constants={Y: 3},
    )
    assert space.varied == (HEADING, X, CHARACTER)


def test_a_sampler_of_ones_own_is_a_class_with_one_method() -> None:
    class Diagonal:
        def __init__(self, *, dimensions: int, count: int, seed: int) -> None:
            self.dimensions, self.count = dimensions, count

        def points(self, start: int, stop: int) -> UnitPoints:
            return np.repeat(np.arange(start, stop)[:, None] / self.count, self.dimensions, axis=1)

    space = ParameterSpace(
        DEFINITIONS, [block("diagonal", 4, x=Uniform(), y=Uniform())], samplers={"diagonal": Diagonal}
    )
    assert [tuple(a.values.values()) for a in space] == [(0.0, 0.0), (25.0, 25.0), (50.0, 50.0), (75.0, 75.0)]


@pytest.mark.parametrize(
    ("given", "field"),
    [
        ({"blocks": [block(x=steps(0, 200, 1))]}, "blocks.0.vary.0.maximum"),
        ({"blocks": [block(x=steps(0, 1, 1)), block(x=Uniform())]}, "blocks.1.vary.0.count"),
        ({"blocks": [block("sobol", x=Uniform())]}, "blocks.0.count"),
        ({"blocks": [block("sobol", 0, x=Uniform())]}, "blocks.0.count"),
        ({"blocks": [block("grid", 5, x=steps(0, 1, 1))]}, "blocks.0.count"),
        ({"blocks": [Block(design="points")]}, "blocks.0.points"),
        ({"blocks": [Block(design="points", points=({"p1": 200},))]}, "blocks.0.points.0.scene.person-1.pos.x"),
        ({"blocks": [Block(points=({"p1": 2},))]}, "blocks.0.points"),
        ({"blocks": [Block(variations=(Variation("p1", steps(0, 1, 1)), Variation(X, steps(0, 1, 1))))]},
         "blocks.0.vary.1"),
        ({"constants": {"p1": 1, X: 2}}, "constants.scene.person-1.pos.x"),
        ({"constants": {"p1": math.nan}}, "constants.p1"),
        ({"constraints": ["p1 < 1", "p1 <"]}, "constraints.1"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_named_by_its_place(given: dict[str, Any], field: str) -> None:
    with pytest.raises(InvalidInput) as problem:
        ParameterSpace(DEFINITIONS, **given)
    assert problem.value.field == field


@pytest.mark.parametrize(
    ("given", "near"),
    [
        ({"blocks": [Block(variations=(Variation("person-1.pos.z", steps(0, 1, 1)),))]}, "person-1.pos.y"),
        ({"blocks": [block("sobel", 4)]}, "sobol"),
        ({"constants": {"p": 1}}, "p1"),
    ],
)
def test_an_unknown_name_lists_near_matches(given: dict[str, Any], near: str) -> None:
    with pytest.raises(UnknownName, match=f"did you mean .*{near}"):
        ParameterSpace(DEFINITIONS, **given)


def test_reading_a_grid_in_order_does_not_cost_more_at_its_end() -> None:
    space = ParameterSpace(DEFINITIONS, [block(x=steps(0, 99, 1), y=steps(0, 99, 1), heading=steps(0, 350, 10))])
    assert len(space) == 360_000
    last = list(space.values(359_998, 360_000))
    assert [values[HEADING] for _, values in last] == [340.0, 350.0]
