"""Drafts: a change made in the text says the same as the change made in the document, and comments stay."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.shipped import SPECS
from valerie.errors import InvalidInput
from valerie.loading import load_document
from valerie.runs.document.draft import FieldChange, ParameterChange, changed_draft, draft_of, read_draft
from valerie.runs.resolving.spec import parse

COMMENTED = """\
# Who wrote this
name: first   # a name
asset: urban-street

vary:         # the parameters
  sun-1.azimuth: {choice: [140 deg, 260 deg]}  # left and right
  person-1.pos.x:
    homogeneous:
      from: 1 m   # near
      to: 5 m
      step: 1 m
  # the last one
  person-1.pos.y: {uniform: {from: 5, to: 20,
                             count: 3}}

constants:
  sun-1.elevation: 35 deg

functions: [a, b]  # both
"""
X = {"distribution": "HOMOGENEOUS", "minimum": "2 m", "maximum": "8 m", "step": "2 m"}
TEXTS = st.text(st.characters(codec="utf-8", exclude_characters="\0"), max_size=12)
SCALARS = st.one_of(st.booleans(), st.integers(-(10**9), 10**9), st.floats(-1e9, 1e9), TEXTS)
VALUES = st.recursive(
    SCALARS,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(TEXTS, inner, max_size=3),
    max_leaves=6,
)


def field(name: str, value: Any) -> FieldChange:
    return FieldChange(field=name, value=value)


def varied(name: str, vary: dict[str, Any] | None = None, constant: Any = None) -> ParameterChange:
    return ParameterChange(parameter=name, vary=vary, constant=constant)


@pytest.mark.parametrize("path", SPECS, ids=lambda path: path.stem)
def test_a_spec_written_as_a_draft_reads_back_as_an_equal_spec(path: Path) -> None:
    spec = parse(path.read_bytes())
    again = parse(draft_of(spec))
    assert again == spec
    assert again.digest == spec.digest


def test_a_draft_says_that_a_sensor_does_not_meter() -> None:
    spec = parse({"name": "one", "asset": "urban-street", "sensors": [{"auto_exposure": False}]})
    assert load_document(draft_of(spec))["sensors"] == [{"auto_exposure": False}]


@pytest.mark.parametrize("path", SPECS, ids=lambda path: path.stem)
@pytest.mark.parametrize("value", ["other", None])
def test_a_changed_field_is_the_only_change_of_an_example(path: Path, value: str | None) -> None:
    text = path.read_text()
    document = load_document(text)
    expected = {key: one for key, one in document.items() if key != "description"}
    if value is not None:
        expected["description"] = value
    assert load_document(changed_draft(text, [field("description", value)])) == expected


@given(VALUES, st.sampled_from([COMMENTED, '{"name": "n", "asset": "a"}', "asset: a\n", "name: n"]))
def test_any_value_reads_back_as_itself(value: Any, text: str) -> None:
    changed = load_document(changed_draft(text, [field("description", value)]))
    assert changed == {**load_document(text), "description": value}


def test_comments_outside_of_a_change_stay() -> None:
    changed = changed_draft(
        COMMENTED, [field("name", "second"), varied("person-1.pos.x", X), varied("sun-1.elevation", constant=20)]
    )
    assert changed == COMMENTED.replace("name: first ", "name: second ").replace(
        """person-1.pos.x:
    homogeneous:
      from: 1 m   # near
      to: 5 m
      step: 1 m
""",
        "person-1.pos.x: {homogeneous: {from: 2 m, to: 8 m, step: 2 m}}\n",
    ).replace("elevation: 35 deg", "elevation: 20")


def test_a_parameter_is_added_made_constant_and_left_at_its_default() -> None:
    added = changed_draft(COMMENTED, [varied("person-1.heading", {"distribution": "CHOICE", "values": [0, 90]})])
    assert "                             count: 3}}\n  person-1.heading: {choice: [0, 90]}\n\nconstants:" in added
    constant = changed_draft(added, [varied("person-1.heading", constant=45)])
    assert load_document(constant)["constants"] == {"sun-1.elevation": "35 deg", "person-1.heading": 45}
    assert "person-1.heading" not in load_document(constant)["vary"]
    assert changed_draft(constant, [varied("person-1.heading")]) == COMMENTED


def test_the_last_parameter_takes_its_heading_with_it_and_the_first_brings_it() -> None:
    text = "name: n\nasset: a\nfunctions: [f]\n"
    constant = changed_draft(text, [varied("p", constant="1.5 m")])
    assert constant == "name: n\nasset: a\nconstants:\n  p: 1.5 m\nfunctions: [f]\n"
    assert changed_draft(constant, [varied("p")]) == text


@pytest.mark.parametrize(
    "vary",
    [
        "[[p, HOMOGENEOUS, 1, 5, 1], [q, CHOICE, 1, 2]]",
        "\n  - [p, HOMOGENEOUS, 1, 5, 1]\n  - {q: {choice: [1, 2]}}",
        "{p: {homogeneous: {from: 1, to: 5, step: 1}}, q: {choice: [1, 2]}}",
        "\n  p: {homogeneous: {from: 1, to: 5, step: 1}}\n  q: {choice: [1, 2]}",
        "\n- parameter: p\n  distribution: HOMOGENEOUS\n  minimum: 1\n  maximum: 5\n  step: 1\n- [q, CHOICE, 1, 2]",
    ],
)
@pytest.mark.parametrize("change", [varied("p", X), varied("p"), varied("q", X), varied("new", X)])
def test_a_change_of_a_parameter_means_the_same_in_every_notation(vary: str, change: ParameterChange) -> None:
    text = f"name: n\nasset: a\nvary: {vary}\nseed: 3\n"
    entries = {str(entry.document["parameter"]): entry.document for entry in read_draft(text).vary}
    assert list(entries) == ["p", "q"]
    if change.vary is None:
        del entries[change.parameter]
    else:
        entries[change.parameter] = {"parameter": change.parameter, **change.vary}
    after = read_draft(changed_draft(text, [change]))
    assert [entry.document for entry in after.vary] == list(entries.values())
    assert (after.fields["name"], after.fields["seed"]) == ("n", 3)


def test_every_place_has_its_line() -> None:
    lines = read_draft(COMMENTED).lines
    rows = COMMENTED.splitlines()
    places = {
        "name": "name:",
        "vary.sun-1.azimuth": "sun-1.azimuth:",
        "vary.person-1.pos.x.homogeneous.step": "step:",
        "constants.sun-1.elevation": "sun-1.elevation:",
        "functions.1": "functions:",
    }
    for place, start in places.items():
        assert rows[lines[place] - 1].lstrip().startswith(start)


def test_the_places_of_parameters_are_those_that_problems_name() -> None:
    draft = "name: n\nasset: a\nvary:\n  p: {homogeneous: {from: 1, to: 5, step: 0}}\n"
    assert [entry.place for entry in read_draft(draft).vary] == ["vary.p"]
    assert read_draft(draft).lines["vary.p"] == 4


def test_a_run_of_several_blocks_is_not_edited_by_parameter() -> None:
    text = "name: n\nasset: a\nblocks: [{vary: [[p, CHOICE, 1]]}, {}]\n"
    assert read_draft(text).several_blocks
    with pytest.raises(InvalidInput, match="several blocks"):
        changed_draft(text, [varied("p", X)])


@pytest.mark.parametrize("text", ["", "- a\n", "name: [", "a: 1\na: 2\n", "name: &x n\nb: *x\n"])
def test_a_text_that_is_no_document_is_refused(text: str) -> None:
    with pytest.raises(InvalidInput):
        read_draft(text)
