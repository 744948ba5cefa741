import copy
import json
from pathlib import Path
from typing import ClassVar

import numpy as np
import pyarrow.parquet as pq
import pytest
from cityscapesscripts.evaluation import evalPixelLevelSemanticLabeling
from numpy.typing import NDArray
from PIL import Image

from tests.unit.datasets.frames import labelled
from valerie.analysis.rows.table import EvaluationTable
from valerie.datasets import cityscapes
from valerie.datasets.cityscapes import CityscapesFolder
from valerie.datasets.twins import person_twins
from valerie.errors import InferenceError, InvalidInput
from valerie.labels import PERSON, TRAIN_LABELS, VOID, to_train_ids
from valerie.perception.base import FunctionCard, PerceptionFunction
from valerie.pipeline.retraining.dataset_evaluation import DatasetResult, compare_twins, evaluate_dataset

FRAMES = 4


class Forgetful:
    """Knows the frames by their pictures, and makes the same mistakes each time: wrong classes and some void."""

    revision: ClassVar[int] = 1
    numeric_class = "test"

    def __init__(self, name: str, quality: float) -> None:
        self.card = FunctionCard(name, "0" * 64, "test", "fp32", "numpy", {})
        self._quality = quality
        self._truth = {labelled(n).picture.tobytes(): labelled(n).class_map for n in range(FRAMES)}
        self.closed = False

    def predict(self, picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
        truth = to_train_ids(self._truth[picture.tobytes()])
        generator = np.random.default_rng(int(picture.sum()))
        wrong = generator.choice([*range(19), VOID], truth.shape).astype(np.uint8)
        return np.where((generator.random(truth.shape) < self._quality) & (truth != VOID), truth, wrong)

    def close(self) -> None:
        self.closed = True


@pytest.fixture
def folder(tmp_path: Path) -> CityscapesFolder:
    for number in range(FRAMES):
        cityscapes.write_picture(tmp_path / "set", "val", labelled(number))
        cityscapes.write_labels(tmp_path / "set", "val", labelled(number))
    return CityscapesFolder(tmp_path / "set", "val")


def opener(reference: str) -> PerceptionFunction:
    return Forgetful(reference, {"good": 0.9, "poor": 0.5}[reference])


@pytest.fixture
def result(folder: CityscapesFolder) -> DatasetResult:
    return evaluate_dataset(folder, ["good", "poor"], open_function=opener)


def test_class_scores_are_those_of_cityscapes_scripts(
    folder: CityscapesFolder, result: DatasetResult, tmp_path: Path
) -> None:
    predicted, truth = [], []
    function = opener("poor")
    for frame in folder:
        path = cityscapes.write_prediction(tmp_path / "out", "val", frame.name, "poor", function.predict(frame.picture))
        predicted.append(str(tmp_path / "out" / path))
        truth.append(str(folder.root / cityscapes.labels_path("val", frame.name, "labelIds.png")))
    args = copy.deepcopy(evalPixelLevelSemanticLabeling.args)
    args.quiet, args.JSONOutput, args.evalInstLevelScore = True, False, False
    expected = evalPixelLevelSemanticLabeling.evaluateImgLists(predicted, truth, args)
    scores = result.functions[1].scores
    for label in TRAIN_LABELS:
        theirs, ours = expected["classScores"][label.name], scores.of(label).iou.pooled
        assert (ours is None and np.isnan(theirs)) or ours == pytest.approx(theirs, abs=1e-12), label.name
    assert scores.overall.miou_cityscapes.pooled == pytest.approx(expected["averageScoreClasses"], abs=1e-12)


def test_the_data_set_is_read_once_per_function_and_functions_are_closed(folder: CityscapesFolder) -> None:
    opened: list[Forgetful] = []

    def keep(reference: str) -> PerceptionFunction:
        assert all(call.closed for call in opened)  # one network at a time
        opened.append(Forgetful(reference, 0.9))
        return opened[-1]

    evaluate_dataset(folder, ["a", "b"], open_function=keep)
    assert len(opened) == 2
    assert all(call.closed for call in opened)


def test_persons_have_counts_of_their_own_and_nothing_that_labels_cannot_tell(
    folder: CityscapesFolder, result: DatasetResult
) -> None:
    table = result.table()
    assert len(table) == 2 * FRAMES * 2
    assert table.codes("instance_id").names == ("24001", "24002")
    assert np.isnan(table.numbers("occlusion_rate")).all()
    assert np.isnan(table.numbers("distance_m")).all()
    frame, function = folder[0], opener("good")
    right = function.predict(frame.picture) == PERSON.train_id
    first = table.codes("frame_id").where(str(frame.name)) & table.codes("function").where("good")
    assert table.numbers("tp")[first].tolist() == [
        float((right & (frame.instance_map == number)).sum()) for number in (24_001, 24_002)
    ]


def test_documents_and_tables_are_written_and_read_back(result: DatasetResult, tmp_path: Path) -> None:
    files = result.write(tmp_path / "out")
    assert [path.name for path in files] == ["evaluation.json", "frames.parquet", "persons.parquet"]
    document = json.loads(files[0].read_text())
    good = document["functions"]["good"]
    assert good["classes"]["person"]["pacc"]["pooled"] == result.functions[0].scores.of(PERSON).pacc.pooled
    assert np.array(good["confusion"]).sum() == sum((to_train_ids(labelled(n).class_map) < 19).sum() for n in range(4))
    assert len(document["digest"]) == 64
    assert good["person_pacc"]["defined"] == 2 * FRAMES
    rows = pq.read_table(files[1]).to_pylist()
    assert len(rows) == 2 * FRAMES
    assert len(EvaluationTable.from_parquet(files[2])) == 4 * FRAMES


def test_without_instance_ids_there_are_frames_but_no_persons(folder: CityscapesFolder, tmp_path: Path) -> None:
    for path in folder.root.glob("gtFine/val/*/*_instanceIds.png"):
        path.unlink()
    result = evaluate_dataset(CityscapesFolder(folder.root, "val"), ["good"], open_function=opener)
    assert not result.has_instances
    assert result.functions[0].person_pacc.mean is None
    assert result.functions[0].scores.of(PERSON).pacc.frames.defined == FRAMES
    assert not any(path.name == "persons.parquet" for path in result.write(tmp_path / "out"))


def test_what_cityscapes_ignores_counts_nowhere(folder: CityscapesFolder) -> None:
    before = evaluate_dataset(folder, ["good"], open_function=opener).functions[0].scores.matrix
    path = folder.root / cityscapes.labels_path("val", labelled(0).name, "labelIds.png")
    with Image.open(path) as image:
        ids = np.array(image)
    ids[:, :20] = np.resize([0, 1, 2, 3, 4, 5, 6, 9, 10, 14, 15, 16, 18, 29, 30, 255], ids[:, :20].shape)
    Image.fromarray(ids).save(path)
    after = evaluate_dataset(folder, ["good"], open_function=opener).functions[0].scores.matrix
    lost = (to_train_ids(labelled(0).class_map)[:, :20] != VOID).sum()
    assert before.sum() - after.sum() == lost


def test_a_function_that_answers_another_size_is_refused(folder: CityscapesFolder) -> None:
    class Small(Forgetful):
        def predict(self, picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
            return super().predict(picture)[::2]

    with pytest.raises(InferenceError, match=r"\(12, 40\)"):
        evaluate_dataset(folder, ["x"], open_function=lambda name: Small(name, 1.0))


def test_a_function_is_named_once(folder: CityscapesFolder) -> None:
    with pytest.raises(InvalidInput, match="--function"):
        evaluate_dataset(folder, ["good", "good"], open_function=opener)
    with pytest.raises(InvalidInput, match="--function"):
        evaluate_dataset(folder, [], open_function=opener)
    with pytest.raises(InvalidInput, match="--function"):
        evaluate_dataset(folder, ["one/good.safetensors", "two/good.safetensors"], open_function=opener)


def test_two_versions_of_one_function_stay_apart(folder: CityscapesFolder) -> None:
    qualities = {"net@aaaaaa": 0.5, "net@bbbbbb": 0.9}
    versions = evaluate_dataset(
        folder, list(qualities), open_function=lambda name: Forgetful("net", qualities[name])
    ).as_document()["functions"]
    assert list(versions) == ["net@aaaaaa", "net@bbbbbb"]
    assert versions["net@aaaaaa"]["person_pacc"]["mean"] < versions["net@bbbbbb"]["person_pacc"]["mean"]


def test_twins_are_compared_person_by_person(folder: CityscapesFolder, result: DatasetResult) -> None:
    twins = person_twins(folder, folder)
    worse = evaluate_dataset(folder, ["good", "poor"], open_function=lambda name: opener("poor"))
    compared = compare_twins(result, worse, twins)
    scores = compared["good"]
    table = result.table()
    own = table.numbers("pacc")[table.codes("function").where("good")]
    other = worse.table().numbers("pacc")[: len(own)]
    assert scores.pacc_here == pytest.approx(own.mean())
    assert scores.pacc_there == pytest.approx(other.mean())
    assert scores.fidelity.persons == 2 * FRAMES
    assert scores.fidelity.only_there == int(((own >= 0.5) & (other < 0.5)).sum()) > 0
    assert scores.fidelity.low is None  # one recording place
    assert compared["poor"].fidelity.share == 1.0
    assert compared["poor"].as_document()["same_outcome"] == 1.0


def test_twins_without_a_common_person_are_refused(result: DatasetResult) -> None:
    with pytest.raises(InvalidInput, match="share no person"):
        compare_twins(result, result, [])
