"""The options of each kind of function, beyond the entries that all kinds have."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Annotated, Final

from pydantic import Field, JsonValue, field_validator

from valerie.addresses import parse_url
from valerie.document import Document


class Options(Document):
    """Options of a kind without options."""


class OnnxOptions(Options):
    """Options of kind ``onnx``.

    Attributes:
        output: name of the network's output with the result; empty: the first.
    """

    output: Annotated[str, Field(max_length=200)] = ""


class HuggingFaceOptions(Options):
    """Options of kind ``huggingface``.

    Attributes:
        config: the folder's config.json.
    """

    config: dict[str, JsonValue]


class HttpOptions(Options):
    """Options of kind ``http``.

    Attributes:
        url: address to POST pictures to.
        timeout_s: seconds for the whole exchange, from the connection to the last byte.
        version: required value of the endpoint's header ``Function-Version``; empty: any. As part of the digest, it must
            change for a new network behind the same address to count as a new function.
    """

    url: Annotated[str, Field(min_length=1, max_length=2000)]
    timeout_s: Annotated[float, Field(gt=0, le=3600, allow_inf_nan=False)] = 30.0
    version: Annotated[str, Field(max_length=200)] = ""

    @field_validator("url")
    @classmethod
    def _usable(cls, url: str) -> str:
        parse_url(url)
        return url


class PredictionsOptions(Options):
    """Options of kind ``predictions``.

    Attributes:
        deadline_hours: time that a run waits for its label maps; None: the deployment's setting.
    """

    deadline_hours: Annotated[float, Field(gt=0, allow_inf_nan=False)] | None = None


#: Class of the options, by kind.
OPTIONS: Final[Mapping[str, type[Options]]] = MappingProxyType(
    {
        "network": Options,
        "onnx": OnnxOptions,
        "huggingface": HuggingFaceOptions,
        "http": HttpOptions,
        "predictions": PredictionsOptions,
    }
)
