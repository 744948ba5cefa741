"""The example of docs/guided.md runs as it stands."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

DOCUMENT = Path(__file__).parents[3] / "docs" / "guided.md"


def test_the_example_names_the_cause_and_holds_the_rate() -> None:
    names: dict[str, Any] = {}
    for block in re.findall(r"```python\n(.*?)```", DOCUMENT.read_text("utf-8"), re.DOTALL):
        exec(block, names)
    assert [names["domain"].names[dimension] for dimension in names["pair"].changed] == ["person-1.pos.y"]
    assert 20 < names["domain"].values(names["pair"].failing)["scene.person-1.pos.y"] < 82
    rate = names["rate"]
    assert rate.assumption_free.low < rate.assumption_free.high
    assert rate.evaluations == 512
