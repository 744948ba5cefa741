"""Names of files from names that people gave."""

from __future__ import annotations

import unicodedata

import pytest

from valerie.spelling import package_name, plain_name


@pytest.mark.parametrize(
    ("given", "plain"),
    [
        ("First run", "First-run"),
        ("Fußgänger über Öl", "Fussgaenger-ueber-Oel"),
        ("café à Łódź", "cafe-a-Lodz"),
        ("Ærø, smørrebrød", "Aero-smorrebrod"),
        (" ../2/3__ ", "2-3"),
        ("…", ""),
        ("x²", "x2"),
    ],
)
def test_letters_with_marks_are_spelled_and_the_rest_becomes_hyphens(given: str, plain: str) -> None:
    assert plain_name(given) == plain


def test_both_ways_of_writing_an_umlaut_give_one_name() -> None:
    assert plain_name(unicodedata.normalize("NFD", "Nächte")) == plain_name("Nächte") == "Naechte"


def test_punctuation_that_may_stay_stays_within() -> None:
    assert plain_name("_my_net.v2.", also="_.") == "my_net.v2"


def test_names_that_differ_in_letters_of_other_scripts_differ() -> None:
    names = {plain_name(f"net {letters}") for letters in ("東京", "京都", "Москва", "Минск")}
    assert len(names) == 4
    assert all(name.isascii() and name.startswith("net-") for name in names)


def test_a_long_name_is_cut_and_keeps_what_tells_it_apart() -> None:
    assert plain_name("a" * 99, longest=60) == "a" * 60
    one, other = plain_name("東" + "a" * 99, longest=20), plain_name("京" + "a" * 99, longest=20)
    assert len(one) == len(other) == 20
    assert one != other


def test_half_a_surrogate_pair_does_not_stop_it() -> None:
    assert plain_name("a\ud800b") == "a-b"


def test_spellings_of_one_package_are_one_name() -> None:
    assert {package_name(text) for text in ("My_Package", "my-package", " my.package ", "MY--Package")} == {
        "my-package"
    }
