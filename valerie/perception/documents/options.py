"""What a kind of function has to say beyond what all kinds say."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Annotated, Any, Final

from pydantic import BaseModel, ConfigDict, Field, field_validator

from valerie.perception.documents.addresses import parse_url


class Options(BaseModel):
    """Of a kind that has none."""

    model_config = ConfigDict(frozen=True, extra="forbid")


class OnnxOptions(Options):
    """Of kind ``onnx``.

    Attributes:
        output: name of the network's output that holds the result; empty: the first.
    """

    output: Annotated[str, Field(max_length=200)] = ""


class HuggingFaceOptions(Options):
    """Of kind ``huggingface``.

    Attributes:
        config: the folder's config.json.
    """

    config: dict[str, Any]


class HttpOptions(Options):
    """Of kind ``http``.

    Attributes:
        url: where to POST.
        timeout_s: for the whole exchange, connection to last byte.
        version: what the endpoint's ``Function-Version`` must say; empty: not looked at. It is part of the digest: a new
            network behind the same address is a new function only if it says so.
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
    """Of kind ``predictions``.

    Attributes:
        deadline_hours: how long a run waits for its label maps; None: as long as the deployment says.
    """

    deadline_hours: Annotated[float, Field(gt=0, allow_inf_nan=False)] | None = None


#: Kinds to their options.
OPTIONS: Final[Mapping[str, type[Options]]] = MappingProxyType(
    {
        "network": Options,
        "onnx": OnnxOptions,
        "huggingface": HuggingFaceOptions,
        "http": HttpOptions,
        "predictions": PredictionsOptions,
    }
)
