r"""Read a spec from text, and resolve it against its asset.

>>> spec = parse("name: first\nasset: urban-street\nvary: [[person-1.pos.x, HOMOGENEOUS, 1.5, 5.5, 1.0]]")
>>> manifest, asset_digest = asset_manifest(spec.asset)
>>> len(resolve(spec, manifest, asset_digest=asset_digest).space)
5
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from typing import Any, Final, get_args

from pydantic import BaseModel, ValidationError

from valerie.errors import InvalidInput, InvalidInputs, UnknownName
from valerie.loading import load_document
from valerie.plain import Json
from valerie.runs.document.notation import TOP_LEVEL, Normalization
from valerie.runs.document.run_spec import (
    BlockDocument,
    DeclaredParameter,
    RequirementDocument,
    Resolution,
    RunSpec,
    written_place,
)
from valerie.runs.document.varied import DISTRIBUTIONS
from valerie.runs.resolving.resolution import MAX_VARIANTS, ResolvedRun, resolve
from valerie.validation import problem_of

__all__ = [
    "MAX_VARIANTS",
    "BlockDocument",
    "DeclaredParameter",
    "RequirementDocument",
    "Resolution",
    "ResolvedRun",
    "RunSpec",
    "parse",
    "resolve",
]

#: Tags that pydantic adds to the places of problems within a discriminated union.
_TAGS: Final = frozenset(DISTRIBUTIONS)
#: Names of types that pydantic adds to the places of problems within a plain union.
_TYPES: Final = frozenset({"int", "float", "str", "bool", "constrained-str", "dict[str,union[bool,int,float,str]]"})
#: Members of the unions `valerie.runs.values.Quantity` and `Scalar`.
_NUMBERS: Final = frozenset({"int", "float", "str"})


def parse(source: str | bytes | Mapping[str, Json] | RunSpec) -> RunSpec:
    """Read a spec in either notation.

    Args:
        source: YAML or JSON text, or a loaded document.

    Raises:
        InvalidInput: the text is not a usable document (see `valerie.loading`).
        InvalidInputs: every problem of the document, each with its dotted field.
    """
    if isinstance(source, RunSpec):
        return source
    document = load_document(source)
    if "goal" in document:
        limit = "`valerie study plan` and `valerie study run`, or leave goal out"
        raise InvalidInput("a run has no goal, a study has", field="goal", value=document["goal"], limit=limit)
    normalization = Normalization(document)
    problems = normalization.problems
    spec: RunSpec | None = None
    try:
        spec = RunSpec.model_validate(normalization.document)
    except ValidationError as error:
        problems += _problems(error, normalization.places)
    except InvalidInputs as error:
        problems += error.problems
    if spec is None or problems:
        raise InvalidInputs(problems)
    return spec.written_at(normalization.places)


def _problems(error: ValidationError, places: Mapping[str, str]) -> list[InvalidInput]:
    problems: dict[str, InvalidInput] = {}
    refused: dict[str, set[str]] = defaultdict(set)
    for problem in error.errors(include_url=False):
        if problem["type"] == "too_short" and problem["input"]:
            continue  # Pydantic dropped its invalid items, which are reported separately.
        parts = [part for part in problem["loc"] if part not in _TAGS and part not in _TYPES]
        place = written_place(".".join(map(str, parts)), places)
        # A union reports a problem for each of its members.
        refused[place].add(str(problem["loc"][-1]))
        if refused[place] >= _NUMBERS:
            message = "a single value is needed here" if "bool" in refused[place] else "a number is needed here"
            value = None if isinstance(problem["input"], dict) else problem["input"]
            problems[place] = InvalidInput(message, field=place, value=value)
        else:
            problems.setdefault(place, _problem(problem, place))
    return list(problems.values())


def _problem(problem: Any, place: str) -> InvalidInput:
    if problem["type"] == "extra_forbidden":
        *parents, name = problem["loc"]
        if not parents and "." in str(name):
            limit = "a parameter stands below vary or constants, indented"
            return InvalidInput(f"unknown field {name!r}", field=place, limit=limit)
        return UnknownName("field", str(name), _fields(parents), field=place)
    if problem["type"] == "model_type":
        fields = _model(problem["loc"]).model_fields.items()
        form = ", ".join(f"{name}: {'…' if field.is_required() else field.default}" for name, field in fields)
        return InvalidInput("a mapping is needed here", field=place, value=problem["input"], limit=f"{{{form}}}")
    return problem_of(problem, place)


def _fields(parents: Sequence[Any]) -> list[str]:
    """Return the names of the fields of the model at ``parents``, as users write them."""
    return [*_model(parents).model_fields, *(() if parents else TOP_LEVEL)]


def _model(parents: Sequence[Any]) -> type[BaseModel]:
    """Return the model at ``parents``."""
    model: type[BaseModel] = RunSpec
    for part in parents:
        if part in _TAGS:
            model = DISTRIBUTIONS[part]
        elif part in model.model_fields:
            model = next(iter(_models(model.model_fields[part].annotation)), model)
    return model


def _models(annotation: Any) -> list[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [model for argument in get_args(annotation) for model in _models(argument)]
