"""Commands that take options as documents: options that belong together are one parameter."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import MISSING, Field, fields, is_dataclass
from functools import wraps
from typing import Any, ParamSpec, TypeVar, get_type_hints

P = ParamSpec("P")
R = TypeVar("R")


def takes_documents(command: Callable[P, R]) -> Callable[..., R]:
    """Let Typer see an option for each field of a command's documents.

    A document is a parameter of a dataclass whose fields are annotated as a command's parameters are:
    ``steps: Annotated[int, typer.Option("--steps")] = 300``.
    """
    signature = inspect.signature(command, eval_str=True)
    documents: dict[str, type[Any]] = {}
    options: list[inspect.Parameter] = []
    for parameter in signature.parameters.values():
        if is_dataclass(parameter.annotation) and isinstance(parameter.annotation, type):
            documents[parameter.name] = parameter.annotation
            options += _options_of(parameter.annotation)
        else:
            options.append(parameter.replace(kind=inspect.Parameter.KEYWORD_ONLY))

    @wraps(command)
    def call(*positional: P.args, **values: P.kwargs) -> R:
        arguments: dict[str, Any] = dict(values)
        for name, document in documents.items():
            arguments[name] = document(**{field.name: arguments.pop(field.name) for field in fields(document)})
        return command(*positional, **arguments)

    call.__signature__ = signature.replace(parameters=options)  # type: ignore[attr-defined]
    call.__annotations__ = {option.name: option.annotation for option in options}
    return call


def _options_of(document: type[Any]) -> list[inspect.Parameter]:
    annotations = get_type_hints(document, include_extras=True)
    return [
        inspect.Parameter(
            field.name, inspect.Parameter.KEYWORD_ONLY, default=_default(field), annotation=annotations[field.name]
        )
        for field in fields(document)
    ]


def _default(field: Field[Any]) -> Any:
    return inspect.Parameter.empty if field.default is MISSING else field.default
