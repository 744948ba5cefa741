import pytest

from valerie.analysis.html import Html, data_url, join, tag


def test_text_is_escaped_and_markup_is_not():
    assert tag("td", "a < b & c", tag("b", "<x>")) == "<td>a &lt; b &amp; c<b>&lt;x&gt;</b></td>"


def test_attributes_are_quoted_renamed_and_left_out_when_empty():
    made = tag("a", "x", class_="k", aria_label='say "hi"', hidden=True, title=None, draggable=False)
    assert made == '<a class="k" aria-label="say &quot;hi&quot;" hidden>x</a>'


def test_void_elements_are_not_closed():
    assert tag("img", src="data:,", alt="") == '<img src="data:," alt="">'


def test_iterables_and_nothing_are_joined():
    assert join("a", None, [Html("<br>"), "b"]) == "a<br>b"


def test_a_per_cent_sign_stays_with_its_number():
    assert join("95 %") == "95\u00a0%"


@pytest.mark.parametrize(
    ("start", "kind"), [(b"\x89PNG\r\n", "png"), (b"\xff\xd8\xff\xe0", "jpeg"), (b"RIFF0000WEBPVP8 ", "webp")]
)
def test_a_picture_states_its_type(start, kind):
    assert data_url(start).startswith(f"data:image/{kind};base64,")
