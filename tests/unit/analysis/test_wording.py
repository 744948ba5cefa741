from valerie.analysis.wording import setting_labels


def test_with_one_sensor_a_label_is_the_name_of_the_function() -> None:
    pairs = [("fpn", "default"), ("deeplab", "default"), ("fpn", "default")]
    assert list(setting_labels(pairs).items()) == [(("fpn", "default"), "fpn"), (("deeplab", "default"), "deeplab")]


def test_with_several_sensors_each_label_names_its_sensor() -> None:
    labels = setting_labels([("fpn", "day"), ("fpn", "dusk"), ("deeplab", "day")])
    assert list(labels.values()) == ["fpn · sensor day", "fpn · sensor dusk", "deeplab · sensor day"]
