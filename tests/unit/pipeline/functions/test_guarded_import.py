"""Files from users: recognised and converted, or refused with a reason, and never run."""

from __future__ import annotations

import os
import pickle
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import pytest

from valerie.errors import InvalidInput
from valerie.perception.importing.onnx_files import read_onnx
from valerie.perception.running.small_network import small_onnx
from valerie.perception.shipped import function_path
from valerie.pipeline.functions import guarded_import
from valerie.pipeline.functions.guarded_import import ImportedFunction, ImportRequest, import_function
from valerie.pipeline.functions.import_job import Trial
from valerie.settings import Settings, load_settings

SIDE = "output: {classes: [road, person]}\nengine: onnxruntime\n"


@pytest.fixture
def settings(tmp_path: Path) -> Settings:
    return load_settings({}, data_dir=tmp_path / "data", import_memory_mb=4096, import_seconds=120)


@pytest.fixture
def work(tmp_path: Path) -> Path:
    folder = tmp_path / "work"
    folder.mkdir()
    return folder


class Touch:
    """An object that creates a folder when it is unpickled: harmless, and proof that something ran."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def __reduce__(self) -> tuple[Any, ...]:
        return os.mkdir, (str(self._path),)


def bring(path: Path, work: Path, settings: Settings, document: str = SIDE, **more: Any) -> ImportedFunction:
    return import_function(ImportRequest(path, path.name, document, **more), work, settings)


def test_an_onnx_file_is_taken_unchanged_and_tried_out(tmp_path: Path, work: Path, settings: Settings) -> None:
    path = small_onnx(tmp_path)[1]
    imported = bring(path, work, settings)
    assert imported.payload == path
    assert (imported.document.name, imported.document.kind) == ("small", "onnx")
    assert imported.trial.picture == (256, 128)
    assert imported.document.provenance["source"] == "small.onnx"


def saved_network(path: Path, shape: list[int | str], channels: int, **metadata: str) -> Path:
    """Write a network that answers ``channels`` maps of its first input channel, in the layout of ``shape``."""
    axis = 1 if shape[1] == 3 else 3
    answer = [*shape]
    answer[axis] = channels
    indices = onnx.numpy_helper.from_array(np.zeros(channels, np.int64), "indices")
    graph = onnx.helper.make_graph(
        [onnx.helper.make_node("Gather", ["x", "indices"], ["y"], axis=axis)],
        "gathered",
        [onnx.helper.make_tensor_value_info("x", onnx.TensorProto.FLOAT, shape)],
        [onnx.helper.make_tensor_value_info("y", onnx.TensorProto.FLOAT, answer)],
        [indices],
    )
    model = onnx.helper.make_model(graph, opset_imports=[onnx.helper.make_opsetid("", 17)], ir_version=8)
    onnx.helper.set_model_props(model, metadata)
    path.write_bytes(model.SerializeToString())
    return path


def test_size_layout_and_classes_come_from_the_onnx_file(tmp_path: Path, work: Path, settings: Settings) -> None:
    path = saved_network(tmp_path / "net.onnx", [1, 64, 96, 3], 3, names="{0: 'road', 1: 'person', 2: 'car'}")
    found = bring(path, work, settings, "").document
    assert (found.input.layout, found.input.mode, found.input.size) == ("nhwc", "resize", (96, 64))
    assert found.output.classes == ("road", "person", "car")
    own = bring(
        path, work, settings, "input: {mode: tile, size: [96, 64]}\noutput: {classes: [sky, person, car]}"
    ).document
    assert (own.input.mode, own.output.classes) == ("tile", ("sky", "person", "car"))
    free = bring(saved_network(tmp_path / "free.onnx", [1, 3, "h", "w"], 34), work, settings, "").document
    assert (free.input.mode, free.input.size, free.output.classes[24]) == ("pad", None, "person")


def test_an_onnx_file_without_names_of_its_classes_asks_for_them(
    tmp_path: Path, work: Path, settings: Settings
) -> None:
    path = saved_network(tmp_path / "net.onnx", [1, 3, "h", "w"], 5)
    with pytest.raises(InvalidInput, match=r"output\.classes: neither .* got 5 channels; limit: output: \{classes: "):
        bring(path, work, settings, "")


def test_a_checkpoint_becomes_a_document_with_a_file_of_our_format(
    tmp_path: Path, work: Path, settings: Settings
) -> None:
    path = tmp_path / "Our Net.safetensors"
    path.write_bytes(function_path("semantic-fpn-small").read_bytes())
    imported = bring(path, work, settings, "provenance: {note: tried}", engine="torch")
    assert imported.document.name == "our-net"
    assert imported.document.architecture == "semantic-fpn-small"
    assert imported.document.provenance["note"] == "tried"
    assert imported.document.payload is not None
    assert imported.payload == work / "payload.safetensors"
    assert (imported.trial.numeric_class or "").startswith("torch-")


def test_equal_files_under_equal_names_are_one_version(tmp_path: Path, work: Path, settings: Settings) -> None:
    path = small_onnx(tmp_path)[1]
    assert bring(path, work, settings).document.digest == bring(path, work, settings).document.digest


def test_a_pickle_that_would_run_something_is_refused_unrun(tmp_path: Path, work: Path, settings: Settings) -> None:
    trace = tmp_path / "it-ran"
    path = tmp_path / "attack.pkl"
    path.write_bytes(pickle.dumps({"model": Touch(trace)}))
    with pytest.raises(InvalidInput):
        bring(path, work, settings, "")
    assert not trace.exists()


@pytest.mark.parametrize("name", ["a.pt2", "a.py", "a.torchscript", "a.whl", "a.so", "a.joblib"])
def test_formats_that_are_programs_are_not_even_opened(
    tmp_path: Path, work: Path, settings: Settings, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("subprocess.run", lambda *_, **__: pytest.fail("it was opened"))
    path = tmp_path / name
    path.write_bytes(b"import os")
    with pytest.raises(
        InvalidInput, match="runs code when it is loaded and is not accepted; export the network as ONNX"
    ):
        bring(path, work, settings)


def saved_program(folder: Path, suffix: str) -> Path:
    """A network of one convolution as a program: dark pixels are persons."""
    import torch

    network = torch.nn.Conv2d(3, 2, 1).eval()
    with torch.no_grad():
        network.weight.copy_(torch.tensor([[1.0] * 3, [-1.0] * 3]).reshape(2, 3, 1, 1))
        network.bias.copy_(torch.tensor([0.0, 1.5]))
    path = folder / f"program{suffix}"
    if suffix == ".pt2":
        torch.export.save(torch.export.export(network, (torch.zeros(1, 3, 64, 96),)), path)
    else:
        torch.jit.trace(network, torch.zeros(1, 3, 64, 96)).save(path)
    return path


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
@pytest.mark.parametrize("suffix", [".pt2", ".torchscript"])
def test_programs_of_torch_are_kept_as_onnx_where_the_operator_allows_them(
    tmp_path: Path, work: Path, settings: Settings, suffix: str
) -> None:
    path = saved_program(tmp_path, suffix)
    side = SIDE + "input: {mode: resize, size: [96, 64]}\n"
    with pytest.raises(InvalidInput, match="the operator of this deployment can allow it with VALERIE_IMPORT_PROGRAMS"):
        bring(path, work, settings, side)
    imported = bring(path, work, settings.model_copy(update={"import_programs": True}), side)
    assert imported.document.kind == "onnx"
    assert imported.payload == work / "payload.onnx"
    (picture,) = read_onnx(imported.payload).graph.input
    assert picture.name == "picture"
    assert [axis.dim_value for axis in picture.type.tensor_type.shape.dim] == [1, 3, 64, 96]
    assert (imported.trial.numeric_class or "").startswith("onnxruntime-")


def test_a_safetensors_file_with_a_lying_header_is_refused(tmp_path: Path, work: Path, settings: Settings) -> None:
    path = tmp_path / "lies.safetensors"
    path.write_bytes((1 << 60).to_bytes(8, "little") + b"{}")
    with pytest.raises(InvalidInput, match=r"lies\.safetensors"):
        bring(path, work, settings, "")


def test_an_onnx_file_that_names_other_files_is_refused(tmp_path: Path, work: Path, settings: Settings) -> None:
    onnx = pytest.importorskip("onnx")
    path = small_onnx(tmp_path)[1]
    model = onnx.load(path)
    tensor = model.graph.initializer[0]
    tensor.ClearField("raw_data")
    tensor.data_location = onnx.TensorProto.EXTERNAL
    tensor.external_data.add(key="location", value="/etc/passwd")
    path.write_bytes(model.SerializeToString())
    with pytest.raises(InvalidInput, match=r"small\.onnx"):
        bring(path, work, settings)


def test_a_file_above_the_limit_is_not_read(tmp_path: Path, work: Path) -> None:
    path = tmp_path / "large.onnx"
    with path.open("wb") as stream:
        stream.truncate(2 << 20)
    settings = load_settings({}, data_dir=tmp_path / "data", max_function_mb=1)
    with pytest.raises(InvalidInput, match=r"too large; got 2097152 bytes; limit: 1048576 bytes"):
        bring(path, work, settings)


def test_a_network_that_does_not_fit_its_document_is_refused(tmp_path: Path, work: Path, settings: Settings) -> None:
    path = small_onnx(tmp_path)[1]
    with pytest.raises(InvalidInput):
        bring(path, work, settings, "output: {classes: [road, person, sky]}\nengine: onnxruntime")


def test_time_is_bounded(tmp_path: Path, work: Path) -> None:
    settings = load_settings({}, data_dir=tmp_path / "data", import_seconds=0.05)
    with pytest.raises(InvalidInput, match="took too much memory or time"):
        bring(small_onnx(tmp_path)[1], work, settings)


def test_memory_is_bounded(tmp_path: Path, work: Path) -> None:
    settings = load_settings({}, data_dir=tmp_path / "data", import_memory_mb=16)
    with pytest.raises(InvalidInput):
        bring(small_onnx(tmp_path)[1], work, settings)


def nested_tuples(depth: int) -> bytes:
    """A pickle of a few hundred bytes: a dictionary whose key has 2 to the power of ``depth`` leaves."""
    pair_of_the_one_before = b"q\x00h\x00\x86"
    return b"\x80\x02}N" + pair_of_the_one_before * depth + b"Ns."


@pytest.mark.parametrize(
    "pickled",
    [
        b"\x80\x02]r\xf0\xff\xff\xff.",  # remember an object under number 4,294,967,280
        b"\x80\x04\x8e" + (1 << 50).to_bytes(8, "little") + b"x.",  # a string of a petabyte, so it says
        nested_tuples(60),
    ],
    ids=["memory", "length", "time"],
)
def test_a_pickle_that_exhausts_memory_or_time_ends_the_child_alone(tmp_path: Path, work: Path, pickled: bytes) -> None:
    settings = load_settings({}, data_dir=tmp_path / "data", import_memory_mb=1024, import_seconds=4)
    path = tmp_path / "bomb.pkl"
    path.write_bytes(pickled)
    with pytest.raises(InvalidInput, match=r"too much memory or time|MemoryError"):
        bring(path, work, settings, "")


def test_an_onnx_file_of_millions_of_operators_ends_the_child_alone(tmp_path: Path, work: Path) -> None:
    settings = load_settings({}, data_dir=tmp_path / "data", import_memory_mb=1024, import_seconds=40)
    nodes = b"\x0a\x00" * (1 << 24)
    path = tmp_path / "bomb.onnx"
    path.write_bytes(b"\x3a\x80\x80\x80\x10" + nodes + b"\x42\x02\x10\x11")
    with pytest.raises(InvalidInput, match=r"bomb\.onnx: not an ONNX file .*alloc|too much memory"):
        bring(path, work, settings)


def test_secrets_of_the_environment_do_not_reach_the_child(
    tmp_path: Path, work: Path, settings: Settings, monkeypatch: pytest.MonkeyPatch
) -> None:
    environment: dict[str, str] = {}
    run = guarded_import.subprocess.run

    def watched(*arguments: Any, env: dict[str, str], **options: Any) -> Any:
        environment.update(env)
        return run(*arguments, env=env, **options)

    monkeypatch.setenv("VALERIE_API_TOKEN", "t" * 20)
    monkeypatch.setenv("AWS_SECRET_ACCESS_KEY", "s")
    monkeypatch.setattr(guarded_import.subprocess, "run", watched)
    bring(small_onnx(tmp_path)[1], work, settings)
    assert "PATH" in environment
    assert not {"VALERIE_API_TOKEN", "AWS_SECRET_ACCESS_KEY"} & environment.keys()


def test_a_document_alone_is_enough_for_kinds_without_a_file(work: Path, settings: Settings) -> None:
    text = "name: elsewhere\nkind: predictions\noutput: {classes: [road, person]}"
    imported = import_function(ImportRequest(None, document=text), work, settings)
    assert imported.payload is None
    assert imported.trial == Trial(skipped="nothing to open: kind predictions")


def test_a_document_that_needs_a_file_says_so(work: Path, settings: Settings) -> None:
    text = "name: a\nkind: huggingface\narchitecture: segformer\noptions: {config: {}}"
    with pytest.raises(InvalidInput):
        import_function(ImportRequest(None, document=text), work, settings)
