import json
from collections.abc import Iterator
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.world.drawn import CHARACTERS, TOWN, DrawnWorld, installed_town, spec
from tests.world.world import settings_of
from valerie.db import runs
from valerie.db.engine import reading
from valerie.errors import Conflict, InvalidInput, NotFound, UnknownName
from valerie.perception.importing.function_file import read_header
from valerie.perception.running.small_network import small_onnx
from valerie.perception.shipped import file_document, function_path
from valerie.perception.training.frame_folder import SEEDS, FrameFolder
from valerie.pipeline.base.context import Context
from valerie.pipeline.functions import registry
from valerie.pipeline.functions.references import open_reference, pinned_network
from valerie.pipeline.retraining.retrain import register_retrained, retrain, training_folder
from valerie.pipeline.retraining.weakness import find_weakness, selected_region
from valerie.runs.products.pins import FunctionPin
from valerie.runs.study.retraining import RetrainSettings

FAR = "distance_m > 25"
PLACES = [
    ["person-1.pos.x", "HOMOGENEOUS", -1.0, 6.0, 3.5],
    ["person-1.pos.y", "HOMOGENEOUS", 5.0, 35.0, 15.0],
    ["person-1.character", "CHOICE", list(CHARACTERS)],
]


@pytest.fixture(scope="module", autouse=True)
def town(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    with installed_town(tmp_path_factory.mktemp("town")):
        yield


@pytest.fixture(scope="module")
def drawn(tmp_path_factory: pytest.TempPathFactory) -> tuple[Context, str]:
    """A drawn run over an asset that takes a seed: both functions, distances of 17 to 47 m."""
    world = DrawnWorld(settings_of(tmp_path_factory.mktemp("retraining")))
    return world.context, world.work(spec("weak", asset=TOWN, vary=PLACES))


def pin(drawn: tuple[Context, str], digest: str, kind: str | None = None) -> FunctionPin:
    """Return a pin as that of the run, with another digest and kind."""
    context, run_id = drawn
    with reading(context.engine) as connection:
        pins = runs.get(connection, run_id).pins
    assert pins is not None
    return pins.functions["semantic-fpn-small"].model_copy(update={"digest": digest, "kind": kind})


def test_a_weakness_names_the_region_the_weights_and_sites_that_nobody_saw(drawn: tuple[Context, str]) -> None:
    weakness = find_weakness(*drawn, FAR, "semantic-fpn-small")
    assert 0 < weakness.selected < weakness.evaluated
    bound = weakness.region.bounds["distance_m"]
    assert bound.holds(40.0)
    assert not bound.holds(18.0)
    assert weakness.file == function_path("semantic-fpn-small")
    sites = weakness.document.provenance["frames-street-seeds"]
    assert weakness.first_seed() == int(sites.split("-")[-1]) + 1
    assert weakness.first_seed() in SEEDS["train"]
    assert (weakness.reference, weakness.next_name) == ("semantic-fpn-small", "semantic-fpn-small-retrained")
    ours = replace(weakness, function="my-net")
    assert (ours.reference, ours.next_name) == (f"my-net@{weakness.document.digest[:12]}", "my-net")
    assert (weakness.asset, weakness.asset_seed) == (TOWN, 0)
    assert selected_region(*drawn, FAR, "semantic-fpn-small") == weakness.region


def test_absent_persons_are_no_evidence(drawn: tuple[Context, str]) -> None:
    assert "character" not in find_weakness(*drawn, FAR, "semantic-fpn-small").region.bounds


def test_what_cannot_be_trained_against_is_refused(drawn: tuple[Context, str]) -> None:
    with pytest.raises(InvalidInput, match="several functions"):
        find_weakness(*drawn, FAR)
    with pytest.raises(UnknownName, match="did you mean semantic-fpn-small"):
        find_weakness(*drawn, FAR, "semantic-fpn-smal")
    with pytest.raises(InvalidInput, match="selects none"):
        find_weakness(*drawn, "distance_m > 900", "semantic-fpn-small")
    with pytest.raises(UnknownName, match="distance_m"):
        find_weakness(*drawn, "distance > 9", "semantic-fpn-small")


def test_weights_that_are_not_those_of_the_run_are_refused(drawn: tuple[Context, str]) -> None:
    with pytest.raises(Conflict, match=r"used other weights of semantic-fpn-small \(000000000000\)"):
        pinned_network("semantic-fpn-small", pin(drawn, "0" * 64), context=drawn[0])


def test_a_registered_network_is_trained_on_from_the_version_that_the_run_saw(
    drawn: tuple[Context, str], tmp_path: Path
) -> None:
    context, path = drawn[0], function_path("semantic-fpn-small")
    document = file_document("my-net", path).model_copy(update={"engine": "openvino"})
    registered, _ = registry.register(context, document, path)
    registry.register(context, document.model_copy(update={"provenance": {"newer": "yes"}}), path)
    pinned, file = pinned_network("my-net", pin(drawn, registered.digest, "network"), context=context)
    assert pinned == document
    assert file.read_bytes() == path.read_bytes()
    registry.remove(context, registered.reference)
    with pytest.raises(NotFound, match=rf"my-net@{registered.digest[:12]}: it was removed"):
        pinned_network("my-net", pin(drawn, registered.digest, "network"), context=context)


def test_functions_without_a_network_of_ours_are_not_trained_on(drawn: tuple[Context, str], tmp_path: Path) -> None:
    registered, _ = registry.register(drawn[0], *small_onnx(tmp_path))
    with pytest.raises(InvalidInput, match="small, kind onnx"):
        pinned_network("small", pin(drawn, registered.digest, "onnx"), context=drawn[0])
    with pytest.raises(InvalidInput, match="installed package"):
        pinned_network("plug-in", pin(drawn, "0" * 64), context=drawn[0])


def test_another_training_gets_another_folder_and_the_same_one_the_same(drawn: tuple[Context, str]) -> None:
    weakness, settings = find_weakness(*drawn, FAR, "semantic-fpn-small"), RetrainSettings()
    folder = training_folder(weakness, settings, "name")
    assert folder == training_folder(find_weakness(*drawn, FAR, "semantic-fpn-small"), RetrainSettings(), "name")
    assert folder != training_folder(weakness, settings.model_copy(update={"steps": 301}), "name")
    other = find_weakness(*drawn, FAR, "deeplabv3plus-small")
    assert folder != training_folder(other, settings, "name")


def test_an_asset_without_seeds_has_no_fresh_sites(tmp_path: Path) -> None:
    world = DrawnWorld(settings_of(tmp_path))
    run_id = world.work(spec("boxes", functions=["semantic-fpn-small"]))
    with pytest.raises(InvalidInput, match="fresh sites"):
        find_weakness(world.context, run_id, FAR, "semantic-fpn-small")


@pytest.mark.gl
@pytest.mark.slow
@pytest.mark.processes
def test_a_new_version_is_trained_and_says_where_it_comes_from(drawn: tuple[Context, str], tmp_path: Path) -> None:
    weakness = find_weakness(*drawn, FAR, "semantic-fpn-small")
    settings = RetrainSettings(
        frames=2, sites=1, width=320, height=180, steps=2, batch=2, held_out_frames=0, broad_share=0.5
    )
    retrained = retrain(weakness, tmp_path / "new.safetensors", settings, folder=tmp_path / "work")
    header = read_header(retrained.file)
    assert header.digest == retrained.digest != read_header(weakness.file).digest
    assert header.provenance["started-from"] == read_header(weakness.file).digest
    assert header.longest_side == read_header(weakness.file).longest_side is not None
    assert header.provenance["retrained-where"] == FAR
    assert json.loads(header.provenance["retrained-region"]) == weakness.region.model_dump(mode="json")
    frames = FrameFolder(tmp_path / "work" / "frames")
    assert len(frames) == retrained.frames == 2
    assert frames.site_seeds == {weakness.first_seed()}
    assert retrained.drawn >= 2
    assert int(frames.listing.provenance["scenes-drawn"]) == retrained.drawn
    assert retrained.curve == tmp_path / "work" / "curve.png"
    context = drawn[0]
    registered, new = register_retrained(context, retrained, weakness.next_name)
    assert new
    assert (registered.document.name, registered.version) == ("semantic-fpn-small-retrained", 1)
    assert registered.document.input == weakness.document.input, "how frames go in stays"
    with closing(open_reference(registered.reference, context=context)) as opened:
        assert opened.card.provenance["started-from"] == header.provenance["started-from"]
        assert opened.predict(np.zeros((64, 96, 3), np.uint8)).shape == (64, 96)
    again = retrain(weakness, tmp_path / "again.safetensors", settings, folder=tmp_path / "work")
    assert again.steps == 2  # from the checkpoint: nothing was rendered or trained again
    assert not register_retrained(context, again, weakness.next_name)[1], "the same training is the same version"
    with pytest.raises(InvalidInput, match="another training"):
        retrain(
            weakness, tmp_path / "x.safetensors", settings.model_copy(update={"steps": 3}), folder=tmp_path / "work"
        )
