import json
import pickle
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
import torch

from valerie.errors import InvalidInput, UnknownName
from valerie.perception.documents.class_maps import CLASS_LISTS
from valerie.perception.documents.function import FunctionDocument, Payload
from valerie.perception.importing.checkpoints.checkpoint_files import StoredCheckpoint
from valerie.perception.importing.checkpoints.layouts import LAYOUTS
from valerie.perception.importing.checkpoints.network_conversion import convert, import_checkpoint
from valerie.perception.importing.function_file import read_header, read_tensors
from valerie.perception.importing.network_weights import filled_network, tensor_shapes
from valerie.perception.shipped import function_path

CITYSCAPES = CLASS_LISTS["cityscapes"]


@pytest.fixture(scope="module")
def made(recipe: ModuleType) -> Callable[..., dict[str, np.ndarray]]:
    """Tensors of an architecture by the names of a layout."""

    def make(layout: str, architecture: str, count: int = 19) -> dict[str, np.ndarray]:
        name_of = next(each for each in LAYOUTS if each.name == layout).name_of
        return {
            name_of(name): recipe.tensor(name_of(name), shape)
            for name, shape in tensor_shapes(architecture, count).items()
        }

    return make


@pytest.fixture(scope="module")
def vainf(made) -> dict[str, np.ndarray]:
    return made("VainF/DeepLabV3Plus-Pytorch", "deeplabv3plus-r50")


@pytest.fixture(scope="module")
def fpn(made) -> dict[str, np.ndarray]:
    return made("mmsegmentation semantic FPN", "semantic-fpn-r50c")


@pytest.fixture(scope="module")
def deeplab(made) -> dict[str, np.ndarray]:
    return made("mmsegmentation DeepLabV3+", "deeplabv3plus-r50c-os8")


@pytest.fixture(scope="module")
def detectron(made) -> dict[str, np.ndarray]:
    return made("detectron2 PointRend", "semantic-fpn-r50-gn")


def stored(tensors: dict[str, Any], **entries: object) -> StoredCheckpoint:
    return StoredCheckpoint(tensors, entries, "torch")


@pytest.mark.parametrize("zipped", [True, False])
def test_a_torch_file_becomes_a_network_with_its_weights(vainf, tmp_path: Path, zipped: bool) -> None:
    path = tmp_path / "best_deeplabv3plus_resnet50_cityscapes_os16.pth"
    weights = {name: torch.from_numpy(array) for name, array in vainf.items()}
    torch.save({"model_state": weights, "best_score": np.float64(0.7)}, path, _use_new_zipfile_serialization=zipped)
    imported = import_checkpoint(path)
    assert imported.architecture == "deeplabv3plus-r50"
    assert imported.classes == CITYSCAPES
    assert (imported.units.scale, imported.units.channel_order) == ("1/255", "rgb")
    assert imported.units.mean == (0.485, 0.456, 0.406)
    assert imported.provenance["layout"] == "VainF/DeepLabV3Plus-Pytorch"
    assert imported.provenance["source"] == path.name
    assert imported.provenance["checked"] == "logits"
    np.testing.assert_array_equal(imported.tensors["classifier.bias"], vainf["classifier.classifier.3.bias"])


def test_a_pickle_of_detectron2_becomes_a_network_for_blue_first(detectron, tmp_path: Path) -> None:
    path = tmp_path / "model_final.pkl"
    unused = {"sem_seg_head.point_head.fc1.weight": np.zeros((4, 4, 1), np.float32)}
    path.write_bytes(pickle.dumps({"model": detectron | unused, "__author__": "somebody"}))
    imported = import_checkpoint(path)
    assert imported.architecture == "semantic-fpn-r50-gn"
    assert imported.units.channel_order == "bgr"
    assert (imported.units.mean, imported.units.std) == ((103.53, 116.28, 123.675), (1.0, 1.0, 1.0))


def test_statistics_beside_the_weights_of_detectron2_are_taken(detectron) -> None:
    state = {
        "pixel_mean": np.array([[[1.5]], [[2.5]], [[123.675]]], np.float32),
        "pixel_std": np.full((3, 1, 1), 57.375, np.float32),
    }
    imported = convert(stored(detectron | state), field="f")
    assert imported.units.mean == (1.5, 2.5, 123.675)
    assert imported.units.std == (57.375,) * 3
    assert "normalisation" not in imported.provenance.get("assumed", "")


CONFIG = """
img_norm_cfg = dict(mean=[120.0, 110.0, 100.0], std=[60.0, 50.0, 40.0], to_rgb=True)
model = dict(
    type='EncoderDecoder',
    backbone=dict(type='ResNetV1c', depth=50, {backbone}),
    decode_head=dict(type='DepthwiseSeparableASPPHead', align_corners={aligned}))
"""


@pytest.mark.parametrize(
    ("aligned", "architecture"), [(False, "deeplabv3plus-r50c-os8"), (True, "deeplabv3plus-r50c-os8-aligned")]
)
def test_the_settings_in_a_file_of_mmsegmentation_decide(deeplab, aligned: bool, architecture: str) -> None:
    text = CONFIG.format(aligned=aligned, backbone="multi_grid=None")
    imported = convert(stored(deeplab, **{"meta.config": text, "meta.CLASSES": CITYSCAPES}), field="f")
    assert imported.architecture == architecture
    assert (imported.units.mean, imported.units.std) == ((120.0, 110.0, 100.0), (60.0, 50.0, 40.0))
    assert "assumed" not in imported.provenance


@pytest.mark.parametrize(
    ("backbone", "aligned", "match"),
    [
        ("multi_grid=(1, 2, 4)", "False", r"multi_grid=\(1, 2, 4\)"),
        ("contract_dilation=False", "False", "contract_dilation=False"),
        ("num_stages=4", "False, dilations=(1, 6, 12, 18)", r"decode_head\.dilations=\(1, 6, 12, 18\)"),
    ],
)
def test_settings_of_no_architecture_are_named(deeplab, backbone: str, aligned: str, match: str) -> None:
    text = CONFIG.format(aligned=aligned, backbone=backbone)
    with pytest.raises(InvalidInput, match=match):
        convert(stored(deeplab, **{"meta.cfg": text}), field="f")


def test_a_file_of_mmsegmentation_may_take_blue_first(fpn) -> None:
    text = "data_preprocessor = dict(mean=[1, 2, 3], std=[4, 5, 6], bgr_to_rgb=False)"
    units = convert(stored(fpn, **{"meta.cfg": text}), field="f").units
    assert (units.mean, units.std, units.channel_order) == ((1.0, 2.0, 3.0), (4.0, 5.0, 6.0), "bgr")


def test_settings_are_read_and_never_run(fpn, tmp_path: Path) -> None:
    mark = tmp_path / "mark"
    text = f"x = open({str(mark)!r}, 'w')\n__import__('os').system('touch {mark}')\nmodel = dict(a=1)"
    convert(stored(fpn, **{"meta.config": text}), field="f")
    assert not mark.exists()


def test_facts_that_the_file_does_not_state_are_listed_as_assumed(deeplab) -> None:
    assumed = convert(stored(deeplab), field="f").provenance["assumed"]
    assert "the tensors are also those of deeplabv3plus-r50c-os8-aligned" in assumed
    assert "classes: the 19 of Cityscapes" in assumed
    assert "normalisation" in assumed


def test_one_of_several_architectures_can_be_chosen(vainf) -> None:
    imported = convert(stored(vainf), field="f", architecture="deeplabv3plus-r50-os8")
    assert imported.architecture == "deeplabv3plus-r50-os8"
    assert "architecture" not in imported.provenance["assumed"]


def test_an_architecture_that_the_file_does_not_hold_is_refused_with_the_differing_tensors(vainf) -> None:
    with pytest.raises(InvalidInput, match=r"nearest is .*deeplabv3plus-r101, but backbone\.layer3\.6\.conv1\.weight"):
        convert(stored(vainf), field="f", architecture="deeplabv3plus-r101")
    with pytest.raises(InvalidInput, match="nearest"):
        convert(stored(vainf), field="f", architecture="semantic-fpn-r50-gn")
    with pytest.raises(InvalidInput, match="no layout has this architecture"):
        convert(stored(vainf), field="f", architecture="semantic-fpn-small")
    with pytest.raises(UnknownName, match="deeplabv3plus-r50"):
        convert(stored(vainf), field="f", architecture="deeplabv3plus-r52")


def test_other_classes_keep_their_number_and_the_files_names(made) -> None:
    tensors = made("mmsegmentation semantic FPN", "semantic-fpn-r50c", 3)
    assert convert(stored(tensors), field="f").classes == ("class-0", "class-1", "class-2")
    named = stored(tensors, **{"meta.dataset_meta.classes": ["a", "person", "c"]})
    assert convert(named, field="f").classes == ("a", "person", "c")
    assert convert(named, field="f", classes=["x", "y", "z"]).classes == ("x", "y", "z")
    with pytest.raises(InvalidInput, match="not one class per channel; got 2 classes; limit: 3"):
        convert(stored(tensors, **{"meta.CLASSES": ("a", "b")}), field="f")
    with pytest.raises(InvalidInput, match="not one class per channel"):
        convert(named, field="f", classes=["x"])


def test_a_missing_tensor_is_named_with_the_nearest_layout(fpn) -> None:
    fewer = {name: array for name, array in fpn.items() if name != "neck.fpn_convs.2.conv.bias"}
    with pytest.raises(
        InvalidInput,
        match=r"f: no known layout; the nearest is mmsegmentation semantic FPN, semantic-fpn-r50c, "
        r"but neck\.fpn_convs\.2\.conv\.bias is missing$",
    ):
        convert(stored(fewer), field="f")


def test_a_tensor_of_another_shape_and_an_unknown_one_are_named(fpn) -> None:
    odd = fpn | {"decode_head.conv_seg.bias": np.zeros(7, np.float32), "extra": np.zeros(1, np.float32)}
    with pytest.raises(
        InvalidInput, match=r"extra is unknown; decode_head\.conv_seg\.bias is \[7\] instead of \[19\]$"
    ):
        convert(stored(odd), field="f")


def test_something_else_is_refused_with_three_of_its_differences() -> None:
    with pytest.raises(InvalidInput, match=r"no known layout; the nearest is .*; and [0-9]+ more"):
        convert(stored({"encoder.weight": np.zeros((2, 2), np.float32)}), field="f")


def test_weights_that_are_not_finite_are_named(fpn) -> None:
    broken = fpn | {"decode_head.conv_seg.bias": np.full(19, np.nan, np.float32)}
    with pytest.raises(InvalidInput, match=r"decode_head\.conv_seg\.bias: holds values that are not finite"):
        convert(stored(broken), field="f")


def test_weights_of_whole_numbers_are_refused(fpn) -> None:
    with pytest.raises(InvalidInput, match=r"decode_head\.conv_seg\.bias: not floating point; got int64"):
        convert(stored(fpn | {"decode_head.conv_seg.bias": np.zeros(19, np.int64)}), field="f")


def test_weights_whose_logits_are_not_finite_fail_the_self_check(fpn) -> None:
    name = "backbone.layer4.0.bn3.weight"
    with pytest.raises(InvalidInput, match="does not give finite logits"):
        convert(stored(fpn | {name: np.full_like(fpn[name], 3e38)}), field="f")


def test_half_precision_is_kept_and_double_becomes_single(fpn) -> None:
    state = {name: array.astype(np.float16 if "neck" in name else np.float64) for name, array in fpn.items()}
    kinds = {name: array.dtype for name, array in convert(stored(state), field="f").tensors.items()}
    assert kinds["fpn.lateral.0.weight"] == np.float16
    assert kinds["predictor.weight"] == np.float32


def test_a_payload_comes_back_as_the_same_network(fpn, tmp_path: Path) -> None:
    path = tmp_path / "payload.safetensors"
    imported = convert(stored(fpn, **{"meta.CLASSES": CITYSCAPES}), field="fpn.pth")
    path.write_bytes(imported.payload())
    again = import_checkpoint(path)
    assert (again.architecture, again.classes, again.units) == (imported.architecture, imported.classes, imported.units)
    assert again.provenance == imported.provenance
    assert again.payload() == imported.payload()
    network = filled_network(again.architecture, read_tensors(path), len(again.classes))
    np.testing.assert_array_equal(network.state_dict()["predictor.weight"].numpy(), fpn["decode_head.conv_seg.weight"])


def test_a_function_file_of_our_own_is_taken_unchanged() -> None:
    path = function_path("semantic-fpn-small")
    imported, header = import_checkpoint(path), read_header(path)
    assert (imported.architecture, imported.classes) == ("semantic-fpn-small", CITYSCAPES)
    assert (imported.units.mean, imported.units.std) == (header.mean, header.std)
    assert (imported.units.scale, imported.units.channel_order) == ("1/255", "rgb")
    assert header.provenance.items() <= imported.provenance.items()
    assert all(np.array_equal(imported.tensors[name], array) for name, array in read_tensors(path).items())
    with pytest.raises(InvalidInput, match="holds another architecture"):
        import_checkpoint(path, architecture="deeplabv3plus-small")


@pytest.mark.parametrize(
    ("changes", "match"),
    [
        ({"classes": "no json"}, "the header cannot be read"),
        ({"mean": "[1, 2]"}, "mean: not the statistics of three channels"),
        ({"std": "[1, 2, 0]"}, "std: .*three positive numbers"),
        ({"architecture": "u-net"}, "unknown architecture 'u-net'"),
        ({"classes": '["a", "b"]'}, r"predictor\.weight is \[19, 64, 1, 1\] instead of \[2, 64, 1, 1\]"),
    ],
)
def test_a_wrong_header_of_our_own_is_refused(changes: dict[str, str], match: str) -> None:
    tensors = read_tensors(function_path("semantic-fpn-small"))
    entries = {
        "format": "valerie-network/1",
        "architecture": "semantic-fpn-small",
        "classes": json.dumps(CITYSCAPES),
        "mean": "[0, 0, 0]",
        "std": "[1, 1, 1]",
    }
    with pytest.raises(InvalidInput, match=match):
        convert(stored(tensors, **entries | changes), field="f")


def test_missing_entries_of_our_own_header_are_named() -> None:
    with pytest.raises(InvalidInput, match="entries of the header are missing; got classes, mean, std"):
        convert(stored({}, format="valerie-network/1", architecture="semantic-fpn-small"), field="f")


def test_the_document_fields_make_a_document(detectron) -> None:
    imported = convert(stored(detectron), field="f")
    payload = Payload(sha256="0" * 64, bytes=1, format="safetensors")
    document = FunctionDocument(name="coarse", payload=payload, **imported.document_fields())
    assert document.input.channel_order == "bgr"
    assert document.input.multiple_of == 32
    assert document.output.classes == CITYSCAPES
    assert document.architecture == "semantic-fpn-r50-gn"
