from valerie.analysis.wording import setting_labels


def test_with_one_sensor_a_function_is_called_by_its_name_alone() -> None:
    pairs = [("fpn", "default"), ("deeplab", "default"), ("fpn", "default")]
    assert list(setting_labels(pairs).items()) == [(("fpn", "default"), "fpn"), (("deeplab", "default"), "deeplab")]


def test_with_several_sensors_each_label_tells_its_own() -> None:
    labels = setting_labels([("fpn", "day"), ("fpn", "dusk"), ("deeplab", "day")])
    assert list(labels.values()) == ["fpn · sensor day", "fpn · sensor dusk", "deeplab · sensor day"]
