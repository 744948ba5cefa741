import json
import os
import pickle
import struct
import warnings
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors.numpy import save_file
from torch import nn

from valerie.errors import InvalidInput, NotFound
from valerie.perception.importing.checkpoints.checkpoint_files import read_stored_checkpoint


def weights() -> dict[str, torch.Tensor]:
    generator = torch.Generator().manual_seed(5)
    return {
        "conv.weight": torch.rand(4, 3, 3, 3, generator=generator),
        "conv.bias": torch.rand(4, generator=generator).half(),
        "bn.num_batches_tracked": torch.tensor(7),
        "turned": torch.rand(3, 5, generator=generator).T,
        "part": torch.rand(10, generator=generator)[4:8],
        "empty": torch.zeros(0, 3),
    }


def require_equal(path: Path) -> None:
    stored = read_stored_checkpoint(path)
    assert list(stored.tensors) == list(weights())
    for name, tensor in weights().items():
        np.testing.assert_array_equal(stored.tensors[name], tensor.numpy())
        assert stored.tensors[name].dtype == tensor.numpy().dtype


@pytest.fixture
def save(tmp_path: Path) -> Callable[..., Path]:
    def write(objects: object, *, zipped: bool = True) -> Path:
        path = tmp_path / "f.pth"
        torch.save(objects, path, _use_new_zipfile_serialization=zipped)
        return path

    return write


@pytest.fixture
def rewritten(save, tmp_path: Path) -> Callable[..., Path]:
    """An archive of torch.save whose entries are changed one by one."""

    def write(change: Callable[[str, bytes], bytes], *, compression: int = zipfile.ZIP_STORED) -> Path:
        path = tmp_path / "changed.pth"
        with zipfile.ZipFile(save({"a": torch.arange(4.0)})) as old, zipfile.ZipFile(path, "w", compression) as new:
            for entry in old.infolist():
                new.writestr(entry.filename, change(entry.filename, old.read(entry)))
        return path

    return write


@pytest.mark.parametrize("zipped", [True, False])
@pytest.mark.parametrize("container", [None, "state_dict", "model_state", "model"])
def test_torch_files_of_both_formats_come_back(save, zipped: bool, container: str | None) -> None:
    require_equal(save(weights() if container is None else {container: weights()}, zipped=zipped))


@pytest.mark.parametrize("zipped", [True, False])
def test_bfloat16_comes_back_as_float32(save, zipped: bool) -> None:
    tensor = torch.tensor([1.0, -2.5, 3.0e38]).bfloat16()
    np.testing.assert_array_equal(
        read_stored_checkpoint(save({"a": tensor}, zipped=zipped)).tensors["a"], tensor.float().numpy()
    )


def test_a_pickle_of_arrays_comes_back(tmp_path: Path) -> None:
    path = tmp_path / "f.pkl"
    arrays = {name: tensor.numpy() for name, tensor in weights().items()}
    path.write_bytes(pickle.dumps({"model": arrays, "__author__": "somebody"}))
    require_equal(path)
    assert read_stored_checkpoint(path).entries == {"__author__": "somebody"}


def test_safetensors_come_back_with_their_header(tmp_path: Path) -> None:
    path = tmp_path / "f.safetensors"
    save_file({"a": np.ones(3, np.float32)}, path, metadata={"format": "x"})
    stored = read_stored_checkpoint(path)
    assert (stored.format, stored.entries) == ("safetensors", {"format": "x"})
    np.testing.assert_array_equal(stored.tensors["a"], np.ones(3, np.float32))


@pytest.mark.parametrize("zipped", [True, False])
def test_entries_beside_the_weights_do_no_harm(save, zipped: bool) -> None:
    whole = {
        "model_state": nn.BatchNorm2d(4).state_dict(),  # with its versions as an attribute
        "optimizer_state": {
            "state": {0: {"momentum_buffer": torch.ones(4)}},
            "param_groups": [{"lr": 0.1, "params": [0]}],
        },
        "best_score": np.float64(0.75),
        "cur_itrs": 30_000,
        "meta": {"CLASSES": ("road", "person"), "nested": {"mean": [1, 2]}},
    }
    stored = read_stored_checkpoint(save(whole, zipped=zipped))
    assert set(stored.tensors) == set(nn.BatchNorm2d(4).state_dict())
    assert stored.entries["best_score"] == 0.75
    assert stored.entries["meta.CLASSES"] == ("road", "person")
    assert stored.entries["meta.nested.mean"] == [1, 2]


def test_a_dictionary_in_many_places_is_entered_once(save) -> None:
    inner: dict[str, object] = {"leaf": 1}
    for _ in range(30):
        inner = {str(place): inner for place in range(30)}  # 30 to the power of 30 leaves
    assert list(read_stored_checkpoint(save({"state_dict": weights(), "meta": inner})).entries.values()) == [1]


def test_a_dictionary_that_holds_itself_is_entered_once(save) -> None:
    itself: dict[str, object] = {"epoch": 3}
    itself["again"] = itself
    assert read_stored_checkpoint(save({"state_dict": weights(), "meta": itself})).entries == {"meta.epoch": 3}


def test_the_prefix_of_data_parallel_training_is_dropped(save) -> None:
    stored = read_stored_checkpoint(
        save({"state_dict": {f"module.{name}": tensor for name, tensor in weights().items()}})
    )
    assert list(stored.tensors) == list(weights())


def test_parameters_are_tensors(save) -> None:
    stored = read_stored_checkpoint(save({"a": nn.Parameter(torch.ones(2))}))
    assert stored.tensors["a"].tolist() == [1.0, 1.0]


class Touches:
    def __init__(self, mark: Path) -> None:
        self.mark = mark

    def __reduce__(self):
        return os.system, (f"touch {self.mark}",)


@pytest.mark.parametrize("zipped", [True, False])
def test_a_call_in_a_torch_file_is_refused_and_not_made(save, tmp_path: Path, zipped: bool) -> None:
    mark = tmp_path / "mark"
    path = save({"state_dict": weights(), "meta": Touches(mark)}, zipped=zipped)
    with pytest.raises(InvalidInput, match=r"contains (posix|nt)\.system"):
        read_stored_checkpoint(path)
    assert not mark.exists()


def test_a_file_above_the_limit_is_refused_unread(save) -> None:
    path = save(weights())
    with pytest.raises(InvalidInput, match="too large"):
        read_stored_checkpoint(path, max_bytes=path.stat().st_size - 1)


def test_a_huge_file_with_a_hole_is_refused_unread(tmp_path: Path) -> None:
    path = tmp_path / "f.pth"
    with path.open("wb") as stream:
        stream.truncate(1 << 40)
    with pytest.raises(InvalidInput, match="too large"):
        read_stored_checkpoint(path)


def test_a_compressed_archive_is_refused_before_it_grows(rewritten) -> None:
    path = rewritten(
        lambda name, data: bytes(20_000_000) if "/data/" in name else data, compression=zipfile.ZIP_DEFLATED
    )
    assert path.stat().st_size < 100_000
    with pytest.raises(InvalidInput, match="compressed or encrypted"):
        read_stored_checkpoint(path)


def test_entries_that_share_their_bytes_are_refused(save, tmp_path: Path) -> None:
    """Many entries of one directory may point at the same bytes; their sum is then larger than the file."""
    path = save({"a": torch.zeros(1_000)})
    data = path.read_bytes()
    end = data.rfind(b"PK\x05\x06")
    count, size, start = struct.unpack("<HII", data[end + 10 : end + 20])
    directory = data[start : start + size]
    tail = struct.pack("<4s4H2IH", b"PK\x05\x06", 0, 0, count * 50, count * 50, size * 50, start, 0)
    path.write_bytes(data[:start] + directory * 50 + tail)
    with pytest.raises(InvalidInput, match=r"larger than the file|not a readable zip"):
        read_stored_checkpoint(path)


def test_a_tensor_larger_than_its_storage_is_refused(rewritten) -> None:
    def lie(name: str, data: bytes) -> bytes:
        return data.replace(b"K\x04\x85", b"J\x00\x00\x00\x01\x85") if name.endswith("data.pkl") else data

    with pytest.raises(InvalidInput, match=r"a tensor of \[16777216\] in a storage of 4 numbers"):
        read_stored_checkpoint(rewritten(lie))


class ChangedLater:
    """A tensor of one number whose shape the pickle changes after it was made."""

    def __reduce__(self):
        arguments = (torch.zeros(1).storage(), 0, (1,), (1,), False, {})
        return torch._utils._rebuild_tensor_v2, arguments, {"shape": (1 << 40,)}  # noqa: SLF001 # the name in every checkpoint


def test_a_tensor_cannot_be_changed_after_it_was_checked(save) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # typed storages are deprecated, and what torch.save writes
        path = save({"a": ChangedLater()})
    with pytest.raises(InvalidInput, match="a change of Tensor"):
        read_stored_checkpoint(path)


def test_a_storage_larger_than_its_data_is_refused(rewritten) -> None:
    def lie(name: str, data: bytes) -> bytes:
        return data.replace(b"K\x04", b"J\x00\x00\x00\x01") if name.endswith("data.pkl") else data

    with pytest.raises(InvalidInput, match="another length; got 16; limit: 16777216 numbers of 4 bytes"):
        read_stored_checkpoint(rewritten(lie))


@pytest.mark.parametrize("zipped", [True, False])
def test_one_number_expanded_to_a_vast_tensor_is_refused(save, zipped: bool) -> None:
    with pytest.raises(InvalidInput, match="in a storage of 1 numbers"):
        read_stored_checkpoint(save({"a": torch.zeros(1).expand(1 << 40)}, zipped=zipped))


def test_older_torch_files_cannot_lie_about_lengths(save) -> None:
    path = save({"a": torch.arange(4.0)}, zipped=False)
    data = path.read_bytes()
    stated = struct.pack("<q", 4) + np.arange(4, dtype="<f4").tobytes()
    assert data.endswith(stated)
    path.write_bytes(data[: -len(stated)] + struct.pack("<q", 1 << 40) + stated[8:])
    with pytest.raises(InvalidInput, match="two lengths of one storage"):
        read_stored_checkpoint(path)
    path.write_bytes(data[:-4])
    with pytest.raises(InvalidInput, match="another length"):
        read_stored_checkpoint(path)


@pytest.mark.parametrize("header", [1 << 62, 1 << 40, 10_000_000])
def test_a_safetensors_header_longer_than_the_file_is_refused(tmp_path: Path, header: int) -> None:
    path = tmp_path / "f.safetensors"
    path.write_bytes(struct.pack("<Q", header) + b'{"a":{}}')
    with pytest.raises(InvalidInput, match="longer than it can be"):
        read_stored_checkpoint(path)


@pytest.mark.parametrize("padding", range(8))
def test_a_header_of_any_length_is_told_from_a_pickle(tmp_path: Path, padding: int) -> None:
    path = tmp_path / "f.safetensors"
    header = b'{"a":{"dtype":"F32","shape":[1],"data_offsets":[0,4]}}'
    header += b" " * (0x80 + 8 * padding - len(header))  # a length of 128 begins as a pickle does
    path.write_bytes(struct.pack("<Q", len(header)) + header + bytes(4))
    assert read_stored_checkpoint(path).format == "safetensors"


def test_a_safetensors_tensor_outside_the_file_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "f.safetensors"
    header = json.dumps({"a": {"dtype": "F32", "shape": [1 << 30], "data_offsets": [0, 1 << 32]}}).encode()
    path.write_bytes(struct.pack("<Q", len(header)) + header + bytes(16))
    with pytest.raises(InvalidInput, match="not a readable safetensors file"):
        read_stored_checkpoint(path)


def test_torchscript_is_refused_by_name(tmp_path: Path) -> None:
    path = tmp_path / "f.pt"
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        torch.jit.save(torch.jit.trace(nn.Conv2d(1, 1, 1), torch.zeros(1, 1, 2, 2)), path)
    with pytest.raises(InvalidInput, match=r"TorchScript archive.*ONNX"):
        read_stored_checkpoint(path)


def test_an_exported_program_is_refused_by_name(tmp_path: Path) -> None:
    path = tmp_path / "f.pt2"
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        torch.export.save(torch.export.export(nn.Conv2d(1, 1, 1), (torch.zeros(1, 1, 2, 2),)), path)
    with pytest.raises(InvalidInput, match=r"exported program \(\.pt2\).*ONNX"):
        read_stored_checkpoint(path)


@pytest.mark.parametrize("data", [b"", b"x", b"\x89PNG\r\n\x1a\n and so on", b"PK\x03\x04 no archive", b"\x80\x02N."])
def test_files_that_are_not_checkpoints_are_refused(tmp_path: Path, data: bytes) -> None:
    path = tmp_path / "f.pth"
    path.write_bytes(data)
    with pytest.raises(InvalidInput, match=r"f\.pth"):
        read_stored_checkpoint(path)


def test_a_truncated_archive_is_refused(save) -> None:
    path = save(weights())
    path.write_bytes(path.read_bytes()[:-100])
    with pytest.raises(InvalidInput, match="not a readable zip archive"):
        read_stored_checkpoint(path)


def test_a_damaged_storage_is_refused(save) -> None:
    path = save({"a": torch.arange(64.0)})
    data = path.read_bytes()
    place = data.index(np.arange(64, dtype="<f4").tobytes())
    path.write_bytes(data[: place + 9] + b"\xff" + data[place + 10 :])
    with pytest.raises(InvalidInput, match="Bad CRC-32"):
        read_stored_checkpoint(path)


def test_another_zip_archive_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "f.pth"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("readme.txt", "hello")
    with pytest.raises(InvalidInput, match=r"not written by torch\.save"):
        read_stored_checkpoint(path)


def test_numbers_in_another_byte_order_are_refused(rewritten) -> None:
    with pytest.raises(InvalidInput, match="not little-endian"):
        read_stored_checkpoint(rewritten(lambda name, data: b"big" if name.endswith("byteorder") else data))


def test_a_file_without_weights_is_refused(save) -> None:
    with pytest.raises(InvalidInput, match="holds no weights"):
        read_stored_checkpoint(save({"epoch": 3}))


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(NotFound, match=r"g\.pth"):
        read_stored_checkpoint(tmp_path / "g.pth")
