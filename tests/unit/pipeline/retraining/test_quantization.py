from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from tests.world.drawn import DrawnWorld, spec
from tests.world.world import settings_of
from valerie.analysis.wording import points
from valerie.cli.main import app
from valerie.errors import Conflict, InvalidInput, UnknownName
from valerie.pipeline.base.context import Context
from valerie.pipeline.functions.references import open_reference
from valerie.pipeline.retraining.quantization import QuantizedVersion, quantize_function

ALONG_THE_STREET = [["person-1.pos.y", "HOMOGENEOUS", 5.0, 35.0, 5.0]]


@pytest.fixture(scope="module")
def drawn(tmp_path_factory: pytest.TempPathFactory) -> tuple[Context, str]:
    """A drawn run of 14 frames, seven places before two cameras, with one function."""
    world = DrawnWorld(settings_of(tmp_path_factory.mktemp("quantization")))
    return world.context, world.work(spec("small", vary=ALONG_THE_STREET, functions=["semantic-fpn-small"]))


@pytest.fixture(scope="module")
def version(drawn: tuple[Context, str]) -> QuantizedVersion:
    return quantize_function(*drawn, "semantic-fpn-small", "fast", frames=3)


def test_the_int8_version_is_registered_and_predicts(drawn: tuple[Context, str], version: QuantizedVersion) -> None:
    assert version.new
    assert (version.registered.document.kind, version.registered.document.precision) == ("onnx", "int8")
    with closing(open_reference("fast", context=drawn[0])) as function:
        assert "-int8-" in function.numeric_class
        assert function.predict(np.zeros((64, 96, 3), np.uint8)).shape == (64, 96)


def test_both_versions_are_compared_on_all_frames_of_the_run(version: QuantizedVersion) -> None:
    assert version.comparison.versions == ("semantic-fpn-small", "fast")
    assert version.comparison.groups[0].frames == 14
    assert "-int8-" in version.comparison.numeric_classes[1]


def test_the_card_states_frames_origin_and_the_change_of_pacc(
    drawn: tuple[Context, str], version: QuantizedVersion
) -> None:
    stated = version.registered.document.provenance
    assert stated["calibrated on"] == f"3 frames of run {drawn[1]}"
    assert stated["quantized from"].startswith("semantic-fpn-small, ")
    everyone = version.comparison.groups[0]
    change = stated["change of pACC by int8"]
    assert change.startswith(f"{points(everyone.differences[0].mean)} points by place")
    assert change.endswith(f", {everyone.persons} persons of run {drawn[1]}")


def test_the_command_prints_the_comparison_and_the_line_for_a_spec(
    drawn: tuple[Context, str], version: QuantizedVersion
) -> None:
    context, run_id = drawn
    arguments = ["function", "quantize", "semantic-fpn-small", "--from", run_id, "--frames", "3", "--name", "fast"]
    result = CliRunner().invoke(app, [*arguments, "--data-dir", str(context.settings.data_dir)], catch_exceptions=False)
    assert result.exit_code == 0, result.output
    assert "pACC" in result.stdout
    assert f"registered already as fast@{version.registered.digest[:12]}" in result.stderr
    assert "functions: [fast]" in result.stderr


def test_an_installed_name_is_refused_before_any_work(drawn: tuple[Context, str]) -> None:
    with pytest.raises(Conflict, match="'semantic-fpn-small' belongs to a function that is installed"):
        quantize_function(*drawn, "semantic-fpn-small", "semantic-fpn-small", frames=3)


def test_a_function_that_the_run_lacks_is_refused(drawn: tuple[Context, str]) -> None:
    with pytest.raises(UnknownName, match="deeplabv3plus-small"):
        quantize_function(*drawn, "deeplabv3plus-small", "fast", frames=3)


def test_a_program_of_a_package_is_refused(drawn: tuple[Context, str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("valerie.pipeline.functions.references.FUNCTIONS", ())
    with pytest.raises(InvalidInput, match="function: a program of an installed package has no file"):
        quantize_function(*drawn, "semantic-fpn-small", "fast", frames=3)


def test_without_finished_frames_nothing_is_quantised(tmp_path: Path) -> None:
    world = DrawnWorld(settings_of(tmp_path))
    run_id = world.work(spec("new", functions=["semantic-fpn-small"]), products=0)
    with pytest.raises(Conflict, match="has no finished frames yet"):
        quantize_function(world.context, run_id, "semantic-fpn-small", "fast", frames=3)
