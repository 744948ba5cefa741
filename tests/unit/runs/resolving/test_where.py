import pytest

from valerie.errors import InvalidInput, UnknownName
from valerie.parameters.definitions import ParameterDefinition
from valerie.runs.resolving.where import METADATA, compile_where

ELEVATION = ParameterDefinition.model_validate(
    {"path": "scene.sun-1.elevation", "type": "FLOAT", "default": 40.0, "affects": "light"}
)
ROW = {"occlusion_rate": 0.2, "camera": "camera-1", "pacc": None, "distance_m": 30.0}


def holds(text: str, **more: object) -> bool:
    return compile_where(text, [ELEVATION], choices={"camera": ["camera-1", "camera-2"]}).holds({**ROW, **more})


def test_columns_and_parameters_are_compared() -> None:
    assert holds("occlusion_rate < 0.5 and camera == 'camera-1'")
    assert not holds("camera != 'camera-1'")
    assert holds("scene.sun-1.elevation > 30 and sun-1.elevation > 30", **{"scene.sun-1.elevation": 35.0})
    assert holds("sun-1.elevation == 40")  # its default


def test_neither_a_condition_on_a_missing_value_nor_its_negation_selects_a_row() -> None:
    assert not holds("pacc < 0.5")
    assert not holds("not pacc < 0.5")
    assert not holds("pacc + 1 < 5 and -pacc < 3")
    assert not holds("0 <= pacc <= 1")


def test_a_condition_that_does_not_depend_on_a_missing_value_holds() -> None:
    assert holds("pacc < 0.5 or distance_m > 25")
    assert not holds("not (pacc < 0.5 and distance_m > 25)")
    assert holds("not (pacc < 0.5 and distance_m > 35)")


def test_a_selection_knows_whether_it_needs_a_function() -> None:
    assert not compile_where("distance_m > 3").scored
    assert compile_where("distance_m > 3 or tp == 0").scored
    assert compile_where("function == 'x'").scored
    assert not any(compile_where(f"{name} == {name}").scored for name in METADATA)


def test_a_misspelt_column_or_camera_is_refused_with_near_matches() -> None:
    with pytest.raises(UnknownName, match="unknown column 'occlusion_rat'; did you mean occlusion_rate"):
        compile_where("occlusion_rat < 1")
    with pytest.raises(UnknownName, match="camera-1"):
        holds("camera == 'camera-7'")


def test_numbers_and_names_are_not_compared() -> None:
    with pytest.raises(InvalidInput, match="cannot be compared"):
        holds("camera < 3")


def test_per_cent_is_another_way_to_write_a_share_and_a_share_above_one_is_refused() -> None:
    for text in ("pacc < 50 %", "pacc < 50%", "pacc < 0.5"):
        assert compile_where(text).holds({"pacc": 0.4})
        assert not compile_where(text).holds({"pacc": 0.6})
    with pytest.raises(
        InvalidInput, match=r"pacc is a share in 0…1; got 50; limit: 1; 50 % is another way to write 0.5"
    ):
        compile_where("sun_elevation_deg < 3 and 50 > pacc")
    assert compile_where("distance_m > 50").holds({"distance_m": 60.0})
