"""Names of frames."""

import pytest

from valerie.errors import InvalidInput
from valerie.runs.products.frame_keys import FrameKey


def test_a_frame_id_names_run_variant_camera_and_time() -> None:
    assert str(FrameKey("0192-ab_c", 12, 3, 4)) == "0192-ab_c.12.3.4"


def test_reading_a_frame_id_gives_the_key_that_wrote_it() -> None:
    key = FrameKey("run-1", 10**17, 0, 250)
    assert FrameKey.parse(str(key)) == key


def test_keys_sort_by_number_and_not_by_text() -> None:
    assert FrameKey("r", 2, 0) < FrameKey("r", 10, 0) < FrameKey("r", 10, 0, 1) < FrameKey("r", 10, 1)


@pytest.mark.parametrize(
    "text", ["", "run", "run.1.2", "run.1.2.3.4", "run.a.0.0", "run.-1.0.0", ".1.0.0", "run.1.0.0\n"]
)
def test_anything_else_is_refused_with_the_form_of_a_frame_id(text: str) -> None:
    with pytest.raises(InvalidInput, match=r"run\.variant\.camera\.time"):
        FrameKey.parse(text)
