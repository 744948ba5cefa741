import numpy as np
import pytest

from valerie.analysis.findings.importance import explanations
from valerie.analysis.rows.design import Design
from valerie.analysis.rows.table import EvaluationTable


def test_each_function_is_explained_by_what_its_scores_follow(dropping_table):
    results = {explanation.function: explanation for explanation in explanations(dropping_table)}

    # a-net falls with the distance, which the position along the street sets; b-net looks at the clothes alone.
    assert results["a-net"].blocks[0].shares[0].factor == "person-1.pos.y"
    assert results["a-net"].measured[0].column == "distance_m"
    assert results["a-net"].measured[0].p_value < 0.001
    assert results["b-net"].blocks[0].shares[0].factor == "person-1.character"
    assert results["b-net"].blocks[0].shares[0].total == pytest.approx(0.0025 / (0.0025 + 0.0009), abs=0.1)
    assert not any(column.named for column in results["b-net"].measured)


def test_a_column_that_some_persons_lack_takes_no_part(dropping_table):
    results = explanations(dropping_table)
    assert "irradiance" not in {column.column for result in results for column in result.measured}


def test_a_function_without_scores_is_not_explained(parameters):
    assert explanations(EvaluationTable.from_rows([], parameters)) == ()


def test_nothing_measured_is_named_where_neighbours_score_alike(synthetic, parameters, grid):
    rows = synthetic(
        lambda *_: 0.5, functions=("net",), xs=np.arange(-6.0, 7).tolist(), ys=np.arange(5.0, 33, 3).tolist()
    )
    for row in rows:
        share = 0.6 + 0.25 * np.sin(row["scene.person-1.pos.x"] / 2) - 0.003 * row["distance_m"]
        tp = round(share * row["pixel_area"])
        row |= {"tp": tp, "fn": row["pixel_area"] - tp, "pacc": tp / row["pixel_area"]}
    (drawn,) = explanations(EvaluationTable.from_rows(rows, parameters, {"run-1": Design((("random", 10_000),))}))
    (listed,) = explanations(EvaluationTable.from_rows(rows, parameters, grid))
    assert any(one.named for one in drawn.measured)
    assert all(one.alike and not one.named for one in listed.measured)


def test_shares_are_those_of_each_block_alone(synthetic, parameters):
    """The outfits of both blocks act alike on their own; the second block is worse as a whole, whatever it varies."""

    def law(lower):
        return lambda _function, character, distance, _occlusion, noise: (
            0.8 - 0.1 * (character == "yellow-shirt") - 0.004 * distance - lower + 0.001 * noise
        )

    places = {"xs": [0.0, 3.0], "ys": [5.0, 11.0, 17.0], "functions": ("net",)}
    first = synthetic(law(0.0), **places)
    second = synthetic(law(0.3), **places, seed=1)
    for row in second:
        row["variant_index"] += 12
        row["frame_id"] = f"second-{row['frame_id']}"
        row["scene.person-1.cloth.metallic"] = 0.6
    types = {**parameters, "scene.person-1.cloth.metallic": "FLOAT"}
    union = EvaluationTable.from_rows([*first, *second], types, {"run-1": Design((("grid", 12), ("grid", 12)))})

    (both,) = explanations(union)
    assert [part.block for part in both.blocks] == [1, 2]
    for part, rows in zip(both.blocks, (first, second), strict=True):
        (alone,) = explanations(EvaluationTable.from_rows(rows, types))
        assert [part.block for part in alone.blocks] == [None]
        assert part.shares == alone.blocks[0].shares
        assert "person-1.cloth.metallic" not in {share.factor for share in part.shares}
        character = next(share for share in part.shares if share.factor == "person-1.character")
        assert character.total == pytest.approx(0.05**2 / np.var([row["pacc"] for row in rows]), abs=0.02)
