import hashlib
import json
import math
from collections.abc import Callable, Iterator
from pathlib import Path

import mlcroissant
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from cityscapesscripts.evaluation.evalPanopticSemanticLabeling import pq_compute_single_core
from cityscapesscripts.preparation.createPanopticImgs import convert2panoptic
from jsonschema import Draft7Validator
from PIL import Image
from vcd.schema import openlabel_schema

from tests.world.blank import Pipeline, completed_run
from valerie.analysis.rows.table import EvaluationTable
from valerie.datasets import cityscapes
from valerie.datasets.cityscapes import CityscapesFolder
from valerie.datasets.frame import FrameName
from valerie.datasets.index import IndexRow
from valerie.db import frames, results
from valerie.db.engine import reading
from valerie.errors import Conflict, InvalidInput, NotFound, StorageFull, UnknownName
from valerie.labels import to_label_ids
from valerie.pipeline.export.datasets import export_run
from valerie.pipeline.export.export_plan import ExportSettings
from valerie.pipeline.export.frame_files import Fragment
from valerie.pipeline.reading.frame_pictures import find_picture, paint_picture
from valerie.pipeline.reading.product_reader import ProductReader
from valerie.pipeline.retraining.dataset_evaluation import evaluate_dataset, run_side
from valerie.runs.products.frame_keys import FrameKey
from valerie.testing.blank import BlankFunction


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> tuple[Pipeline, str]:
    """24 frames: 12 places, two cameras; only to be read."""
    return completed_run(tmp_path_factory.mktemp("datasets"))


def test_a_whole_run_comes_back_exactly(run: tuple[Pipeline, str], tmp_path: Path) -> None:
    pipeline, run_id = run
    steps: list[tuple[int, int, float, str]] = []
    exported = export_run(pipeline.context, run_id, tmp_path / "set", progress=lambda *step: steps.append(step))
    assert exported.frames == {"val": 24}
    assert exported.left_out == 0
    assert [done for done, *_ in steps] == list(range(1, 25))
    exported_frames = CityscapesFolder(tmp_path / "set", "val")
    assert len(exported_frames) == 24
    name = FrameName.of("boxes-camera-2", 5, 0)
    frame = next(frame for frame in exported_frames if frame.name == name)
    np.testing.assert_array_equal(
        frame.picture,
        paint_picture(pipeline.context, find_picture(pipeline.context, FrameKey(run_id, 5, 1), kind="picture")),
    )
    with reading(pipeline.context.engine) as connection:
        truth = ProductReader(pipeline.context.store).truth(
            frames.get(connection, FrameKey(run_id, 5, 1)).products.truth
        )
    np.testing.assert_array_equal(frame.class_map, truth.class_map)
    np.testing.assert_array_equal(frame.instance_map, truth.instance_map)
    camera = json.loads((tmp_path / "set" / cityscapes.camera_path("val", name)).read_text())
    assert set(camera) == {"extrinsic", "intrinsic"}
    assert not list(tmp_path.glob(".*"))  # nothing is left beside it


def test_the_index_has_a_row_per_person_with_parameters_and_files(run: tuple[Pipeline, str], tmp_path: Path) -> None:
    pipeline, run_id = run
    export_run(pipeline.context, run_id, tmp_path / "set", ExportSettings(formats=("cityscapes", "parquet")))
    rows = pq.read_table(tmp_path / "set/index.parquet").to_pylist()
    persons = [row for row in rows if row["pixel_area"]]
    assert len({row["frame_id"] for row in rows}) == 24
    assert len(persons) == 24
    person = next(row for row in persons if row["frame_id"] == f"{run_id}.5.1.0")
    assert person["pixel_area_amodal"] >= person["pixel_area"] == 32 * 18
    assert person["distance_m"] > 0
    assert -3.0 <= person["scene.person-1.pos.x"] <= -2.7
    assert (tmp_path / "set" / person["picture"]).is_file()
    assert (tmp_path / "set" / person["label_ids"]).is_file()
    assert not (tmp_path / "set/coco").exists()


def test_fragments_keep_the_types_of_parameters() -> None:
    row: IndexRow = {
        "scene.bus-101.visible": False,
        "sensor.noise.shot": True,
        "instance_id": 0,
        "time_s": 1.0,
        "box": None,
    }
    fragment = Fragment(name="frame", split="val", rows=[row])
    (kept,) = Fragment.model_validate_json(fragment.model_dump_json()).rows
    assert {name: (type(value), value) for name, value in kept.items()} == {
        name: (type(value), value) for name, value in row.items()
    }


def test_croissant_describes_every_file_and_every_column(run: tuple[Pipeline, str], tmp_path: Path) -> None:
    pipeline, run_id = run
    folder = tmp_path / "set"
    export_run(pipeline.context, run_id, folder, ExportSettings(predictions=("blank",), polygons=True))
    document = json.loads((folder / "croissant.json").read_text())
    files = {entry["@id"]: entry for entry in document["distribution"] if entry["@type"] == "cr:FileObject"}
    sets = [entry for entry in document["distribution"] if entry["@type"] == "cr:FileSet"]
    for path, one in files.items():
        assert one["contentUrl"] == path
        assert one["sha256"] == hashlib.sha256((folder / path).read_bytes()).hexdigest()
    described = {*files, *(str(path.relative_to(folder)) for one in sets for path in folder.glob(one["includes"]))}
    present = {str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file()}
    assert described == present - {"croissant.json"}
    kinds = {"sc:Integer": pa.types.is_integer, "sc:Float": pa.types.is_floating, "sc:Boolean": pa.types.is_boolean}
    for records in document["recordSet"]:
        table = records["field"][0]["source"]["fileObject"]["@id"]
        schema = pq.read_schema(folder / table)
        assert [one["source"]["extract"]["column"] for one in records["field"]] == schema.names
        for one, kind in zip(records["field"], schema.types, strict=True):
            assert one["description"]
            assert one.get("repeated", False) == pa.types.is_list(kind)
            assert kinds.get(one["dataType"], lambda _: True)(kind.value_type if pa.types.is_list(kind) else kind)
    assert [records["@id"] for records in document["recordSet"]] == ["persons", "evaluations"]


@pytest.mark.filterwarnings("ignore::DeprecationWarning")  # of the libraries that it uses
def test_mlcroissant_accepts_the_description_and_reads_the_records(run: tuple[Pipeline, str], tmp_path: Path) -> None:
    pipeline, run_id = run
    folder = tmp_path / "set"
    export_run(pipeline.context, run_id, folder, ExportSettings(predictions=("blank",), polygons=True))
    described = mlcroissant.Dataset(jsonld=folder / "croissant.json")
    assert not described.metadata.ctx.issues.errors
    for name, path in (("persons", "index.parquet"), ("evaluations", "evaluations.parquet")):
        table = pq.read_table(folder / path)
        records = list(described.records(name))
        assert len(records) == table.num_rows
        assert list(records[0]) == [f"{name}/{column}" for column in table.column_names]
    document = json.loads((folder / "croissant.json").read_text())
    del document["distribution"][0]["contentUrl"]
    with pytest.raises(mlcroissant.ValidationError, match="contentUrl"):
        mlcroissant.Dataset(jsonld=document)


def test_croissant_uses_only_terms_that_its_context_defines(run: tuple[Pipeline, str], tmp_path: Path) -> None:
    pipeline, run_id = run
    export_run(pipeline.context, run_id, tmp_path / "set")
    document = json.loads((tmp_path / "set/croissant.json").read_text())
    # Of schema.org's vocabulary, which is the context's default.
    of_schema = {
        "name", "description", "version", "datePublished", "license", "distribution", "contentUrl", "encodingFormat",
        "sha256",
    }  # fmt: skip

    def keys(part: object) -> Iterator[str]:
        if isinstance(part, dict):
            for key, value in part.items():
                yield key
                yield from keys(value)
        elif isinstance(part, list):
            for value in part:
                yield from keys(value)

    context = document.pop("@context")
    used = {key for key in keys(document) if not key.startswith("@")}
    assert used - context.keys() == of_schema
    assert document["conformsTo"] == "http://mlcommons.org/croissant/1.0"


def test_coco_documents_name_files_that_are_there(run: tuple[Pipeline, str], tmp_path: Path) -> None:
    pipeline, run_id = run
    export_run(pipeline.context, run_id, tmp_path / "set", ExportSettings(formats=("coco",)))
    instances, panoptic = (
        json.loads((tmp_path / f"set/coco/{kind}_val.json").read_text()) for kind in ("instances", "panoptic")
    )
    assert len(instances["images"]) == len(panoptic["annotations"]) == 24
    assert all((tmp_path / "set/leftImg8bit/val" / image["file_name"]).is_file() for image in instances["images"])
    assert all((tmp_path / "set/coco/panoptic_val" / a["file_name"]).is_file() for a in panoptic["annotations"])
    assert len({a["id"] for a in instances["annotations"]}) == len(instances["annotations"]) == 24
    assert all({"a_segm", "occlusion_rate", "distance_m"} <= a.keys() for a in instances["annotations"])
    assert not (tmp_path / "set/gtFine").exists()


def test_cityscapes_scripts_find_every_segment_of_the_panoptic_pictures_where_the_labels_have_it(
    run: tuple[Pipeline, str], tmp_path: Path
) -> None:
    pipeline, run_id = run
    out = tmp_path / "set"
    export_run(pipeline.context, run_id, out, ExportSettings(formats=("cityscapes", "coco")))
    convert2panoptic(str(out / "gtFine"), str(tmp_path), setNames=["val"])
    theirs = json.loads((tmp_path / "cityscapes_panoptic_val.json").read_text())
    ours = json.loads((out / "coco/panoptic_val.json").read_text())
    images = {image["id"]: image["file_name"] for image in ours["images"]}
    named = {images[annotation["image_id"]]: annotation for annotation in ours["annotations"]}
    truth = {
        f"{annotation['image_id'].split('_')[0]}/{annotation['image_id']}_leftImg8bit.png": annotation
        for annotation in theirs["annotations"]
    }
    assert truth.keys() == named.keys()
    categories = {category["id"]: category for category in theirs["categories"]}
    pairs = [(truth[file], named[file]) for file in truth]
    folders = (str(tmp_path / "cityscapes_panoptic_val"), str(out / "coco/panoptic_val"))
    stat = pq_compute_single_core(0, pairs, *folders, categories)
    everything, _ = stat.pq_average(categories, isthing=None)
    assert everything["pq"] == everything["sq"] == everything["rq"] == 1.0
    assert (stat[24].tp, stat[24].fp, stat[24].fn) == (24, 0, 0)


def test_an_expression_chooses_frames_by_metadata_parameters_and_scores(
    run: tuple[Pipeline, str], tmp_path: Path
) -> None:
    pipeline, run_id = run

    def names(text: str) -> set[str]:
        out = tmp_path / str(len(list(tmp_path.iterdir())))
        export_run(pipeline.context, run_id, out, ExportSettings(formats=("cityscapes",), where=text))
        return {str(name) for name in CityscapesFolder(out, "val").names}

    assert len(names("camera == 'camera-1'")) == 12
    assert len(names("person-1.pos.x < -2.85")) == 12
    detected, missed = names("pacc > 0.5"), names("pacc <= 0.5")
    assert len(detected) + len(missed) == 24
    assert not detected & missed


def test_a_choice_that_is_empty_or_misspelt_is_refused_before_anything_is_written(
    run: tuple[Pipeline, str], tmp_path: Path
) -> None:
    pipeline, run_id = run
    for text, error in (("distance_m > 1000", InvalidInput), ("distanse_m > 1", UnknownName)):
        with pytest.raises(error):
            export_run(pipeline.context, run_id, tmp_path / "set", ExportSettings(where=text))
    with pytest.raises(UnknownName, match="function of the run"):
        export_run(pipeline.context, run_id, tmp_path / "set", ExportSettings(predictions=("blink",)))
    with pytest.raises(NotFound):
        export_run(pipeline.context, "nothing", tmp_path / "set")
    assert not list(tmp_path.iterdir())


def test_predictions_travel_with_their_scores(run: tuple[Pipeline, str], tmp_path: Path) -> None:
    pipeline, run_id = run
    settings = ExportSettings(where="camera == 'camera-2'", predictions=("blank",))
    export_run(pipeline.context, run_id, tmp_path / "set", settings)
    name = FrameName.of("boxes-camera-2", 3, 0)
    with reading(pipeline.context.engine) as connection:
        (evaluation,) = results.frame_evaluations(connection, FrameKey(run_id, 3, 1))
    predicted = ProductReader(pipeline.context.store).prediction(evaluation.prediction)
    path = tmp_path / "set" / cityscapes.prediction_path("blank", "val", name)
    np.testing.assert_array_equal(np.asarray(Image.open(path)), to_label_ids(predicted))
    table = EvaluationTable.from_parquet(tmp_path / "set/evaluations.parquet")
    assert len(set(table.codes("frame_id").names)) == 12
    assert table.codes("camera").names == ("camera-2",)


def test_splits_keep_the_frames_of_a_variant_together(run: tuple[Pipeline, str], tmp_path: Path) -> None:
    pipeline, run_id = run
    settings = ExportSettings(formats=("cityscapes",), splits={"train": 0.6, "val": 0.4})
    exported = export_run(pipeline.context, run_id, tmp_path / "set", settings)
    assert sum(exported.frames.values()) == 24
    # A split is drawn for each variant, so one of the two may be empty.
    variants = [
        {name.sequence for name in CityscapesFolder(tmp_path / "set", split).names} for split in exported.frames
    ]
    assert sum(map(len, variants)) == len(set().union(*variants)) == 12


def test_shares_follow_the_splits() -> None:
    settings = ExportSettings(splits={"train": 0.7, "val": 0.2, "test": 0.1})
    drawn = [settings.split_of("run", index) for index in range(4000)]
    for split, share in settings.splits.items():
        # Four standard deviations of a binomial share.
        assert abs(drawn.count(split) / 4000 - share) < 4 * math.sqrt(share * (1 - share) / 4000)
    with pytest.raises(InvalidInput, match="add up to 1"):
        ExportSettings(splits={"train": 0.7, "val": 0.2})


def test_an_interrupted_export_goes_on_and_is_never_half_there(run: tuple[Pipeline, str], tmp_path: Path) -> None:
    pipeline, run_id = run

    def stop_at_ten(done: int, *_: object) -> None:
        if done == 10:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        export_run(pipeline.context, run_id, tmp_path / "set", progress=stop_at_ten)
    assert not (tmp_path / "set").exists()
    steps: list[tuple[int, int, float, str]] = []
    export_run(pipeline.context, run_id, tmp_path / "set", progress=lambda *step: steps.append(step))
    assert steps[-1][3] == "10 already there"
    whole = tmp_path / "whole"
    export_run(pipeline.context, run_id, whole)
    assert _files(tmp_path / "set") == _files(whole)


def test_another_request_starts_anew(run: tuple[Pipeline, str], tmp_path: Path) -> None:
    pipeline, run_id = run

    def stop(*_: object) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        export_run(pipeline.context, run_id, tmp_path / "set", progress=stop)
    steps: list[tuple[int, int, float, str]] = []
    settings = ExportSettings(where="camera == 'camera-1'")
    export_run(pipeline.context, run_id, tmp_path / "set", settings, progress=lambda *step: steps.append(step))
    assert steps[-1][3] == ""
    assert len(CityscapesFolder(tmp_path / "set", "val")) == 12


def test_nothing_is_written_over(run: tuple[Pipeline, str], tmp_path: Path) -> None:
    pipeline, run_id = run
    (tmp_path / "precious.txt").write_text("kept")
    with pytest.raises(Conflict, match="exists already"):
        export_run(pipeline.context, run_id, tmp_path)


def test_a_disk_without_room_is_told_before_anything_is_written(
    run: tuple[Pipeline, str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pipeline, run_id = run
    usage = type("Usage", (), {"free": 10_000})
    monkeypatch.setattr("valerie.pipeline.export.folder.shutil.disk_usage", lambda _: usage)
    with pytest.raises(StorageFull, match="24 frames"):
        export_run(pipeline.context, run_id, tmp_path / "set")
    assert not list(tmp_path.iterdir())


def test_a_run_without_predictions_yet_is_told(pipelines: Callable[..., Pipeline], tmp_path: Path) -> None:
    pipeline = pipelines()
    run_id = pipeline.submit()
    with pytest.raises(InvalidInput, match="no finished frame"):
        export_run(pipeline.context, run_id, tmp_path / "set")


def _files(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_an_exported_run_evaluated_as_a_data_set_gives_the_scores_of_the_run(
    run: tuple[Pipeline, str], tmp_path: Path
) -> None:
    pipeline, run_id = run
    export_run(pipeline.context, run_id, tmp_path / "set", ExportSettings(formats=("cityscapes",)))
    result = evaluate_dataset(
        CityscapesFolder(tmp_path / "set", "val"), ["blank"], open_function=lambda _: BlankFunction()
    )
    here, there = result.functions[0].scores, run_side(pipeline.context, run_id, "blank").scores
    assert here.as_document() == there.as_document()
    rows = pq.read_table(result.write(tmp_path / "out")[1]).to_pylist()
    assert len(rows) == here.frames == 24


def test_a_version_is_found_by_its_digest_in_a_run_that_calls_it_by_name_alone(run: tuple[Pipeline, str]) -> None:
    pipeline, run_id = run
    digest = pipeline.row(run_id).pins.functions["blank"].digest
    by_name, by_digest = (run_side(pipeline.context, run_id, name) for name in ("blank", f"blank@{digest[:12]}"))
    assert by_digest.called == by_name.called == "blank"
    assert by_digest.scores.as_document() == by_name.scores.as_document()
    with pytest.raises(UnknownName, match="blank@000000"):
        run_side(pipeline.context, run_id, "blank@000000")


def test_openlabel_documents_fit_the_schema_and_name_pictures_that_are_there(
    run: tuple[Pipeline, str], tmp_path: Path
) -> None:
    pipeline, run_id = run
    out = tmp_path / "set"
    export_run(pipeline.context, run_id, out, ExportSettings(formats=("openlabel",)))
    documents = [
        json.loads(path.read_text())["openlabel"] for path in (out / "openlabel/val").rglob("*_openlabel.json")
    ]
    assert len(documents) == 24  # 12 variants, two cameras, one frame each
    pictures = set()
    for content in documents:
        Draft7Validator(openlabel_schema).validate({"openlabel": content})
        (frame,) = content["frames"].values()
        pictures.add(out / frame["frame_properties"]["streams"]["camera"]["uri"])
        (person,) = frame["objects"].values()
        assert [entry["val"][2:] for entry in person["object_data"]["bbox"]] == [[32, 18], [32, 18]]
        measures = {entry["name"]: entry["val"] for entry in person["object_data"]["num"]}
        assert measures["distance_m"] > 0
    assert pictures == set((out / "leftImg8bit").rglob("*.png"))
    assert not (out / "gtFine").exists()
