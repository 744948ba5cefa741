import numpy as np

from tests.planted_tables import planted_table
from valerie.analysis.report.distributions import binned_means, distributions
from valerie.analysis.rows.frame_counts import ALL, Group
from valerie.measures import measure_of

OCCLUSION = [0.0, 0.0, 0.02, 0.12, 0.31]


def test_a_person_counts_once_however_many_functions_look() -> None:
    table = planted_table(
        [0.9] * 10, [*range(5), *range(5)], occlusion_rate=[*OCCLUSION, *OCCLUSION], function=["a"] * 5 + ["b"] * 5
    )
    (found,) = distributions(table, measure_of("occlusion_rate"))
    assert (found.persons, found.low, found.high, found.quantiles[1]) == (5, 0.0, 0.31, 0.02)
    assert [(low, n) for low, _, n in found.bins] == [
        (0.0, 3), (0.05, 0), (0.1, 1), (0.15, 0), (0.2, 0), (0.25, 0), (0.3, 1),
    ]  # fmt: skip


def test_each_pedestrian_and_all_together_share_their_bins() -> None:
    table = planted_table([0.9] * 5, range(5), distance_m=[17, 18, 22, 31, 38.2], character=["a", "a", "b", "b", "b"])
    shares = distributions(table, measure_of("distance_m"))
    assert [(share.character, [n for _, _, n in share.bins]) for share in shares] == [
        ("a", [2, 0, 0, 0, 0]),
        ("b", [0, 1, 0, 1, 1]),
        (ALL, [2, 1, 0, 1, 1]),
    ]
    assert distributions(table, measure_of("irradiance")) == ()


def test_means_over_two_measures_are_those_of_their_cells() -> None:
    table = planted_table(
        [1.0, 0.5, 0.0, 0.4, np.nan],
        range(5),
        occlusion_rate=[0.01, 0.01, 0.06, 0.06, 0.06],
        pixel_area_percent=[0.11, 0.12, 0.11, 0.16, 0.11],
    )
    means = binned_means(
        table, measure_of("occlusion_rate"), measure_of("pixel_area_percent"), Group("net", "default", ALL)
    )
    assert means is not None
    assert means.columns == ("0.1–0.15", "0.15–0.2")
    assert [(level, [(cell.n, cell.mean) for cell in cells]) for level, cells in means.rows] == [
        ("0–5", [(2, 0.75), (0, None)]),
        ("5–10", [(1, 0.0), (1, 0.4)]),
    ]
