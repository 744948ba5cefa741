import json
from collections.abc import Callable
from types import ModuleType
from typing import Any

import pytest

from tools.references import recipe as weights_and_picture


@pytest.fixture(scope="session")
def recipe() -> ModuleType:
    """Weights from names and shapes, and the picture, as the origins' own code was given them."""
    return weights_and_picture


@pytest.fixture(scope="session")
def reference() -> Callable[[str], dict[str, Any]]:
    """A file of ``fixtures/checkpoints`` by its name without ending."""
    return lambda name: json.loads((weights_and_picture.KEPT / f"{name}.json").read_text())
