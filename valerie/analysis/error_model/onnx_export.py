"""A perception-error model as an ONNX file: standard operators, double precision.

Input ``queries`` (N, F): the model's columns in order. Outputs ``miss`` (N,), ``quantiles`` (N, L), ``inside`` (N,) bool.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

from valerie.analysis.error_model.model import LEVELS, ROUNDING, ErrorModel
from valerie.errors import CorruptArtifact, MissingDependency

#: Largest difference between the file's answers and the model's.
MOST_DIFFERENCE: Final = 1e-5
_OPSET: Final = 18
_IR: Final = 9


def to_onnx(model: ErrorModel) -> bytes:
    """Return the ONNX file of a model; equal models give equal bytes."""
    graph, fit, terms = _Graph(), model.fit, model.fit.terms
    within = graph.add("Min", graph.add("Max", "queries", terms.low), terms.high)
    centred = graph.add("Div", graph.add("Sub", within, terms.middle), terms.scale)
    above = graph.add("Sub", graph.add("Gather", within, terms.of, axis=1), terms.knots)
    rises = graph.add("Div", graph.add("Max", above, np.zeros(1)), terms.scale[terms.of])
    values = graph.add("Concat", centred, rises, axis=1)
    if len(terms.first):
        factors = [graph.add("Gather", values, chosen, axis=1) for chosen in (terms.first, terms.second)]
        values = graph.add("Concat", values, graph.add("Mul", *factors), axis=1)
    odds = graph.add("Add", graph.add("MatMul", values, fit.weights), fit.offsets)
    above_knots = [graph.add("Max", graph.add("Sub", odds, knots), np.zeros(1)) for knots in fit.knots.T]
    odds, *bent = (graph.add("Mul", each, bends) for each, bends in zip((odds, *above_knots), fit.bends.T, strict=True))
    for each in (*bent, fit.shifts):
        odds = graph.add("Add", odds, each)
    count = np.array([len(fit.bounds)])
    below = graph.add("TopK", graph.add("Sigmoid", odds), count, outputs=2, axis=1, largest=0)
    graph.add("Gather", below, np.array(fit.miss), axis=1, name="miss")

    column = graph.add("Slice", below, np.array([0]), np.array([1]), np.array([1]))
    zeros = graph.add("Mul", column, np.zeros(1))
    starts = graph.add("Concat", zeros, below, axis=1)
    ends = graph.add("Concat", below, graph.add("Add", zeros, np.ones(1)), axis=1)
    rise = graph.add("Max", graph.add("Sub", ends, starts), np.array([ROUNDING]))
    columns = []
    for level in LEVELS:
        reached = graph.add("Div", graph.add("Sub", np.array([level]), starts), rise)
        part = graph.add("Min", graph.add("Max", reached, np.zeros(1)), np.ones(1))
        steps = np.diff(np.concatenate(([0.0], fit.bounds, [1.0])))[:, None]
        columns.append(graph.add("MatMul", part, steps))
    graph.add("Concat", *columns, axis=1, name="quantiles")

    scaled = graph.add("Unsqueeze", graph.add("Div", "queries", fit.support.widths), np.array([1]))
    apart = graph.add("Abs", graph.add("Sub", scaled, fit.support.centres / fit.support.widths))
    farthest = graph.add("ReduceMax", apart, np.array([2]), keepdims=0)
    nearest = graph.add("ReduceMin", farthest, np.array([1]), keepdims=0)
    graph.add("LessOrEqual", nearest, np.array(1 + ROUNDING), name="inside")
    return graph.file(model)


def check_onnx(model: ErrorModel, data: bytes, queries: np.typing.NDArray[np.float64]) -> float:
    """Return the largest difference between the file's answers, in onnxruntime, and the model's.

    Raises:
        CorruptArtifact: it exceeds `MOST_DIFFERENCE`, or the answers to ``inside`` differ.
        MissingDependency: onnxruntime is not installed.
    """
    try:
        import onnxruntime
    except ImportError as error:
        raise MissingDependency("the check of error models needs onnxruntime: install valerie[infer]") from error
    session = onnxruntime.InferenceSession(data, providers=["CPUExecutionProvider"])
    miss, quantiles, inside = session.run(["miss", "quantiles", "inside"], {"queries": queries})
    expected = model.predict(queries)
    difference = max(float(np.abs(miss - expected.miss).max()), float(np.abs(quantiles - expected.quantiles).max()))
    if difference > MOST_DIFFERENCE or (inside != expected.inside).any():
        raise CorruptArtifact(f"the ONNX file of {model.function} answers {difference:g} off, or with another `inside`")
    return difference


class _Graph:
    """Nodes and constants of a graph, named in the order in which they are added."""

    def __init__(self) -> None:
        self._nodes: list[onnx.NodeProto] = []
        self._constants: list[onnx.TensorProto] = []

    def add(self, operator: str, *inputs: Any, name: str = "", outputs: int = 1, **attributes: Any) -> str:
        """Add a node; return the name of its first output. Arrays among the inputs become constants."""
        names = [value if isinstance(value, str) else self._constant(value) for value in inputs]
        results = [
            name or f"{operator}-{len(self._nodes)}",
            *(f"unused-{len(self._nodes)}-{i}" for i in range(1, outputs)),
        ]
        self._nodes.append(helper.make_node(operator, names, results, **attributes))
        return results[0]

    def _constant(self, array: Any) -> str:
        name = f"constant-{len(self._constants)}"
        self._constants.append(numpy_helper.from_array(np.ascontiguousarray(array).reshape(np.shape(array)), name))
        return name

    def file(self, model: ErrorModel) -> bytes:
        """Return the graph as a file."""
        double = TensorProto.DOUBLE
        results = [
            helper.make_tensor_value_info("miss", double, ["N"]),
            helper.make_tensor_value_info("quantiles", double, ["N", len(LEVELS)]),
            helper.make_tensor_value_info("inside", TensorProto.BOOL, ["N"]),
        ]
        queries = helper.make_tensor_value_info("queries", double, ["N", len(model.columns)])
        graph = helper.make_graph(self._nodes, "perception-error-model", [queries], results, self._constants)
        file = helper.make_model(
            graph, producer_name="valerie", opset_imports=[helper.make_opsetid("", _OPSET)], ir_version=_IR
        )
        helper.set_model_props(
            file,
            {
                "function": model.function,
                "columns": ",".join(model.columns),
                "threshold": f"{model.threshold:g}",
                "levels": ",".join(f"{level:g}" for level in LEVELS),
            },
        )
        onnx.checker.check_model(file)
        return bytes(file.SerializeToString(deterministic=True))
