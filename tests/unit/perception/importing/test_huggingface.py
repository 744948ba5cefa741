import json
from pathlib import Path

import numpy as np
import pytest

from valerie.errors import InvalidInput, NotFound
from valerie.perception.base import PerceptionFunction
from valerie.perception.importing.huggingface import read_huggingface
from valerie.perception.running.opening import open_function
from valerie.perception.running.quiet import silence_libraries
from valerie.testing.perception import PerceptionContract

silence_libraries()
transformers = pytest.importorskip("transformers")

CLASSES = ("background", "person", "sky")


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """A SegFormer with a few thousand weights, as `save_pretrained` writes it."""
    import torch

    folder = tmp_path_factory.mktemp("segformer")
    config = transformers.SegformerConfig(
        num_labels=3,
        id2label=dict(enumerate(CLASSES)),
        hidden_sizes=[8, 8, 16, 16],
        depths=[1, 1, 1, 1],
        num_attention_heads=[1, 1, 2, 2],
        decoder_hidden_size=8,
    )
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(1)
        model = transformers.SegformerForSemanticSegmentation(config)
    transformers.logging.disable_progress_bar()
    model.save_pretrained(folder)
    processor = {
        "do_resize": True,
        "size": {"height": 64, "width": 96},
        "image_mean": [0.5] * 3,
        "image_std": [0.25] * 3,
    }
    (folder / "preprocessor_config.json").write_text(json.dumps(processor))
    return folder


@pytest.fixture
def copied(folder: Path, tmp_path: Path) -> Path:
    for path in folder.iterdir():
        (tmp_path / path.name).write_bytes(path.read_bytes())
    return tmp_path


def change(path: Path, **entries: object) -> None:
    path.write_text(json.dumps({**json.loads(path.read_text()), **entries}))


class TestHuggingFace(PerceptionContract):
    @pytest.fixture
    def function(self, folder: Path) -> PerceptionFunction:
        return open_function(*read_huggingface(folder, "tiny"))


def test_the_document_holds_the_facts_of_the_folder(folder: Path) -> None:
    document, payload = read_huggingface(folder, "tiny")
    assert (document.kind, document.architecture, document.engine) == ("huggingface", "segformer", "torch")
    assert document.output.classes == CLASSES
    assert document.output.unmapped == ("background",)
    assert (document.input.mode, document.input.size) == ("resize", (96, 64))
    assert (document.input.mean, document.input.std, document.input.scale) == ((0.5,) * 3, (0.25,) * 3, "1/255")
    assert payload == folder / "model.safetensors"
    assert document.payload.bytes == payload.stat().st_size


def test_changes_by_the_caller_override_the_folder(folder: Path) -> None:
    whole = {"mode": "pad", "size": None, "multiple_of": 32}
    document, _ = read_huggingface(folder, "tiny", input=whole, output={"class_map": {"sky": "void"}}, precision="bf16")
    assert (document.input.mode, document.input.mean) == ("pad", (0.5,) * 3)
    assert document.output.unmapped == ("background", "sky")
    assert document.precision == "bf16"


def test_the_labels_are_those_of_the_librarys_own_post_processing(folder: Path) -> None:
    import torch

    picture = np.random.default_rng(0).integers(0, 256, (64, 96, 3), dtype=np.uint8)
    model = transformers.SegformerForSemanticSegmentation.from_pretrained(folder).eval()
    values = torch.from_numpy((picture / 255 - 0.5) / 0.25).permute(2, 0, 1)[None].float()
    with torch.inference_mode():
        output = model(pixel_values=values)
    processor = transformers.SegformerImageProcessorPil()
    (expected,) = processor.post_process_semantic_segmentation(output, target_sizes=[(64, 96)])
    labels = open_function(*read_huggingface(folder, "tiny")).predict(picture)
    np.testing.assert_array_equal(labels, np.array([255, 11, 10])[expected.numpy()])


@pytest.mark.parametrize("engine", ["openvino", "onnxruntime"])
def test_the_other_engines_agree(folder: Path, engine: str) -> None:
    whole = {"mode": "pad", "size": None, "multiple_of": 32}
    picture = np.random.default_rng(0).integers(0, 256, (50, 90, 3), dtype=np.uint8)
    reference = open_function(*read_huggingface(folder, "tiny", input=whole))
    function = open_function(*read_huggingface(folder, "tiny", engine=engine, input=whole))
    # A requirement: rounding may turn pixels on an edge.
    assert (function.predict(picture) == reference.predict(picture)).mean() > 0.999
    function.close()


def test_missing_weights_are_named_and_not_drawn_at_random(copied: Path) -> None:
    from safetensors.numpy import load_file, save_file

    tensors = load_file(copied / "model.safetensors")
    tensors.pop("decode_head.classifier.bias")
    save_file(tensors, copied / "model.safetensors", metadata={"format": "pt"})
    with pytest.raises(InvalidInput, match=r"decode_head\.classifier\.bias is missing"):
        open_function(*read_huggingface(copied, "tiny"))


def test_weights_of_another_shape_are_named(copied: Path) -> None:
    change(copied / "config.json", decoder_hidden_size=16)
    with pytest.raises(InvalidInput, match=r"not those of the configuration|cannot open it"):
        open_function(*read_huggingface(copied, "tiny"))


def test_code_of_the_folder_is_never_run(copied: Path) -> None:
    touched = copied / "ran"
    (copied / "modeling_evil.py").write_text(f"open({str(touched)!r}, 'w')\n")
    evil = {"AutoConfig": "modeling_evil.Config", "AutoModelForSemanticSegmentation": "modeling_evil.Model"}
    change(copied / "config.json", model_type="evil", auto_map=evil)
    with pytest.raises(InvalidInput, match="transformers cannot open it"):
        open_function(*read_huggingface(copied, "tiny"))
    assert not touched.exists()


def test_a_pickle_is_never_opened(copied: Path) -> None:
    (copied / "model.safetensors").rename(copied / "pytorch_model.bin")
    with pytest.raises(InvalidInput, match=r"one safetensors file.*got pytorch_model\.bin"):
        read_huggingface(copied, "tiny")


def test_a_model_for_another_task_is_refused(copied: Path) -> None:
    change(copied / "config.json", model_type="bert")
    with pytest.raises(InvalidInput, match="cannot open it"):
        open_function(*read_huggingface(copied, "tiny"))


def test_missing_files_are_named(copied: Path) -> None:
    (copied / "config.json").unlink()
    with pytest.raises(NotFound, match=r"config\.json"):
        read_huggingface(copied, "tiny")
    with pytest.raises(NotFound, match="gone"):
        read_huggingface(copied / "gone", "tiny")


@pytest.mark.parametrize("named", [{}, {"0": "a", "2": "b"}, {"a": "b"}, None])
def test_classes_without_numbers_are_refused(copied: Path, named: object) -> None:
    change(copied / "config.json", id2label=named)
    with pytest.raises(InvalidInput, match="id2label"):
        read_huggingface(copied, "tiny")
