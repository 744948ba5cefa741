"""What a node was probably meant to be called."""

import pytest

from valerie.scene.checks.names import likely_name


@pytest.mark.parametrize(
    ("name", "likely"),
    [
        ("Person_01", "person-1"),
        ("person3", "person-3"),
        ("CAR 2", "car-2"),
        ("buildings_7", "building-7"),
        ("TrafficLight.004", "traffic-light-4"),
        ("traffic_sign", "traffic-sign-1"),
        ("Cube_001", None),
        ("house-1", None),
        ("", None),
    ],
)
def test_likely_names(name: str, likely: str | None) -> None:
    assert likely_name(name) == likely
