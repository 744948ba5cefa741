"""Fill an origin's network by the recipe, and compare or keep its logits; shared by the scripts of this folder.

Each script takes the folder of an unpacked checkout of the origin's code and imports that code unchanged, and nothing from
``valerie``. Without ``--write`` it compares with the kept references, and exits with 1 if one differs.
"""

import argparse
import json
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec
from importlib.metadata import version
from pathlib import Path
from types import ModuleType
from typing import Any, Final

import numpy as np
import torch
from torch import nn

from tools.references import recipe

#: Tolerance for logits: other versions of torch and other processors round the same sums differently.
TOLERANCE: Final = 2e-5

Shapes = dict[str, list[int]]
#: (1, 3, 64, 96) picture to (1, classes, 64, 96) logits.
Forward = Callable[[torch.Tensor], torch.Tensor]
#: The module whose tensors are filled, and its forward function.
Built = tuple[nn.Module, Forward]


@dataclass(frozen=True, slots=True)
class Origin:
    """Third-party code: its source, and the packages that affect the result."""

    script: str
    source: str
    commit: str
    made: str
    packages: tuple[str, ...] = ("torch",)
    #: Prefixes of tensors that the network under test does not have: heads used only in training.
    unused: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Case:
    """One reference: its file's name, VALERIE's name of the network, and the origin's builder."""

    name: str
    layout: str
    file: str
    settings: Mapping[str, Any]
    build: Callable[[], Built]
    architecture: str = ""
    #: Whether the list of all tensors is kept, or only its digest.
    whole: bool = False


class StandIns(MetaPathFinder, Loader):
    """Stand-ins for compiled modules that the origin imports and these networks do not use: every name is an empty class.

    A network that used one would fail: an empty class takes no arguments and computes nothing.
    """

    def __init__(self, names: Sequence[str], attributes: Mapping[str, str] | None = None) -> None:
        self.names, self.attributes = tuple(names), attributes or {}

    def find_spec(self, fullname: str, path: object = None, target: object = None) -> ModuleSpec | None:  # noqa: ARG002
        ours = any(fullname == name or fullname.startswith(f"{name}.") for name in self.names)
        return ModuleSpec(fullname, self, is_package=True) if ours else None

    def create_module(self, spec: ModuleSpec) -> ModuleType:
        return _Empty(spec.name)

    def exec_module(self, module: ModuleType) -> None:
        if module.__name__ in self.names:
            vars(module).update(self.attributes)


class _Empty(ModuleType):
    def __getattr__(self, name: str) -> type:
        if name.startswith("__"):
            raise AttributeError(name)
        return type(name, (), {})


def filled(model: nn.Module) -> Shapes:
    """Set every tensor of ``model`` to the recipe's values; return names and shapes in the model's order."""
    shapes = {name: list(value.shape) for name, value in model.state_dict().items()}
    model.load_state_dict(
        {
            name: torch.tensor(0)
            if name.endswith("num_batches_tracked")
            else torch.from_numpy(recipe.tensor(name, shape))
            for name, shape in shapes.items()
        }
    )
    model.eval()
    return shapes


def reference_of(origin: Origin, case: Case) -> dict[str, Any]:
    """Compute the reference of ``case`` with the origin's code, in the form of its file."""
    model, forward = case.build()
    shapes = filled(model)
    with torch.inference_mode():
        logits = forward(torch.from_numpy(recipe.picture())).numpy()
    if logits.shape[2:] != (64, 96) or not np.isfinite(logits).all():
        raise SystemExit(f"{case.name}: no finite logits at the picture's size; got {logits.shape}")
    weights = {
        name: shape
        for name, shape in shapes.items()
        if not name.endswith("num_batches_tracked") and not name.startswith(origin.unused)
    }
    reference = {
        "architecture": case.architecture or case.name,
        "layout": case.layout,
        "source": origin.source,
        "commit": origin.commit,
        "file": case.file,
        "settings": dict(case.settings),
        "script": origin.script,
        "packages": {name: version(name).partition("+")[0] for name in origin.packages},
        "made": origin.made,
        "logits_standard_deviation": round(float(logits.std()), 3),
        "weights_sha256": recipe.digest(weights),
        "keys_sha256": recipe.digest(shapes),
        "logits": [[[round(float(x), 6) for x in row] for row in each] for each in recipe.sampled(logits)],
    }
    return reference | ({"keys": shapes} if case.whole else {})


def text_of(reference: Mapping[str, Any]) -> str:
    """Return the text of a reference's file: a line for each class and each tensor."""
    lists = {"logits": ("[]", _lines(reference["logits"]))}
    if "keys" in reference:
        lists["keys"] = ("{}", (f"{json.dumps(key)}: {_short(shape)}" for key, shape in reference["keys"].items()))
    head = json.dumps(
        {key: value for key, value in reference.items() if key not in lists}, indent=1, ensure_ascii=False
    )
    tail = (
        f' "{key}": {brackets[0]}\n' + ",\n".join(f"  {line}" for line in lines) + f"\n {brackets[1]}"
        for key, (brackets, lines) in lists.items()
    )
    return head[:-2] + ",\n" + ",\n".join(tail) + "\n}\n"


def _lines(logits: Sequence[object]) -> Iterator[str]:
    return (_short(each) for each in logits)


def _short(value: object) -> str:
    return json.dumps(value, separators=(",", ":"))


def difference(kept: Mapping[str, Any], now: Mapping[str, Any]) -> tuple[float, list[str]]:
    """Return the largest difference of a logit, and the other entries that differ, except package versions."""
    entries = (kept.keys() | now.keys()) - {"logits", "logits_standard_deviation", "packages"}
    differing = sorted(entry for entry in entries if kept.get(entry) != now.get(entry))
    return float(np.abs(np.subtract(kept["logits"], now["logits"])).max()), differing


def main(origin: Origin, cases_of: Callable[[Path], Sequence[Case]], folder: Path = recipe.KEPT) -> int:
    """Compare or write the references of one origin; return 1 if one differs.

    Args:
        origin: the code.
        cases_of: returns the references to make, for the folder of the checkout.
        folder: folder of the kept references.
    """
    parser = argparse.ArgumentParser(description=f"Reference logits by the code of {origin.source}.")
    parser.add_argument("checkout", type=Path, help=f"folder of that code, unpacked, at commit {origin.commit}")
    parser.add_argument("--only", action="append", metavar="NAME", help="one reference; may be given again")
    parser.add_argument("--write", action="store_true", help="write the references instead of comparing with them")
    arguments = parser.parse_args()
    checkout = arguments.checkout.resolve()
    print(f"{origin.source}: {_commit_in_words(checkout, origin.commit)}")
    sys.path.insert(0, str(checkout))
    worst = 0
    for case in cases_of(checkout):
        if arguments.only and case.name not in arguments.only:
            continue
        now, path = reference_of(origin, case), folder / f"{case.name}.json"
        if arguments.write:
            path.write_text(text_of(now))
            print(f"{case.name}: written")
            continue
        largest, differing = difference(json.loads(path.read_text()), now)
        same = largest <= TOLERANCE and not differing
        worst |= not same
        others = f"; other entries that differ: {', '.join(differing)}" if differing else ""
        print(f"{case.name}: {'same' if same else 'DIFFERS'}, largest difference of a logit {largest:.1e}{others}")
    return worst


def _commit_in_words(checkout: Path, commit: str) -> str:
    if not (checkout / ".git").exists():
        return f"{checkout} has no history: commit {commit} is not verified"
    head = subprocess.run(["git", "-C", checkout, "rev-parse", "HEAD"], check=True, capture_output=True, text=True)
    if head.stdout.strip() != commit:
        raise SystemExit(f"{checkout}: another commit; got {head.stdout.strip()}; limit: {commit}")
    return f"commit {commit}"
