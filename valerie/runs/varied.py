"""Distributions as a spec writes them: both notations and the JSON Schema follow from the classes below.

A distribution of the same name in `valerie.parameters.distributions` holds the mathematics.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Annotated, ClassVar, Final, Literal, get_args

from pydantic import Field

from valerie.parameters import distributions
from valerie.runs.values import Count, Document, Name, Quantity, Scalar

#: Short words of the mapping notation, and the fields that they stand for.
SHORT_WORDS: Final = MappingProxyType({"from": "minimum", "to": "maximum", "sigma": "standard_deviation"})


class VariedDocument(Document):
    """A varied parameter, by name or path.

    Attributes:
        makes: the distribution that this document describes.
        listed: fields in the order of the list notation ``[parameter, DISTRIBUTION, …]``. A distribution with one such
            field also takes its value directly in the mapping notation: ``choice: [a, b]``.
        repeated: True if the list notation ends with any number of values of the one listed field.
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
    """minimum + k · step ≤ maximum."""

    makes = distributions.Homogeneous
    listed = ("minimum", "maximum", "step")

    distribution: Literal["HOMOGENEOUS"]
    minimum: Quantity
    maximum: Quantity
    step: Quantity


class VariedGaussian(VariedDocument):
    """Normal, truncated to the declared range; ``count`` mid-quantiles in a grid."""

    makes = distributions.Gaussian
    listed = ("mean", "standard_deviation")

    distribution: Literal["GAUSSIAN"]
    mean: Quantity
    standard_deviation: Quantity
    count: Count | None = None


class VariedUniform(VariedDocument):
    """Equally likely between the ends, by default the declared ones; ``count`` mid-quantiles in a grid."""

    makes = distributions.Uniform
    listed = ("minimum", "maximum")

    distribution: Literal["UNIFORM"]
    minimum: Quantity | None = None
    maximum: Quantity | None = None
    count: Count | None = None


class VariedChoice(VariedDocument):
    """One of the listed values."""

    makes = distributions.Choice
    listed = ("values",)
    repeated = True

    distribution: Literal["CHOICE"]
    values: Annotated[tuple[Scalar, ...], Field(min_length=1)]


class VariedConstant(VariedDocument):
    """One value."""

    makes = distributions.Constant
    listed = ("value",)

    distribution: Literal["CONSTANT"]
    value: Scalar


Varied = Annotated[
    VariedHomogeneous | VariedGaussian | VariedUniform | VariedChoice | VariedConstant,
    Field(discriminator="distribution"),
]

#: Distribution to its document.
DISTRIBUTIONS: Final[Mapping[str, type[VariedDocument]]] = MappingProxyType(
    {model.word(): model for model in get_args(get_args(Varied)[0])}
)
