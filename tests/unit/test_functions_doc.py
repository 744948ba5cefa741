"""docs/functions.md: its documents are documents, and its recipe for exporting leads to a function that runs."""

import re
import sys
import types
import warnings
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from valerie.perception.documents.function import PAYLOADS, parse_function
from valerie.perception.running.opening import open_function

TEXT = (Path(__file__).parents[2] / "docs" / "functions.md").read_text("utf-8")
DOCUMENTS = re.findall(r"```yaml\n(.*?)```", TEXT, re.DOTALL)


@pytest.mark.parametrize("text", DOCUMENTS, ids=lambda text: text.split()[1])
def test_every_document_of_the_page_is_accepted(text: str) -> None:
    kind = re.findall(r"kind: (\w+)", text)[0]
    payload = {"sha256": "0" * 64, "bytes": 1, "format": PAYLOADS[kind]} if kind in PAYLOADS else None
    assert "person" in parse_function(text, payload=payload).output.reached


class FullSize(torch.nn.Module):
    """Logits at the picture's own size, as that library's networks give them."""

    def __init__(self, classes: int) -> None:
        super().__init__()
        self.encoder = torch.nn.Conv2d(3, 8, 5, stride=4, padding=2)
        self.head = torch.nn.Conv2d(8, classes, 1)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        small = self.head(torch.relu(self.encoder(x)))
        return torch.nn.functional.interpolate(small, scale_factor=4.0, mode="bilinear", align_corners=False)


def test_the_recipe_leads_to_a_function_that_computes_what_the_network_does(tmp_path, monkeypatch) -> None:
    torch.manual_seed(3)
    model = FullSize(19).eval()
    library: Any = types.ModuleType("segmentation_models_pytorch")
    library.DeepLabV3Plus = lambda *_, classes, **__: model if classes == 19 else None
    monkeypatch.setitem(sys.modules, "segmentation_models_pytorch", library)
    monkeypatch.chdir(tmp_path)
    (recipe,) = re.findall(r"```python\n(import segmentation_models_pytorch.*?)```", TEXT, re.DOTALL)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # torch would like its newer exporter, which writes two files
        exec(recipe, {})
    data = Path("network.onnx").read_bytes()
    (sidecar,) = [text for text in DOCUMENTS if "smp-deeplabv3plus" in text]
    payload = {"sha256": sha256(data).hexdigest(), "bytes": len(data), "format": "onnx"}
    function = open_function(parse_function(sidecar, payload=payload), Path("network.onnx"))
    picture = np.random.default_rng(0).integers(0, 256, (64, 96, 3), dtype=np.uint8)
    mean, std = torch.tensor([0.485, 0.456, 0.406]), torch.tensor([0.229, 0.224, 0.225])
    values = (torch.from_numpy(picture).float() / 255 - mean) / std
    with torch.inference_mode():
        expected = model(values.permute(2, 0, 1)[None]).argmax(1)[0].numpy()
    assert (function.predict(picture) == expected).mean() > 0.999
    function.close()
