"""Offers of workers, and the offers that a run pinned: the numeric classes that its pixels depend on."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Final

from pydantic import ConfigDict, Field, PrivateAttr, TypeAdapter

from valerie.document import Document
from valerie.parameters.assignment import digest
from valerie.parameters.definitions import Value
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


class Probed(Document):
    """What a machine offers, as tested.

    Attributes:
        offers: the offers.
        specimens: specimens of those that made one (`valerie.runs.products.specimens`), by key.
    """

    offers: tuple[AnyOffer, ...]
    specimens: dict[str, bytes] = Field(default_factory=dict)

    model_config = ConfigDict(ser_json_bytes="base64", val_json_bytes="base64")


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


class Bounds(Document):
    """Bounds within which two numeric classes agree.

    Attributes:
        levels: grey levels of 255 by which a value of a tone-mapped image may differ.
        values: smallest share of the values that differ by no more.
        truth: smallest share of pixels with equal labels and instances in the ground truth.
        labels: smallest share of pixels that a function labels equally.
    """

    levels: int = 1
    values: float = 0.999
    truth: float = 0.999
    labels: float = 0.995

    @property
    def text(self) -> str:
        """The bounds in words."""
        return (
            f"{100 * self.values:g} % of an image's values to {self.levels} of 255, {100 * self.truth:g} % of the ground truth's "
            f"pixels and {100 * self.labels:g} % of a function's labels"
        )


BOUNDS: Final = Bounds()


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

    @property
    def routes(self) -> frozenset[str]:
        """The queues of its products before evaluation."""
        parts = ((pins.engine, pins.truth, *pins.functions.values()) for pins in self.combinations())
        return frozenset(offer.route for offers in parts for offer in offers)

    def at(self, assignment: Mapping[str, Value]) -> Pins:  # noqa: ARG002
        """Return the pins of a variant's frames."""
        return self

    def combinations(self) -> Iterator[Pins]:
        """Yield all that `at` may return."""
        yield self


class RenderClass(Document):
    """What one kind of render worker offers.

    Attributes:
        engine, truth: the renderer and the truth pass.
        workers: number of such workers at the start of the run.
    """

    engine: Offer
    truth: Offer
    workers: int

    @property
    def routes(self) -> tuple[str, ...]:
        """Its queues."""
        return (self.engine.route, self.truth.route)


class InferClass(Document):
    """What one kind of inference worker offers.

    Attributes:
        functions: the functions under test, without those whose predictions are uploaded.
        workers: number of such workers at the start of the run.
    """

    functions: dict[str, FunctionPin]
    workers: int

    @property
    def routes(self) -> tuple[str, ...]:
        """Its queues, in the order of the functions' names."""
        return tuple(self.functions[name].route for name in sorted(self.functions))


class TolerantPins(Pins):
    """The pins of a run that accepts all numeric classes that agree with its first.

    The variants of a place have the same class of each stage, by a hash of the place, in proportion to the workers. So
    whatever is compared within a place comes from one class, and neither the order of work nor a restart changes who makes it.

    Attributes:
        render, infer: the classes of each stage, sorted by queue. The inherited fields contain the first of each.
        place: paths whose values make a place.
        bounds: bounds of their agreement.
    """

    render: tuple[RenderClass, ...]
    infer: tuple[InferClass, ...]
    place: tuple[str, ...]
    bounds: Bounds

    _combined: list[list[Pins]] = PrivateAttr()

    def model_post_init(self, context: object, /) -> None:  # noqa: ARG002
        """Combine the classes of the stages once."""
        self._combined = [
            [
                Pins(engine=render.engine, truth=render.truth, functions=self.functions | infer.functions)
                for infer in self.infer
            ]
            for render in self.render
        ]

    def at(self, assignment: Mapping[str, Value]) -> Pins:
        """Return the pins of a variant's frames."""
        place = digest("place", [assignment.get(path) for path in self.place])
        render = _share(digest(Stage.RENDER, place), [one.workers for one in self.render])
        infer = _share(digest(Stage.INFER, place), [one.workers for one in self.infer])
        return self._combined[render][infer]

    def combinations(self) -> Iterator[Pins]:
        """Yield all that `at` may return."""
        for row in self._combined:
            yield from row


#: The pins of any run.
AnyPins = TolerantPins | Pins
ANY_PINS: Final[TypeAdapter[AnyPins]] = TypeAdapter(AnyPins)


def numeric_classes(pins: Pins) -> dict[str, str]:
    """Return each part of a run to its numeric class, or to all that it accepts, in words."""
    parts = {"image": pins.engine.numeric_class, "ground truth": pins.truth.numeric_class}
    parts |= {inference_part(name): pin.numeric_class for name, pin in pins.functions.items()}
    if not isinstance(pins, TolerantPins):
        return parts
    workers: dict[str, dict[str, int]] = {}

    def count(part: str, offer: Offer, more: int) -> None:
        counts = workers.setdefault(part, {})
        counts[offer.numeric_class] = counts.get(offer.numeric_class, 0) + more

    for render in pins.render:
        count("image", render.engine, render.workers)
        count("ground truth", render.truth, render.workers)
    for infer in pins.infer:
        for name, pin in infer.functions.items():
            count(inference_part(name), pin, infer.workers)
    accepted = {part: counts for part, counts in workers.items() if len(counts) > 1}
    return parts | {
        part: " or ".join(f"{name} (weight {weight})" for name, weight in counts.items())
        for part, counts in accepted.items()
    }


def inference_part(function: str) -> str:
    """Return the name that the inference of a function has in `numeric_classes`."""
    return f"inference, {function}"


def _share(hashed: str, workers: list[int]) -> int:
    """Return the index of the class that a hash falls into, in proportion to the workers."""
    number = int(hashed, 16) % sum(workers)
    index = 0
    while number >= workers[index]:
        number -= workers[index]
        index += 1
    return index
