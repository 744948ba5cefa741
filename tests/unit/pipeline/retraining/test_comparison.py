from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.world.blank import Pipeline, completed_run
from valerie.analysis.comparison.wording import change_sentence
from valerie.analysis.findings.region import Range, Region
from valerie.errors import Conflict, InvalidInput
from valerie.labels import PERSON, VOID
from valerie.perception.base import FunctionCard, PerceptionFunction
from valerie.pipeline.retraining.comparison import Grouping, compare_on_run
from valerie.testing.blank import NUMERIC_CLASS, BlankFunction


class Everything:
    """Calls everything a person."""

    revision: ClassVar[int] = 1
    numeric_class = NUMERIC_CLASS
    card = FunctionCard("everything", "0" * 64, "test", "fp32", "numpy", {})

    def predict(self, picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
        return np.full(picture.shape[:2], PERSON.train_id, np.uint8)

    def close(self) -> None:
        pass


class Halved(BlankFunction):
    """The same in another precision."""

    numeric_class = "blank-bf16"  # type: ignore[assignment]  # read-only in the protocol


class PersonOrNot(BlankFunction):
    """The same, but what is no person is void to it."""

    card = FunctionCard("person-or-not", "1" * 64, "test", "uint8", "blank", {}, ("person",))

    def predict(self, picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
        labels = super().predict(picture)
        return np.where(labels == PERSON.train_id, labels, VOID).astype(np.uint8)


OPENED = {
    "everything.safetensors": Everything,
    "same.safetensors": BlankFunction,
    "halved.safetensors": Halved,
    "person-or-not.safetensors": PersonOrNot,
}


def opener(reference: str) -> PerceptionFunction:
    return OPENED[reference]()


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> tuple[Pipeline, str]:
    return completed_run(tmp_path_factory.mktemp("comparison"))


def test_a_version_that_is_the_same_differs_in_nothing(run: tuple[Pipeline, str]) -> None:
    pipeline, run_id = run
    versions = ["blank", "same.safetensors"]
    comparison = compare_on_run(pipeline.context, run_id, versions, open_function=opener)
    assert comparison.versions == ("blank", "same")
    assert all(group.sides[0] == group.sides[1] for group in comparison.groups)
    assert comparison.groups[0].persons == comparison.groups[0].frames == 24
    assert comparison.changes(1) == ()


def test_recall_bought_with_precision_is_shown_as_both(run: tuple[Pipeline, str]) -> None:
    pipeline, run_id = run
    comparison = compare_on_run(pipeline.context, run_id, ["blank", "everything.safetensors"], open_function=opener)
    side = comparison.groups[0].sides[1]
    assert side.pacc_mean == side.pacc_pooled == 1.0
    assert side.precision_pooled == pytest.approx(0.25)  # the square is a quarter of the picture
    worse = [change_sentence(change) for change in comparison.changes(1) if change.step < 0]
    assert any(line.startswith("class road") for line in worse)


def test_selection_and_region_split_the_persons_in_two(run: tuple[Pipeline, str]) -> None:
    pipeline, run_id = run
    comparison = compare_on_run(
        pipeline.context,
        run_id,
        ["blank", "everything.safetensors"],
        open_function=opener,
        grouping=Grouping(
            where="person-1.pos.x < -2.85 and pacc >= 0",
            region=Region(bounds={"distance_m": Range(low=0, high=1000)}),
        ),
    )
    groups = {group.name: group for group in comparison.groups}
    assert groups["selected by the scores of blank"].persons == groups["not selected"].persons == 12
    assert groups["in the region"].persons == 24
    assert "outside the region" not in groups


def test_versions_have_names_of_their_own(run: tuple[Pipeline, str]) -> None:
    pipeline, run_id = run
    for versions in (["blank"], ["blank", "blank"], [str(Path("a/x.safetensors")), str(Path("b/x.safetensors"))]):
        with pytest.raises(InvalidInput, match="two or more"):
            compare_on_run(pipeline.context, run_id, versions, open_function=opener)


def test_versions_of_unequal_numeric_classes_are_not_compared(run: tuple[Pipeline, str]) -> None:
    pipeline, run_id = run
    looked: list[str] = []
    versions = ["blank", "same.safetensors", "halved.safetensors"]
    with pytest.raises(Conflict, match="blank ran as blank; same runs here as blank; halved runs here as blank-bf16"):
        compare_on_run(
            pipeline.context, run_id, versions, open_function=opener, progress=lambda *step: looked.append(step[3])
        )
    assert looked == [], "it is told before hours of work"


def test_what_a_precision_changes_is_compared_when_that_is_the_question(run: tuple[Pipeline, str]) -> None:
    pipeline, run_id = run
    versions = ["blank", "halved.safetensors"]
    comparison = compare_on_run(pipeline.context, run_id, versions, open_function=opener, mixed=True)
    assert comparison.numeric_classes == ("blank", "blank-bf16")
    assert comparison.groups[0].differences[0].mean == 0.0


def test_a_version_that_knows_fewer_classes_is_compared_by_those(run: tuple[Pipeline, str]) -> None:
    pipeline, run_id = run
    versions = ["blank", "person-or-not.safetensors"]
    comparison = compare_on_run(pipeline.context, run_id, versions, open_function=opener)
    assert comparison.judged_by == ("person",)
    assert comparison.changes(1) == ()
    assert all(before == after for before, after in (*comparison.classes.values(), *comparison.overall.values()))
