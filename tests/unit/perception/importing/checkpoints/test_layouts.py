"""Our networks against the origins' own code: the same tensors, the same logits.

The references were made without our modules, by the scripts in ``tools/references``; each file says from which code, at which
commit, with which settings.
"""

import re
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
import torch
from torch.nn import functional

from valerie.perception.importing.checkpoints.checkpoint_files import StoredCheckpoint
from valerie.perception.importing.checkpoints.layouts import LAYOUTS, Layout
from valerie.perception.importing.checkpoints.network_conversion import ImportedNetwork, convert
from valerie.perception.importing.network_weights import filled_network, tensor_shapes
from valerie.perception.networks.architectures import ARCHITECTURES, NetworkSettings

ROOT = Path(__file__).parents[5]

#: References that hold the whole list of names and shapes, each with those that have the same tensors.
WHOLE = {
    "deeplabv3plus-r101": ["deeplabv3plus-r101-os8"],
    "deeplabv3plus-r101c-os8": ["deeplabv3plus-r101c-os8-aligned", "deeplabv3plus-r101c-os16"],
    "semantic-fpn-r101c": [],
    "deeplabv3plus-r103": [],
    "semantic-fpn-r101-gn": [],
}
#: References that hold the digest of that list.
OTHERS = {
    "deeplabv3plus-r50": ["deeplabv3plus-r50-os8"],
    "deeplabv3plus-r50c-os8": ["deeplabv3plus-r50c-os8-aligned"],
    "deeplabv3plus-r18c-os8": ["deeplabv3plus-r18c-os8-aligned"],
    "semantic-fpn-r50c": [],
    "semantic-fpn-r50-gn": [],
    "semantic-fpn-r101-gn-plain": [],
}


def layout_of(reference: Mapping[str, Any]) -> Layout:
    return next(layout for layout in LAYOUTS if layout.name == reference["layout"])


@pytest.fixture(scope="module")
def imported(recipe: ModuleType, reference: Callable[[str], dict[str, Any]]) -> Callable[[str], ImportedNetwork]:
    """The checkpoint of a reference, converted; the last one is kept, because others have the same tensors."""

    @lru_cache(maxsize=1)
    def convert_reference(name: str) -> ImportedNetwork:
        listed = reference(name)
        if "keys" in listed:
            shapes = {key: tuple(shape) for key, shape in listed["keys"].items()}
        else:
            layout = layout_of(listed)
            shapes = {layout.name_of(key): shape for key, shape in tensor_shapes(listed["architecture"]).items()}
        tensors = {
            key: np.array(0) if key.endswith("num_batches_tracked") else recipe.tensor(key, shape)
            for key, shape in shapes.items()
        }
        return convert(StoredCheckpoint(tensors, {}, "torch"), field=name)

    return convert_reference


def settings_of(reference: Mapping[str, Any]) -> NetworkSettings:
    settings = ARCHITECTURES[reference["architecture"]]
    crop = reference["settings"].get("INPUT.CROP.SIZE")
    # The reference was made for training crops of another size, so that the window is smaller than the small map.
    return settings if crop is None else replace(settings, pool_window=(crop[0] // 16, crop[1] // 16))


PAIRS = [(name, each) for groups in (WHOLE, OTHERS) for name, more in groups.items() for each in (name, *more)]


@pytest.mark.parametrize(("weights", "name"), PAIRS, ids=[name for _, name in PAIRS])
def test_logits_are_those_of_the_original_code(imported, reference, recipe, weights: str, name: str) -> None:
    listed = reference(name)
    network = filled_network(settings_of(listed), imported(weights).tensors)
    with torch.inference_mode():
        logits = network(torch.from_numpy(recipe.picture()))
        whole = functional.interpolate(logits, (64, 96), mode="bilinear", align_corners=network.align_corners)
    expected = np.array(listed["logits"])
    assert expected.shape == (19, 4, 6)
    assert expected.std() > 0.3  # or equality within 1e-4 would say little
    # Processors sum in other orders. Each of up to 60 layers may round a sum by one unit in the last place of its largest terms.
    rounding = 60 * np.finfo(np.float32).eps * np.abs(expected).max()
    np.testing.assert_allclose(recipe.sampled(whole.numpy()), expected, atol=max(1e-4, rounding), rtol=0)


@pytest.mark.parametrize("name", WHOLE)
def test_every_tensor_of_the_original_is_used_or_known_to_be_useless(reference, recipe, name: str) -> None:
    listed = reference(name)
    layout = layout_of(listed)
    ours = {layout.name_of(key): shape for key, shape in tensor_shapes(listed["architecture"]).items()}
    theirs = {
        key: tuple(shape)
        for key, shape in listed["keys"].items()
        if not key.startswith(layout.ignored) and not key.endswith("num_batches_tracked")
    }
    assert ours == theirs
    assert recipe.digest({key: tuple(shape) for key, shape in listed["keys"].items()}) == listed["keys_sha256"]


@pytest.mark.parametrize(
    "name", sorted(set(OTHERS) | {each for more in [*WHOLE.values(), *OTHERS.values()] for each in more})
)
def test_the_list_of_tensors_has_the_digest_of_the_original_list(reference, recipe, name: str) -> None:
    listed = reference(name)
    layout = layout_of(listed)
    ours = {layout.name_of(key): shape for key, shape in tensor_shapes(listed["architecture"]).items()}
    assert recipe.digest(ours) == listed["weights_sha256"]


def test_every_architecture_of_every_layout_has_a_reference(reference) -> None:
    proven = {(reference(name)["layout"], reference(name)["architecture"]) for _, name in PAIRS}
    # PointRend's coarse head and the plain one are the same module of the same code.
    proven |= {("detectron2 semantic FPN", each) for layout, each in proven if layout == "detectron2 PointRend"}
    assert proven >= {(layout.name, each) for layout in LAYOUTS for each in layout.architectures}


def test_another_architecture_with_the_same_tensors_gives_other_logits(imported, reference, recipe) -> None:
    network = filled_network("deeplabv3plus-r50-os8", imported("deeplabv3plus-r50").tensors)
    with torch.inference_mode():
        logits = network(torch.from_numpy(recipe.picture()))
        whole = functional.interpolate(logits, (64, 96), mode="bilinear", align_corners=False)
    assert np.abs(recipe.sampled(whole.numpy()) - np.array(reference("deeplabv3plus-r50")["logits"])).max() > 0.1


def test_a_reference_states_its_origin(reference) -> None:
    for _, name in PAIRS:
        listed = reference(name)
        assert all(listed[entry] for entry in ("source", "file", "made", "settings"))
        assert re.fullmatch("[0-9a-f]{40}", listed["commit"])
        assert (ROOT / listed["script"]).is_file()
        assert listed["packages"]["torch"]
