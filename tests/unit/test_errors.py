"""Messages of errors."""

from valerie.errors import UnknownName


def test_near_names_come_first() -> None:
    assert str(UnknownName("asset", "urban-stret", ["urban-street", "box"])) == (
        "unknown asset 'urban-stret'; did you mean urban-street?"
    )


def test_of_many_names_some_are_listed_and_the_rest_is_counted() -> None:
    text = str(UnknownName("parameter", "?", [f"p{number:02d}" for number in range(15)], limit="names"))
    assert text.endswith("p10, p11 and 3 more; limit: names")


def test_a_name_without_its_object_is_completed_once() -> None:
    known = ["environment-1.rain", "scene.environment-1.rain", "brain", "sun-1.azimuth"]
    assert str(UnknownName("parameter", "rain", known)) == "unknown parameter 'rain'; did you mean environment-1.rain?"


def test_a_long_name_is_cut() -> None:
    text = str(UnknownName("parameter", "y" * 100_000, ("x",), field="vary"))
    assert len(text) < 250
    assert "unknown parameter 'yyyy" in text
