"""Execute examples/notebook.ipynb on a server of its own, and render it as docs/notebook.md: ``make notebook``.

The notebook keeps its outputs; the page and its pictures follow from them alone.
"""

from __future__ import annotations

import base64
import os
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

import nbformat
from nbclient import NotebookClient
from nbformat import NotebookNode

from valerie.embedded import running
from valerie.embedded.supervisor import Supervisor
from valerie.settings import load_settings

ROOT: Final = Path(__file__).parents[1]
NOTEBOOK: Final = ROOT / "examples" / "notebook.ipynb"
PAGE: Final = ROOT / "docs" / "notebook.md"
#: Where the page finds its pictures, beside it.
PICTURES: Final = Path("images")
_FORMAT: Final = 4


def read() -> NotebookNode:
    """Return the notebook with its outputs."""
    return nbformat.read(NOTEBOOK, _FORMAT)


def execute(notebook: NotebookNode, data_dir: Path) -> None:
    """Run all cells beside a server on a data folder, and keep their outputs.

    Raises:
        nbclient.exceptions.CellExecutionError: a cell fails.
    """
    settings = load_settings({}, data_dir=data_dir, api_port=0)
    lock = running.Lock(settings.data_dir)
    assert lock.take()
    with Supervisor(settings, lock):
        environment = {**os.environ, "VALERIE_DATA_DIR": str(settings.data_dir)}
        client = NotebookClient(notebook, timeout=600, record_timing=False)
        client.execute(env=environment, cwd=str(data_dir))
    for cell in notebook.cells:
        for output in cell.get("outputs", ()):
            output.get("data", {}).pop("image/jpeg", None)  # the PNG beside it is enough


def page(notebook: NotebookNode) -> tuple[str, dict[str, bytes]]:
    """Return the notebook as Markdown, and the PNG files that it shows, by name."""
    parts = ["<!-- Made from examples/notebook.ipynb by `make notebook`. -->"]
    pictures: dict[str, bytes] = {}
    for cell in notebook.cells:
        if cell.cell_type == "markdown":
            parts.append(cell.source)
            continue
        parts.append(f"```python\n{cell.source}\n```")
        for output in cell.outputs:
            if output.output_type == "stream":
                parts.append(f"```text\n{output.text.rstrip()}\n```")
            elif "image/png" in output.data:
                name = f"notebook-{len(pictures) + 1}.png"
                pictures[name] = base64.b64decode(output.data["image/png"])
                parts.append(f"![Output of the cell above]({PICTURES / name})")
            else:
                parts.append(f"```text\n{output.data['text/plain']}\n```")
    return "\n\n".join(parts) + "\n", pictures


def main() -> None:
    """Execute the notebook, and write it, its page and its pictures."""
    notebook = read()
    with TemporaryDirectory(prefix="valerie-notebook-") as folder:
        execute(notebook, Path(folder))
    nbformat.write(notebook, NOTEBOOK)
    text, pictures = page(notebook)
    PAGE.write_text(text, "utf-8")
    for name, content in pictures.items():
        (PAGE.parent / PICTURES / name).write_bytes(content)


if __name__ == "__main__":
    main()
