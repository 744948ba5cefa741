import json
from collections.abc import Callable
from types import ModuleType
from typing import Any

import pytest

from tools.references import recipe as weights_and_picture


@pytest.fixture(scope="session")
def recipe() -> ModuleType:
    """The weights (from names and shapes) and the picture with which the origins' own code made the references."""
    return weights_and_picture


@pytest.fixture(scope="session")
def reference() -> Callable[[str], dict[str, Any]]:
    """Returns a file of ``fixtures/checkpoints`` by its name without suffix."""
    return lambda name: json.loads((weights_and_picture.KEPT / f"{name}.json").read_text())
