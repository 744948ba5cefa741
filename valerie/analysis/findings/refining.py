"""Spec of the next iteration: half the step, inside the region of weakness (the paper, section 5.3: "initial step size")."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Final, assert_never

from valerie.analysis.findings.region import Arc, Bound, Choices, Range, Region
from valerie.errors import InvalidInput, UnknownName
from valerie.parameters.blocks import GRID, POINTS, Block, Variation
from valerie.parameters.definitions import ParameterDefinition, ParameterType, Value
from valerie.parameters.distributions import Choice, Constant, Gaussian, Homogeneous, Uniform
from valerie.runs.document.descent import descent
from valerie.runs.document.run_spec import BlockDocument, RunSpec
from valerie.runs.document.varied import Varied, VariedChoice, VariedGaussian, VariedHomogeneous, VariedUniform
from valerie.runs.values import Scalar

#: Values of a parameter that is added to a grid.
_ADDED: Final = 3
#: Relative tolerance of steps.
_TOLERANCE: Final = 1e-9


def halved_spec(
    spec: RunSpec,
    blocks: Sequence[Block],
    definitions: Mapping[str, ParameterDefinition],
    region: Region,
    *,
    run_id: str,
    middle: Mapping[str, Value],
    add: Sequence[str] = (),
    drop: Sequence[str] = (),
) -> RunSpec:
    """Return the spec of the next iteration.

    HOMOGENEOUS parameters get half the step, from the first to the last step inside the region; UNIFORM ones get its
    range, and CHOICE ones the values inside. A GAUSSIAN stays unchanged. Points become a Sobol' design over the region.

    Args:
        spec: spec of the run.
        blocks: blocks of the run, in the asset's units.
        definitions: path to definition.
        region: bounds by path.
        run_id: id of the run.
        middle: path to the value that a dropped parameter gets.
        add: paths of further parameters to vary over their declared ranges.
        drop: paths of parameters that become constants.

    Raises:
        InvalidInput: an added parameter has no range, or nothing is left to vary.
        UnknownName: a dropped parameter is not varied.
    """
    varied = {path for block in blocks for path in _paths(block)}
    for path in drop:
        if path not in varied:
            raise UnknownName("varied parameter", path, varied, field="--drop")
    constants: dict[str, Scalar] = {path: _written(middle[path], definitions[path]) for path in drop}
    refined = []
    for document, block in zip(spec.blocks, blocks, strict=True):
        design = "sobol" if block.design == POINTS else document.design
        variations = _of_points(block, definitions) if block.design == POINTS else block.variations
        vary = [
            _refined(variation, definitions[variation.path], region.bounds.get(variation.path))
            for variation in variations
            if variation.path not in drop
        ]
        vary += [_added(definitions[path], design) for path in add if path not in varied]
        count = max(len(block.points), 1) if block.design == POINTS else document.count
        kept = {name: value for name, value in document.constants.items() if name not in add}
        refined.append(BlockDocument(design=design, count=count, vary=tuple(vary), constants={**kept, **constants}))
    if not any(block.vary for block in refined):
        raise InvalidInput("nothing is left to vary", field="--drop", value=list(drop))
    of_run = {name: value for name, value in spec.constants.items() if name not in add}
    return spec.model_copy(
        update={
            "blocks": tuple(refined),
            "constants": of_run,
            **descent(spec, run_id),
            "seed": spec.seed + 1,
        }
    )


def _paths(block: Block) -> set[str]:
    return {variation.path for variation in block.variations} | {path for point in block.points for path in point}


def _of_points(block: Block, definitions: Mapping[str, ParameterDefinition]) -> list[Variation]:
    """Return the ranges that the points of a block span."""
    variations = []
    for path in sorted({path for point in block.points for path in point}):
        values = [point[path] for point in block.points if path in point]
        if definitions[path].type in (ParameterType.CATEGORICAL, ParameterType.BOOL) or len(set(values)) == 1:
            variations.append(Variation(path, Choice(values=tuple(dict.fromkeys(values)))))
        else:
            numbers = [float(value) for value in values]
            variations.append(Variation(path, Uniform(minimum=min(numbers), maximum=max(numbers))))
    return variations


def _refined(variation: Variation, definition: ParameterDefinition, bound: Bound | None) -> Varied:
    distribution, name = variation.distribution, definition.name
    low, high = _ends(bound)
    match distribution:
        case Homogeneous():
            step = distribution.step if definition.type is ParameterType.INT else distribution.step / 2
            first = _step_at(distribution.minimum, step, max(low, distribution.minimum), up=True)
            last = _step_at(distribution.minimum, step, min(high, distribution.maximum), up=False)
            return VariedHomogeneous(
                parameter=name,
                distribution="HOMOGENEOUS",
                minimum=_written(first, definition),
                maximum=_written(max(first, last), definition),
                step=_written(step, definition),
            )
        case Uniform():
            least = definition.minimum if distribution.minimum is None else distribution.minimum
            most = definition.maximum if distribution.maximum is None else distribution.maximum
            return VariedUniform(
                parameter=name,
                distribution="UNIFORM",
                minimum=least if least is None else _written(max(low, float(least)), definition),
                maximum=most if most is None else _written(min(high, float(most)), definition),
                count=distribution.points,
            )
        case Choice() | Constant():
            values = distribution.values if isinstance(distribution, Choice) else (distribution.constant,)
            inside = tuple(value for value in values if bound is None or _holds(bound, value)) or values
            written = tuple(_written(value, definition) for value in inside)
            return VariedChoice(parameter=name, distribution="CHOICE", values=written)
        case Gaussian():
            return VariedGaussian(
                parameter=name,
                distribution="GAUSSIAN",
                mean=_written(distribution.mean, definition),
                standard_deviation=_written(distribution.standard_deviation, definition),
                count=distribution.points,
            )
        case _:
            assert_never(distribution)


def _written(value: Value, definition: ParameterDefinition) -> Value:
    """Return a value as a spec states it: a number with its unit, if it has one."""
    if isinstance(value, bool | str) or not definition.unit:
        return value
    return f"{value:.15g} {definition.unit}"


def _holds(bound: Bound, value: Value) -> bool:
    return bound.holds(str(value) if isinstance(bound, Choices) else value)


def _ends(bound: Bound | None) -> tuple[float, float]:
    """Return the range of a bound; infinite for an arc across 360°, which is no range."""
    if isinstance(bound, Range):
        return bound.low, bound.high
    if isinstance(bound, Arc) and bound.start + bound.width <= 360:
        return bound.start, bound.start + bound.width
    return -math.inf, math.inf


def _step_at(origin: float, step: float, value: float, *, up: bool) -> float:
    """Return the step at or next to a value, towards the inside of the region."""
    number = (value - origin) / step
    whole = math.ceil(number - _TOLERANCE) if up else math.floor(number + _TOLERANCE)
    return round(origin + whole * step, 10)


def _added(definition: ParameterDefinition, design: str) -> Varied:
    if definition.type is ParameterType.BOOL:
        return VariedChoice(parameter=definition.name, distribution="CHOICE", values=(False, True))
    if definition.type is ParameterType.CATEGORICAL:
        return VariedChoice(parameter=definition.name, distribution="CHOICE", values=definition.choices)
    if definition.minimum is None or definition.maximum is None:
        raise InvalidInput("the parameter has no declared range", field="--add", value=definition.name)
    return VariedUniform(parameter=definition.name, distribution="UNIFORM", count=_ADDED if design == GRID else None)
