"""Make specimens, by which numeric classes are compared: see `valerie.runs.products.specimens`."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from importlib import resources
from typing import Final

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from valerie.parameters.definitions import Value
from valerie.perception.base import PerceptionFunction
from valerie.rendering.base import Renderer, View
from valerie.rendering.truth import TruthMaker
from valerie.runs.products.pins import Offer
from valerie.runs.products.specimens import of_image, of_labels, of_truth, specimen_key
from valerie.scene.variation.variant import apply
from valerie.testing.assets import simple_asset

#: Specimens by key. Those that are there already are not made again.
Specimens = dict[str, bytes]

#: The scene: boxes on paving, one person beside a car and one before a wall, all with shadows.
_ASSIGNMENT: Final[Mapping[str, Value]] = {
    "scene.person-1.pos.x": -0.6,
    "scene.person-1.pos.y": 6.0,
    "scene.person-1.heading": 33.0,
    "scene.person-2.character": "blue-coat",
    "scene.person-2.pos.x": -3.0,
    "scene.person-2.pos.y": 13.0,
}
_VIEW: Final = View("camera-1", 96, 54)


def add_image(specimens: Specimens, offer: Offer, renderer: Renderer) -> None:
    """Add what an engine makes of the scene."""
    _add(specimens, offer, lambda: of_image(renderer.full(apply(_ASSIGNMENT, simple_asset()), _VIEW).pixels))


def add_truth(specimens: Specimens, offer: Offer, truth_pass: TruthMaker) -> None:
    """Add what the truth pass makes of the scene."""

    def make() -> bytes:
        truth = truth_pass.truth(apply(_ASSIGNMENT, simple_asset()), _VIEW)
        return of_truth(truth.class_map, truth.instance_map)

    _add(specimens, offer, make)


def add_prediction(specimens: Specimens, offer: Offer, function: PerceptionFunction) -> None:
    """Add what a function predicts for the picture."""
    _add(specimens, offer, lambda: of_labels(function.predict(picture())))


def _add(specimens: Specimens, offer: Offer, make: Callable[[], bytes]) -> None:
    """Add a specimen; one that cannot be made is left out, and its class then agrees with no other."""
    key = specimen_key(offer)
    if key in specimens:
        return
    try:
        specimens[key] = make()
    except Exception as error:  # a plug-in may raise anything, and works without a specimen
        print(f"{offer.name}: no specimen: {type(error).__name__}: {error}", file=sys.stderr)  # noqa: T201


def picture() -> NDArray[np.uint8]:
    """Return the picture, (128, 256, 3) uint8: a frame of ``urban-street`` with two persons, in steps of eight grey levels."""
    with resources.files(__package__).joinpath("specimen.png").open("rb") as file, Image.open(file) as image:
        return np.asarray(image)
