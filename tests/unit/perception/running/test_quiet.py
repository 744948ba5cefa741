"""No library that runs networks sends anything, or keeps what it would send."""

import os
import subprocess
import sys
from pathlib import Path

from valerie.perception.shipped import function_path

PROGRAM = """
import sys
asked = []
def watch(event, arguments):
    if event in ("socket.connect", "socket.getaddrinfo", "socket.gethostbyname", "socket.sendto"):
        asked.append((event, arguments[1:]))
sys.addaudithook(watch)
import numpy as np
from pathlib import Path
from valerie.perception.shipped import file_document
from valerie.perception.running.opening import open_function
path = Path(sys.argv[1])
for engine in ("openvino", "onnxruntime"):
    document = file_document("f", path).model_copy(update={"engine": engine})
    function = open_function(document, path)
    function.predict(np.zeros((32, 32, 3), np.uint8))
    function.close()
print(asked, [name for name in sys.modules if name.startswith("openvino_telemetry.")])
import os
links = [f"/proc/self/fd/{name}" for name in os.listdir("/proc/self/fd")]
print([link for link in links if os.path.islink(link) and "socket" in os.readlink(link)])
"""


def test_engines_open_no_connection_and_keep_no_events(tmp_path: Path) -> None:
    environment = {name: value for name, value in os.environ.items() if not name.startswith(("ORT_", "HF_", "CI"))}
    environment |= {"HOME": str(tmp_path), "XDG_CACHE_HOME": str(tmp_path / "cache")}
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM, str(function_path("semantic-fpn-small"))],
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
        env=environment,
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout == "[] []\n[]\n"
    # onnxruntime would keep its events in a database below the home folder.
    assert [path for path in tmp_path.rglob("*") if "onnxruntime" in str(path) or "Microsoft" in str(path)] == []


def test_the_hubs_client_stays_offline() -> None:
    program = (
        "import os; from valerie.perception.running.quiet import silence_libraries; silence_libraries();"
        "import huggingface_hub.constants as c; print(c.HF_HUB_OFFLINE, c.HF_HUB_DISABLE_TELEMETRY)"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60, check=True)
    assert done.stdout == "True True\n"
