"""Weather that contradicts itself."""

import pytest

from valerie.errors import UnknownName
from valerie.parameters.definitions import Value
from valerie.scene.assets.asset import asset_manifest
from valerie.scene.legality.rejection import rejection_reason
from valerie.scene.variation.variant import complete
from valerie.testing.assets import simple_manifest

WINTER = asset_manifest({"name": "urban-street", "season": "winter"})[0]
RAIN, SNOWFALL, SNOW_DEPTH = (f"scene.environment-1.{name}" for name in ("rain", "snowfall", "snow_depth"))


@pytest.mark.parametrize(
    ("weather", "reason"),
    [
        ({RAIN: 1.0, SNOWFALL: 1.0}, "rain and snow fall at once"),
        ({RAIN: 1.0, SNOWFALL: 0.0}, None),
        ({SNOWFALL: 2.0, SNOW_DEPTH: 0.1}, None),
        ({RAIN: 1.0, SNOW_DEPTH: 0.1}, None),
        ({}, None),
    ],
)
def test_rain_and_snowfall_exclude_each_other(weather: dict[str, Value], reason: str | None) -> None:
    assert rejection_reason(weather, WINTER) == reason


def test_an_asset_without_snow_has_no_contradiction() -> None:
    assert rejection_reason({}, simple_manifest()) is None


def test_a_summer_street_knows_no_snow() -> None:
    with pytest.raises(UnknownName):
        complete({SNOWFALL: 1.0}, asset_manifest("urban-street")[0])
