from collections.abc import Iterator
from pathlib import Path

import pytest

from valerie.db.migrate import migrate
from valerie.perception.documents.function import parse_function
from valerie.pipeline.base.context import Context, open_context
from valerie.pipeline.control.planning import plan_run
from valerie.pipeline.functions import registry
from valerie.runs.resolving.spec import parse
from valerie.settings import load_settings


@pytest.fixture(scope="module")
def context(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Context]:
    folder: Path = tmp_path_factory.mktemp("data")
    opened = open_context(load_settings({}, data_dir=folder))
    migrate(opened.engine)
    stated = {
        "name": "from-elsewhere",
        "kind": "predictions",
        "trained_on": {"urban-street": "7", "Cityscapes": "train"},
    }
    registry.register(opened, parse_function(stated), None)
    yield opened
    opened.engine.dispose()


@pytest.mark.parametrize(
    ("seed", "warned"),
    [(0, []), (7, ["from-elsewhere"]), (999, []), (1100, ["deeplabv3plus-small", "semantic-fpn-small"])],
)
def test_a_plan_warns_of_functions_that_were_trained_on_the_site_of_the_run(
    context: Context, seed: int, warned: list[str]
) -> None:
    functions = ["deeplabv3plus-small", "from-elsewhere", "semantic-fpn-small"]
    spec = {
        "name": "seen",
        "asset": {"name": "urban-street", "seed": seed},
        "vary": {"person-1.pos.y": {"choice": [10, 20]}},
        "functions": functions,
    }
    warnings = [text for text in plan_run(context, parse(spec)).warnings if "trained" in text]
    assert [text.partition(" ")[0] for text in warnings] == warned
    assert all(f"was trained on site seed {seed} of urban-street" in text for text in warnings)
