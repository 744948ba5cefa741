import json
from typing import Any

import pytest
from pydantic import BaseModel, ValidationError

from valerie.errors import InvalidInput, UnknownName
from valerie.parameters.assignment import canonical_json
from valerie.scene.assets.sensor_parameters import SENSOR_PARAMETERS
from valerie.sensing.settings import SensorSetting


def leaves(model: type[BaseModel], prefix: str = "") -> dict[str, Any]:
    defaults: dict[str, Any] = {}
    for name, field in model.model_fields.items():
        inner = field.annotation
        if isinstance(inner, type) and issubclass(inner, BaseModel):
            defaults |= leaves(inner, f"{name}.")
        elif name != "name":
            defaults[prefix + name] = field.get_default(call_default_factory=True)
    return defaults


def test_a_setting_has_the_parameters_of_the_list_and_no_others() -> None:
    assert leaves(SensorSetting) == {name: row.neutral for name, row in SENSOR_PARAMETERS.items()}


def test_the_choices_of_the_list_are_those_of_the_setting() -> None:
    for curve in SENSOR_PARAMETERS["curve"].choices:
        assert SensorSetting.model_validate({"curve": curve}).curve == curve
    schema = SensorSetting.model_json_schema()["properties"]["curve"]
    assert tuple(schema["enum"]) == SENSOR_PARAMETERS["curve"].choices


@pytest.mark.parametrize("name", [n for n, row in SENSOR_PARAMETERS.items() if row.minimum is not None])
def test_both_ends_of_a_range_are_accepted_and_nothing_beyond(name: str) -> None:
    row = SENSOR_PARAMETERS[name]
    assert row.minimum is not None
    assert row.maximum is not None
    group, _, field = name.rpartition(".")
    for value, fits in ((row.minimum, True), (row.maximum, True), (row.minimum - 1, False), (row.maximum + 1, False)):
        values = {group: {field: value}} if group else {field: value}
        if fits:
            assert dict(SensorSetting.model_validate(values).values())[name] == value
        else:
            with pytest.raises(ValidationError):
                SensorSetting.model_validate(values)


@pytest.mark.parametrize(
    "wrong",
    [{"exposure_ev": float("nan")}, {"gamma": 0.0}, {"curve": "agx"}, {"name": ""}, {"iso": 100}, {"lens": {"f": 2}}],
)
def test_a_wrong_setting_is_refused(wrong: dict[str, object]) -> None:
    with pytest.raises(ValidationError):
        SensorSetting.model_validate(wrong)


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        ({}, {"curve": "filmic", "exposure_ev": 0, "gamma": 1}),
        ({"exposure_ev": -2, "curve": "aces"}, {"curve": "aces", "exposure_ev": -2, "gamma": 1}),
    ],
)
def test_settings_of_the_first_effects_keep_their_identity(values: dict[str, Any], expected: dict[str, Any]) -> None:
    # The digests of all products depend on these bytes.
    assert (
        canonical_json(SensorSetting.model_validate(values).response())
        == json.dumps(expected, sort_keys=True, separators=(",", ":")).encode()
    )


@pytest.mark.parametrize(
    ("values", "effective"),
    [
        ({"lens": {"focus_distance_m": 3}}, set()),
        ({"lens": {"focus_distance_m": 3, "f_number": 2}}, {"lens.focus_distance_m", "lens.f_number"}),
        ({"noise": {"full_well_electrons": 500, "headroom_ev": 1}}, set()),
        ({"noise": {"full_well_electrons": 500, "shot": True}}, {"noise.full_well_electrons", "noise.shot"}),
        ({"specimen": 4}, set()),
        ({"specimen": 4, "soiling": {"dirt": 0.1}}, {"specimen", "soiling.dirt"}),
    ],
)
def test_values_without_effect_are_no_part_of_a_response(values: dict[str, Any], effective: set[str]) -> None:
    names = set(SensorSetting.model_validate(values).response())
    assert names - {"curve", "exposure_ev", "gamma"} == effective


def test_a_variant_replaces_only_the_sensor_values_that_it_names() -> None:
    before = SensorSetting.model_validate({"name": "dark", "gamma": 1.5, "noise": {"adc_bits": 8}})
    after = before.with_assignment({"sensor.exposure_ev": -1.0, "sensor.noise.read_electrons": 4.0})
    assert after == SensorSetting.model_validate(
        {"name": "dark", "gamma": 1.5, "exposure_ev": -1, "noise": {"adc_bits": 8, "read_electrons": 4}}
    )


def test_a_misspelt_sensor_parameter_names_its_neighbour() -> None:
    with pytest.raises(UnknownName, match=r"sensor\.noise\.read_electrons"):
        SensorSetting().with_assignment({"sensor.noise.read_electron": 1.0})


def test_a_path_outside_the_sensor_is_refused() -> None:
    with pytest.raises(InvalidInput, match="sensor"):
        SensorSetting().with_assignment({"scene.gamma": 1.0})
