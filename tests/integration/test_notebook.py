"""The example notebook: it runs, and its page is made from it."""

from __future__ import annotations

from pathlib import Path

import pytest

from tools import notebook


def test_the_page_of_the_notebook_is_made_from_it() -> None:
    text, pictures = notebook.page(notebook.read())
    assert notebook.PAGE.read_text("utf-8") == text, "run: make notebook"
    assert pictures
    for name, content in pictures.items():
        assert (notebook.PAGE.parent / notebook.PICTURES / name).read_bytes() == content, "run: make notebook"


@pytest.mark.processes
@pytest.mark.gl
def test_the_notebook_runs_and_shows_what_its_page_shows(tmp_path: Path) -> None:
    executed = notebook.read()
    kept, _ = notebook.page(executed)
    for cell in executed.cells:
        cell.outputs = []
    notebook.execute(executed, tmp_path / "data")
    text, pictures = notebook.page(executed)
    assert len(pictures) == 1
    assert "32 variants, 24 frames, 48 evaluations" in text
    assert "'completed'" in text
    # Scores differ in last digits between processors; what is counted does not.
    assert [line for line in kept.splitlines() if "```" in line] == [
        line for line in text.splitlines() if "```" in line
    ]
