"""Functions that take several pictures at once, as on a GPU: the same results, and failures that stay where they belong."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.world.blank import Pipeline
from tests.world.boxes import spec
from valerie import plugins
from valerie.errors import TransientError
from valerie.storage.keys import PRODUCTS
from valerie.testing.blank import BlankFunction

Picture = NDArray[np.uint8]


class Alone(BlankFunction):
    """The blank function, which fails where a test wants it."""

    def __init__(self, refuse: Callable[[Picture], Exception | None] = lambda _: None) -> None:
        self.alone = 0
        self._refuse = refuse

    def predict(self, picture: Picture) -> Picture:
        self.alone += 1
        error = self._refuse(picture)
        if error is not None:
            raise error
        return super().predict(picture)


class Batches(Alone):
    """The same on a pretended GPU; records which pictures come together."""

    batch_size = 4

    def __init__(self, refuse: Callable[[Picture], Exception | None] = lambda _: None) -> None:
        super().__init__(refuse)
        self.together: list[int] = []

    def predict_many(self, pictures: Sequence[Picture]) -> list[Picture]:
        self.together.append(len(pictures))
        for error in filter(None, map(self._refuse, pictures)):
            raise error
        return [BlankFunction.predict(self, picture) for picture in pictures]


@pytest.fixture
def opened(monkeypatch: pytest.MonkeyPatch, pipelines: Callable[..., Pipeline]) -> Callable[..., tuple[Pipeline, str]]:
    """A pipeline of its own with a submitted run of 8 frames that a function looks at."""

    def make(function: BlankFunction, name: str = "one") -> tuple[Pipeline, str]:
        monkeypatch.setattr(plugins, "create_function", lambda *_, **__: function)
        pipeline = pipelines(name)
        return pipeline, pipeline.submit(spec(xs=2, ys=2))

    return make


def predictions(pipeline: Pipeline) -> dict[str, bytes]:
    store = pipeline.context.store
    return {info.key: store.get(info.key) for info in store.list(f"{PRODUCTS}prediction")}


def test_pictures_of_one_message_are_predicted_together_with_the_same_results(opened) -> None:  # type: ignore[no-untyped-def]
    function = Batches()
    together, run_id = opened(function, "together")
    assert together.run(run_id) == "completed"
    assert function.together == [4, 4]
    assert function.alone == 0
    alone, run_id = opened(BlankFunction(), "alone")
    assert alone.run(run_id) == "completed"
    assert predictions(together) == predictions(alone)
    assert len(predictions(together)) == 8


def test_a_picture_that_fails_harms_no_other(opened) -> None:  # type: ignore[no-untyped-def]
    pictures: list[bytes] = []

    def refuse(picture: Picture) -> Exception | None:
        pictures.append(picture.tobytes())
        return ValueError("not this one") if pictures[-1] == pictures[0] else None

    failed = []
    for number, function in enumerate((Batches(refuse), Alone(refuse))):
        pipeline, run_id = opened(function, str(number))
        assert pipeline.run(run_id) == "completed-with-failures"
        failed.append(
            {
                product.digest
                for product in pipeline.products()
                if product.kind == "prediction" and product.state == "failed"
            }
        )
    # Some frames of this scene look alike, and fail alike.
    assert 0 < len(failed[0]) < 8
    assert failed[0] == failed[1]


def test_what_is_tried_again_goes_alone(opened) -> None:  # type: ignore[no-untyped-def]
    down = [True]
    function = Batches(lambda _: TransientError("later") if down else None)
    pipeline, run_id = opened(function)
    while not function.together:
        pipeline.step()
    down.clear()
    function.together.clear()
    function.alone = 0
    assert pipeline.run(run_id) == "completed"
    assert function.together == []
    assert function.alone == 8
