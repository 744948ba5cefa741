"""Settings that keep libraries from reporting their use and from fetching files."""

from __future__ import annotations

import os
import sys
from typing import Final

_VARIABLES: Final = {
    # onnxruntime's Linux builds upload events from 1.29 on; only this, before its first import, stops all of them.
    "ORT_DISABLE_TELEMETRY": "1",
    # The hub's client asks the network even for local folders, unless it is offline.
    "HF_HUB_OFFLINE": "1",
    "HF_HUB_DISABLE_TELEMETRY": "1",
    "TRANSFORMERS_OFFLINE": "1",
    "DO_NOT_TRACK": "1",
}


def silence_libraries() -> None:
    """Set the variables that onnxruntime, openvino and transformers read. Call this before importing them."""
    os.environ.update(_VARIABLES)
    # OpenVINO imports this package if it is installed, and uses a stand-in otherwise.
    sys.modules.setdefault("openvino_telemetry", None)  # type: ignore[arg-type]  # None: importing it fails
