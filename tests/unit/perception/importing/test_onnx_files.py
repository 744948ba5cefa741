"""Hostile ONNX files, which an inference engine would open trustingly."""

from pathlib import Path
from typing import Any

import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper, numpy_helper

from valerie.errors import InvalidInput, NotFound
from valerie.perception.importing import onnx_files
from valerie.perception.importing.onnx_files import operator_set, read_onnx


def model(*nodes: onnx.NodeProto, constants: tuple[onnx.TensorProto, ...] = ()) -> onnx.ModelProto:
    x = helper.make_tensor_value_info("x", TensorProto.FLOAT, [1, 3, "h", None])
    y = helper.make_tensor_value_info("y", TensorProto.FLOAT, [1, 19, 8, 8])
    graph = helper.make_graph(list(nodes) or [helper.make_node("Relu", ["x"], ["y"])], "g", [x], [y], list(constants))
    return helper.make_model(
        graph, opset_imports=[helper.make_opsetid("", 17)], producer_name="maker", producer_version="1.2"
    )


@pytest.fixture
def check(tmp_path: Path) -> Any:
    def write_and_check(data: bytes | onnx.ModelProto, **options: Any) -> onnx.ModelProto:
        path = tmp_path / "n.onnx"
        path.write_bytes(data if isinstance(data, bytes) else data.SerializeToString())
        return read_onnx(path, **options)

    return write_and_check


def test_a_plain_network_comes_back_as_it_was_written(check) -> None:
    weights = numpy_helper.from_array(np.ones((19, 3, 1, 1), np.float32), "w")
    network = model(helper.make_node("Conv", ["x", "w"], ["y"]), constants=(weights,))
    assert check(network) == network
    assert operator_set(check(network)) == 17


def test_nodes_of_inner_graphs_are_counted(check, monkeypatch) -> None:
    inner = helper.make_graph(
        [helper.make_node("Relu", ["x"], ["b"])], "b", [], [helper.make_tensor_value_info("b", 1, None)]
    )
    condition = numpy_helper.from_array(np.array(True), "c")
    network = model(helper.make_node("If", ["c"], ["y"], then_branch=inner, else_branch=inner), constants=(condition,))
    monkeypatch.setattr(onnx_files, "MAX_NODES", 3)
    check(network)
    monkeypatch.setattr(onnx_files, "MAX_NODES", 2)
    with pytest.raises(InvalidInput, match="too many operators"):
        check(network)


def test_a_graph_in_two_parts_is_checked_as_an_engine_joins_it(check) -> None:
    """Protobuf joins repeated parts of one message: an empty second part must not hide the first."""
    empty = helper.make_graph([], "g", [], []).SerializeToString()
    whole = model(helper.make_node("RandomNormalLike", ["x"], ["y"])).SerializeToString()
    with pytest.raises(InvalidInput, match="RandomNormalLike"):
        check(whole + b"\x3a" + bytes([len(empty)]) + empty)


def test_a_tensor_with_a_negative_length_is_refused(check) -> None:
    lying = numpy_helper.from_array(np.ones(4, np.float32), "w")
    lying.dims[:] = [-1, -(1 << 40)]
    with pytest.raises(InvalidInput, match="stated size exceeds its data"):
        check(model(constants=(lying,)))


def external(tensor: onnx.TensorProto, location: str) -> onnx.TensorProto:
    tensor.ClearField("raw_data")
    tensor.data_location = TensorProto.EXTERNAL
    tensor.external_data.add(key="location", value=location)
    return tensor


@pytest.mark.parametrize("location", ["../../../../etc/hostname", "/etc/hostname", "weights.bin"])
def test_data_in_other_files_is_refused_unopened(check, location: str) -> None:
    weights = external(numpy_helper.from_array(np.ones(4, np.float32), "w"), location)
    with pytest.raises(InvalidInput, match=r"n\.onnx: data in another file.*got w"):
        check(model(constants=(weights,)))


def test_data_in_other_files_is_found_in_attributes_and_branches_too(check) -> None:
    hidden = external(numpy_helper.from_array(np.ones(4, np.float32), "w"), "/etc/hostname")
    constant = helper.make_node("Constant", [], ["y"], value=hidden)
    inner = helper.make_graph([constant], "b", [], [helper.make_tensor_value_info("y", 1, None)])
    for node in (constant, helper.make_node("If", ["x"], ["y"], then_branch=inner, else_branch=inner)):
        with pytest.raises(InvalidInput, match="data in another file"):
            check(model(node))


@pytest.mark.parametrize("domain", ["com.example", "com.microsoft", "ai.onnx.ml"])
def test_operators_of_other_libraries_are_refused(check, domain: str) -> None:
    with pytest.raises(InvalidInput, match=f"not of standard ONNX; got {domain}.Evil"):
        check(model(helper.make_node("Evil", ["x"], ["y"], domain=domain)))


@pytest.mark.parametrize("kind", ["Loop", "Scan"])
def test_operators_that_may_never_end_are_refused(check, kind: str) -> None:
    with pytest.raises(InvalidInput, match=f"may never end; got {kind}"):
        check(model(helper.make_node(kind, ["x"], ["y"])))


def test_random_numbers_are_refused(check) -> None:
    with pytest.raises(InvalidInput, match="could not be reproduced; got RandomNormalLike"):
        check(model(helper.make_node("RandomNormalLike", ["x"], ["y"])))


def test_local_functions_are_refused(check) -> None:
    network = model()
    network.functions.append(
        helper.make_function("own", "F", ["a"], ["b"], [helper.make_node("Relu", ["a"], ["b"])], network.opset_import)
    )
    with pytest.raises(InvalidInput, match="local functions; inline them"):
        check(network)


def test_a_tensor_that_states_more_than_it_holds_is_refused(check) -> None:
    lying = numpy_helper.from_array(np.ones(4, np.float32), "w")
    del lying.dims[:]
    lying.dims.extend([1 << 20, 1 << 20])
    with pytest.raises(InvalidInput, match="stated size exceeds its data; got w: 1048576 × 1048576; limit: 31 bytes"):
        check(model(constants=(lying,)))


@pytest.mark.parametrize("kind", [TensorProto.INT4, TensorProto.BOOL, TensorProto.INT64, TensorProto.DOUBLE])
def test_honest_tensors_of_any_type_pass(check, kind: int) -> None:
    check(model(constants=(helper.make_tensor("w", kind, [6], [1, 0, 1, 0, 1, 1]),)))


def test_graphs_nested_too_deep_are_refused(check) -> None:
    graph = helper.make_graph(
        [helper.make_node("Relu", ["x"], ["b"])], "b", [], [helper.make_tensor_value_info("b", 1, None)]
    )
    for _ in range(6):
        node = helper.make_node("If", ["x"], ["b"], then_branch=graph, else_branch=graph)
        graph = helper.make_graph([node], "b", [], [helper.make_tensor_value_info("b", 1, None)])
    with pytest.raises(InvalidInput, match="graphs within graphs"):
        check(model(*graph.node))


def test_too_many_operators_are_refused(check, monkeypatch) -> None:
    monkeypatch.setattr(onnx_files, "MAX_NODES", 3)
    nodes = [helper.make_node("Relu", ["x"], ["y"]) for _ in range(4)]
    with pytest.raises(InvalidInput, match="too many operators"):
        check(model(*nodes))


def test_a_file_beyond_the_limit_is_refused_unread(check) -> None:
    with pytest.raises(InvalidInput, match=r"too large; got .*; limit: 10 bytes"):
        check(model(), max_bytes=10)


@pytest.mark.parametrize(
    "data",
    [
        b"\x80\x04\x95pickle",
        b"PK\x03\x04" + b"\0" * 60,
        b"\xff" * 64,
        b"\x3a\xff\xff\xff\xff\x0f",
        b"GIF89a",
        b"\x08\x08",
        b"\x3a\x00",
    ],
)
def test_something_else_is_refused(check, data: bytes) -> None:
    with pytest.raises(InvalidInput, match="not an ONNX file"):
        check(data)


def test_an_empty_file_and_a_missing_one_are_named(check, tmp_path) -> None:
    with pytest.raises(InvalidInput, match="empty"):
        check(b"")
    with pytest.raises(NotFound, match="gone"):
        read_onnx(tmp_path / "gone.onnx")


def test_a_cut_file_is_refused_wherever_it_is_cut(check) -> None:
    whole = model(constants=(numpy_helper.from_array(np.ones((2, 2), np.float32), "w"),)).SerializeToString()
    refused = 0
    for end in range(1, len(whole)):
        try:
            check(whole[:end])
        except InvalidInput:
            refused += 1
    # The operator sets come last: cut before them, the file ends between two fields but lacks something.
    assert refused == len(whole) - 1
