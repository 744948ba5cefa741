"""Offers of workers, and the offers that a run pinned: the numeric classes that its pixels depend on."""

from __future__ import annotations

from typing import Final

from pydantic import TypeAdapter

from valerie.document import Document
from valerie.perception.base import FunctionCard
from valerie.runs.products.states import Stage

#: The name under which render workers offer the truth pass, beside their engines.
TRUTH: Final = "truth"


class Offer(Document):
    """A renderer, the truth pass or an inference engine that a worker runs.

    Attributes:
        stage: the stage that uses it.
        name: the engine's name in specs, ``truth``, or an inference engine with its precision (``openvino/bf16``).
        numeric_class: everything besides the inputs that may change the last bits.
        revision: number that is raised when equal inputs give another result.
        route: queue of the workers that run it in this numeric class.
    """

    stage: Stage
    name: str
    numeric_class: str
    revision: int
    route: str


class FunctionOffer(Offer):
    """An installed function that a worker runs.

    Attributes:
        digest: SHA-256 of its weights.
        card: facts about it.
    """

    digest: str
    card: FunctionCard


AnyOffer = FunctionOffer | Offer
#: A worker's offers as JSON.
OFFERS: Final = TypeAdapter(tuple[AnyOffer, ...])


class FunctionPin(FunctionOffer):
    """A function as a run pinned it.

    Attributes:
        kind: kind of a registered function (see `valerie.perception.documents.function`); None for an installed one.
        deadline_hours: time for uploading its predictions, from the function's document; None: the deployment's.
        deadline: end of the time for uploading predictions, in Unix seconds; None before the run starts, and for other
            kinds.
    """

    kind: str | None = None
    deadline_hours: float | None = None
    deadline: float | None = None


class Pins(Document):
    """Everything that a run pinned.

    Attributes:
        engine: the renderer.
        truth: the truth pass.
        functions: the functions under test, by the names that the spec uses.
    """

    engine: Offer
    truth: Offer
    functions: dict[str, FunctionPin]
