import numpy as np
import pytest

from valerie.analysis.findings.effects import level_means, strongest_pair
from valerie.analysis.rows.table import EvaluationTable


def test_a_level_has_the_mean_and_number_of_its_persons(dropping_table):
    pacc, functions = dropping_table.numbers("pacc"), dropping_table.codes("function")
    means = {level_mean.down: level_mean for level_mean in level_means(dropping_table)}["camera"]
    rows = [dict(zip(means.columns, cells, strict=True)) for _, cells in means.rows]

    assert [level for level, _ in means.rows] == ["camera-1", "camera-2", "camera-3"]
    for camera, cells in zip(("camera-1", "camera-2", "camera-3"), rows, strict=True):
        for name in functions.names:
            expected = pacc[dropping_table.codes("camera").where(camera) & functions.where(name)]
            assert cells[name].n == np.isfinite(expected).sum()
            assert cells[name].mean == pytest.approx(np.nanmean(expected))


def test_the_strongest_pair_is_the_one_that_the_scores_follow(synthetic, parameters, grid):
    """pACC is high where character and sun match, whatever the place: neither alone explains anything."""
    rows = []
    for number, sun in enumerate((140.0, 260.0)):
        law = lambda _f, character, *_, sun=sun: 0.9 if (character == "black-outfit") == (sun == 140.0) else 0.3  # noqa: E731
        for row in synthetic(law, xs=[0.0, 2.0, 4.0], ys=[5.0, 12.0, 19.0]):
            index = 1000 * number + row["variant_index"]
            rows.append(
                {**row, "variant_index": index, "frame_id": f"{index}-{row['camera']}", "scene.sun-1.azimuth": sun}
            )
    table = EvaluationTable.from_rows(rows, {**parameters, "scene.sun-1.azimuth": "ANGLE"}, grid)
    maps = strongest_pair(table)

    assert set(maps) == {"a-net", "b-net"}
    for means in maps.values():
        assert {means.down, means.across} == {"person-1.character", "sun-1.azimuth"}
        cells = [cell for _, row in means.rows for cell in row]
        assert sorted(round(cell.mean, 1) for cell in cells) == [0.3, 0.3, 0.9, 0.9]
        assert sum(cell.n for cell in cells) == np.isfinite(table.numbers("pacc")).sum() / 2


def test_a_table_with_fewer_than_two_factors_has_no_pair(parameters):
    assert strongest_pair(EvaluationTable.from_rows([], parameters)) == {}
