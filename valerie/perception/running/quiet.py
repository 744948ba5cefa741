"""Nothing is ever sent out: libraries that report their use, or fetch from a network, are told not to before they load."""

from __future__ import annotations

import os
import sys
from typing import Final

_VARIABLES: Final = {
    # onnxruntime's Linux builds upload events from 1.29 on; only this, before its first import, stops all of them.
    "ORT_DISABLE_TELEMETRY": "1",
    # The hub's client asks the network even for local folders, unless it is told to be offline.
    "HF_HUB_OFFLINE": "1",
    "HF_HUB_DISABLE_TELEMETRY": "1",
    "TRANSFORMERS_OFFLINE": "1",
    "DO_NOT_TRACK": "1",
}


def silence_libraries() -> None:
    """Call before onnxruntime, openvino or transformers are imported; safe to call again."""
    os.environ.update(_VARIABLES)
    # OpenVINO imports this package where it is installed, and has a stand-in for where it is not.
    sys.modules.setdefault("openvino_telemetry", None)  # type: ignore[arg-type]  # None: importing it fails
