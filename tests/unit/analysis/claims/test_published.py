import numpy as np
import pytest

from tests.planted_tables import X, planted_table
from valerie.analysis.claims.claims import Claims, parse_claims
from valerie.analysis.claims.published import cross_examples, numbers_beside
from valerie.analysis.rows.table import EvaluationTable
from valerie.errors import UnknownName

CLAIM = {"id": "any", "says": "…", "quantity": {"of": "pacc", "low": 0}}
SUN = "scene.sun-1.azimuth"
METAL = "scene.person-1.cloth.metallic"


def document(**parts: object) -> Claims:
    return parse_claims({"title": "A paper", "claims": [CLAIM], **parts})


def test_printed_numbers_stand_beside_those_of_the_run() -> None:
    table = planted_table(
        [0.9, 0.5, 0.1, 0.3], range(4), function=["a", "a", "b", "b"], occlusion_rate=[0, 0.1, 0, 0.1]
    )
    numbers = [
        {"source": "table 2", "what": "mean", "of": "pacc", "value": 0.8927, "functions": ["b"]},
        {"what": "least", "of": "pacc", "statistic": "minimum", "value": 0.01, "where": "occlusion_rate > 0.05"},
        {"what": "occluded", "of": "occlusion_rate", "statistic": "share", "above": 0.05, "value": 0.144},
    ]
    numbers_here = numbers_beside(document(numbers=numbers), table)
    assert [(number.what, number.function, number.printed, number.here, number.rows) for number in numbers_here] == [
        ("mean", "b", 0.8927, pytest.approx(0.2), 2),
        ("least", "a", 0.01, 0.5, 1),
        ("least", "b", 0.01, 0.3, 1),
        ("occluded", "", 0.144, 0.5, 2),
    ]
    with pytest.raises(UnknownName, match=r"numbers.0.functions"):
        numbers_beside(document(numbers=[{"what": "mean", "of": "pacc", "value": 1, "functions": ["c"]}]), table)


def crossed() -> EvaluationTable:
    """Two places × two suns × two materials; at the second place the first sun flips with the material."""
    place, sun, metal = (axis.ravel() for axis in np.meshgrid([1.0, 2.0], [120.0, 210.0], [0.0, 0.6], indexing="ij"))
    pacc = np.where((place == 2) & (sun == 120) & (metal == 0), 0.3, 0.9)
    plain = planted_table(pacc, range(8), occlusion_rate=0.1)
    parameters = {X: "FLOAT", SUN: "ANGLE", METAL: "FLOAT"}
    columns = {name: plain.arrow[name] for name in plain.arrow.column_names if name not in parameters}
    return EvaluationTable.from_columns(columns | {X: place, SUN: sun, METAL: metal}, parameters)


def test_a_cross_shows_the_view_that_changes_most_with_everything_else_equal() -> None:
    cross = {
        "title": "Shiny",
        "down": "person-1.cloth.metallic",
        "across": "sun-1.azimuth",
        "where": "occlusion_rate > 0.05",
    }
    (found,) = cross_examples(document(crosses=[cross]), crossed())
    assert (found.places, found.change, found.occlusion) == (2, pytest.approx(0.6), 0.1)
    assert (found.down, found.across) == (("0", "0.6"), ("120°", "210°"))
    assert [(view.down, view.across, view.pacc["net"]) for view in found.views] == [
        ("0", "120°", 0.3),
        ("0", "210°", 0.9),
        ("0.6", "120°", 0.9),
        ("0.6", "210°", 0.9),
    ]
    assert cross_examples(document(crosses=[cross | {"where": "occlusion_rate > 0.5"}]), crossed()) == ()
    assert cross_examples(document(crosses=[cross | {"down": "sun-2.azimuth"}]), crossed()) == ()
