import json
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[2]))

from sketch.runs import open_sketch, settings_of, spec, work

from valerie.errors import InvalidInput, UnknownName
from valerie.perception.catalog import function_path
from valerie.perception.function_file import read_header
from valerie.perception.training.frames import FrameFolder
from valerie.pipeline.context import Context
from valerie.pipeline.retraining import RetrainSettings, find_weakness, retrain, selected_region
from valerie.pipeline.training_frames import SEEDS

FAR = "distance_m > 25"


@pytest.fixture(scope="module")
def drawn(tmp_path_factory: pytest.TempPathFactory) -> tuple[Context, str]:
    """A drawn run of the real street's manifest: both functions, distances of 17 to 47 m."""
    context, bell = open_sketch(settings_of(tmp_path_factory.mktemp("retraining")))
    return context, work(context, bell, spec("weak"))


def test_a_weakness_names_the_region_the_weights_and_streets_that_nobody_saw(drawn: tuple[Context, str]) -> None:
    weakness = find_weakness(*drawn, FAR, "semantic-fpn-small")
    assert 0 < weakness.selected < weakness.evaluated
    bound = weakness.region.bounds["distance_m"]
    assert bound.holds(40.0)
    assert not bound.holds(18.0)
    assert weakness.file == function_path("semantic-fpn-small")
    seen = weakness.header.provenance["frames-street-seeds"]
    assert weakness.first_seed() == int(seen.split("-")[-1]) + 1
    assert weakness.first_seed() in SEEDS["train"]
    assert (weakness.asset, weakness.asset_seed) == ("urban-street", 0)
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


def test_an_asset_without_seeds_has_no_fresh_streets(
    drawn: tuple[Context, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("valerie.scene.asset.GENERATORS", {"another": "module"})
    with pytest.raises(InvalidInput, match="fresh streets"):
        find_weakness(*drawn, FAR, "semantic-fpn-small")


@pytest.mark.gl
@pytest.mark.slow
@pytest.mark.processes
def test_a_new_version_is_trained_and_says_where_it_comes_from(drawn: tuple[Context, str], tmp_path: Path) -> None:
    weakness = find_weakness(*drawn, FAR, "semantic-fpn-small")
    settings = RetrainSettings(
        frames=2, streets=1, width=320, height=180, steps=2, batch=2, held_out_frames=0, broad_share=0.5
    )
    made = retrain(weakness, tmp_path / "new.safetensors", settings, folder=tmp_path / "work")
    header = read_header(made.file)
    assert header.digest == made.digest != weakness.header.digest
    assert header.provenance["started-from"] == weakness.header.digest
    assert header.provenance["retrained-where"] == FAR
    assert json.loads(header.provenance["retrained-region"]) == weakness.region.model_dump(mode="json")
    frames = FrameFolder(tmp_path / "work" / "frames")
    assert len(frames) == made.frames == 2
    assert frames.street_seeds == {weakness.first_seed()}
    assert made.drawn >= 2
    assert int(frames.listing.provenance["scenes-drawn"]) == made.drawn
    again = retrain(weakness, tmp_path / "again.safetensors", settings, folder=tmp_path / "work")
    assert again.steps == 2  # from the checkpoint: nothing was rendered or trained again
    with pytest.raises(InvalidInput, match="another training"):
        retrain(
            weakness, tmp_path / "x.safetensors", settings.model_copy(update={"steps": 3}), folder=tmp_path / "work"
        )
