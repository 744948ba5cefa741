"""The scripts that make references, on an origin of a few lines."""

import json
import subprocess
import sys
from collections.abc import Callable, Iterator
from importlib import import_module
from pathlib import Path

import pytest
import torch

from tools.references import recipe
from tools.references.making import Case, Origin, StandIns, main

CODE = """
import torch

class Net(torch.nn.Module):
    def __init__(self):
        super().__init__()
        self.conv, self.norm = torch.nn.Conv2d(3, 2, 1, bias=False), torch.nn.BatchNorm2d(2)

    def forward(self, picture):
        return self.norm(self.conv(picture))
"""
ORIGIN = Origin("tools/references/few.py", "example.org/few", "0" * 40, "By hand.", unused=("norm.",))


@pytest.fixture
def checkout(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """Code of an origin, importable as ``few_lines`` once its folder is given."""
    monkeypatch.setattr(sys, "path", list(sys.path))
    (tmp_path / "code").mkdir()
    (tmp_path / "code" / "few_lines.py").write_text(CODE)
    yield tmp_path / "code"
    sys.modules.pop("few_lines", None)


@pytest.fixture
def made(checkout: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., int]:
    def built() -> tuple[torch.nn.Module, torch.nn.Module]:
        model = import_module("few_lines").Net()
        return model, model

    def run(*options: str) -> int:
        case = Case("few", "few", "few_lines.py", {"width": 2}, built, whole=True)
        monkeypatch.setattr(sys, "argv", ["few", str(checkout), *options])
        return main(ORIGIN, lambda _: [case], checkout.parent)

    return run


def test_a_script_writes_what_the_code_computes_from_the_recipe(made, checkout: Path) -> None:
    assert made("--write") == 0
    document = json.loads((checkout.parent / "few.json").read_text())
    assert document["keys"]["conv.weight"] == [2, 3, 1, 1]
    assert document["weights_sha256"] == recipe.digest({"conv.weight": [2, 3, 1, 1]}) != document["keys_sha256"]
    scale, mean = (recipe.tensor(name, [2])[1] for name in ("norm.weight", "norm.running_mean"))
    shift, variance = (recipe.tensor(name, [2])[1] for name in ("norm.bias", "norm.running_var"))
    point = recipe.tensor("conv.weight", [2, 3, 1, 1])[1, :, 0, 0] @ recipe.picture()[0, :, 19, 37]
    assert document["logits"][1][1][2] == pytest.approx(
        (point - mean) / (variance + 1e-5) ** 0.5 * scale + shift, abs=1e-5
    )


def test_a_reference_that_the_code_reproduces_is_the_same(made, capsys: pytest.CaptureFixture[str]) -> None:
    made("--write")
    assert made() == 0
    assert "few: same" in capsys.readouterr().out


def test_a_logit_or_a_setting_that_differs_is_named(made, checkout: Path, capsys: pytest.CaptureFixture[str]) -> None:
    made("--write")
    path = checkout.parent / "few.json"
    document = json.loads(path.read_text())
    document["logits"][0][0][0] += 0.01
    document["settings"] = {"width": 3}
    path.write_text(json.dumps(document))
    assert made() == 1
    assert "few: DIFFERS, largest difference of a logit 1.0e-02; other entries that differ: settings" in (
        capsys.readouterr().out
    )


def test_a_checkout_of_another_commit_is_refused(made, checkout: Path) -> None:
    git = ["git", "-C", str(checkout), "-c", "user.name=a", "-c", "user.email=a@example.org"]
    subprocess.run([*git, "init", "--quiet"], check=True)
    subprocess.run([*git, "commit", "--quiet", "--allow-empty", "--message", "other"], check=True)
    with pytest.raises(SystemExit, match="another commit"):
        made()


def test_a_module_that_is_left_out_can_be_imported_and_computes_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "meta_path", [StandIns(["left_out"], {"__version__": "1.2"}), *sys.meta_path])
    operators = import_module("left_out.operators")
    assert import_module("left_out").__version__ == "1.2"
    with pytest.raises(TypeError):
        operators.pooling(3)
    for name in ("left_out", "left_out.operators"):
        sys.modules.pop(name)
