from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[3]))

from sketch.fixtures import _logs, api, fresh, sketch  # noqa: F401  # fixtures
