"""Distributions as specs write them. Both notations and the JSON Schema are derived from the classes below.

The mathematics is in the class of the same name in `valerie.parameters.distributions`.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Annotated, ClassVar, Final, Literal, get_args

from pydantic import Field

from valerie.document import Document
from valerie.parameters import distributions
from valerie.runs.values import Count, Name, Quantity, Scalar

#: Short words of the mapping notation, and the fields that they stand for.
SHORT_WORDS: Final = MappingProxyType({"from": "minimum", "to": "maximum", "sigma": "standard_deviation"})


class VariedDocument(Document):
    """A varied parameter.

    Attributes:
        makes: the distribution that this document describes.
        listed: fields in the order of the list notation ``[parameter, DISTRIBUTION, …]``. In the mapping notation, a
            distribution with a single listed field takes its value directly: ``choice: [a, b]``.
        repeated: True if the list notation takes any number of values for the listed field.
        parameter: name or path.
    """

    makes: ClassVar[type[distributions.Distribution]]
    listed: ClassVar[tuple[str, ...]]
    repeated: ClassVar[bool] = False

    parameter: Name

    @classmethod
    def word(cls) -> str:
        """Return the distribution's name, e.g. ``HOMOGENEOUS``."""
        return str(get_args(cls.model_fields["distribution"].annotation)[0])

    @classmethod
    def list_form(cls, parameter: str) -> str:
        """Return the list notation with its fields named, for error messages."""
        numbers = ("value", "value", "…") if cls.repeated else cls.listed
        return f"[{', '.join((parameter, cls.word(), *numbers))}]"


class VariedHomogeneous(VariedDocument):
    """Values minimum + k · step ≤ maximum."""

    makes = distributions.Homogeneous
    listed = ("minimum", "maximum", "step")

    distribution: Literal["HOMOGENEOUS"]
    minimum: Quantity
    maximum: Quantity
    step: Quantity


class VariedGaussian(VariedDocument):
    """Normal distribution, truncated to the declared range; a grid takes ``count`` mid-quantiles."""

    makes = distributions.Gaussian
    listed = ("mean", "standard_deviation")

    distribution: Literal["GAUSSIAN"]
    mean: Quantity
    standard_deviation: Quantity
    count: Count | None = None


class VariedUniform(VariedDocument):
    """Uniform distribution over a range, by default the declared one; a grid takes ``count`` mid-quantiles."""

    makes = distributions.Uniform
    listed = ("minimum", "maximum")

    distribution: Literal["UNIFORM"]
    minimum: Quantity | None = None
    maximum: Quantity | None = None
    count: Count | None = None


class VariedChoice(VariedDocument):
    """Listed values."""

    makes = distributions.Choice
    listed = ("values",)
    repeated = True

    distribution: Literal["CHOICE"]
    values: Annotated[tuple[Scalar, ...], Field(min_length=1)]


class VariedConstant(VariedDocument):
    """A single value."""

    makes = distributions.Constant
    listed = ("value",)

    distribution: Literal["CONSTANT"]
    value: Scalar


Varied = Annotated[
    VariedHomogeneous | VariedGaussian | VariedUniform | VariedChoice | VariedConstant,
    Field(discriminator="distribution"),
]

#: Name of a distribution to its document.
DISTRIBUTIONS: Final[Mapping[str, type[VariedDocument]]] = MappingProxyType(
    {model.word(): model for model in get_args(get_args(Varied)[0])}
)
