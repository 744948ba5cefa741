"""`valerie function …` without a server: what it prints, writes and refuses."""

from __future__ import annotations

import json
import re
from contextlib import nullcontext
from functools import partial
from pathlib import Path

import pytest
import yaml
from typer.testing import CliRunner

from tests.world.boxes import write_box_street
from valerie.answers import Function, RegisteredFunction
from valerie.cli.main import app
from valerie.cli.registering import functions_named, register_file
from valerie.errors import InvalidInput, NotFound
from valerie.perception.running.small_network import small_onnx


@pytest.fixture
def valerie(tmp_path: Path):  # type: ignore[no-untyped-def]
    """Runs a command on a data folder of its own; returns its standard output."""

    def run(*arguments: object) -> str:
        command = [*map(str, arguments), "--data-dir", str(tmp_path / "data")]
        result = CliRunner().invoke(app, command, catch_exceptions=False)
        assert result.exit_code == 0, result.output
        return result.stdout

    return run


@pytest.fixture
def onnx(tmp_path: Path) -> Path:
    return small_onnx(tmp_path)[1]


@pytest.fixture
def side(tmp_path: Path) -> Path:
    path = tmp_path / "side.yaml"
    path.write_text("output: {classes: [road, person]}\nengine: onnxruntime\n")
    return path


def test_import_prints_the_card_and_the_line_for_a_spec(  # type: ignore[no-untyped-def]
    valerie, onnx: Path, side: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(onnx.parent)  # as people call it: by a name in this folder
    printed = valerie("function", "import", onnx.name, "--document", side.name, "--name", "mine")
    assert printed.rstrip().endswith("functions: [mine]")
    assert "road, person" in printed
    assert "runs: onnxruntime-" in printed


def test_a_file_is_tried_on_frames_without_being_registered(  # type: ignore[no-untyped-def]
    valerie, onnx: Path, side: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_box_street(tmp_path / "assets" / "box-street")
    monkeypatch.setenv("VALERIE_ASSET_DIR", str(tmp_path / "assets"))
    spec = tmp_path / "spec.yaml"
    spec.write_text("name: t\nasset: box-street\nresolution: {width: 96, height: 54}\n")
    sheet = tmp_path / "sheet.png"
    printed = valerie("function", "try", onnx, "--document", side, "--spec", spec, "--frames", 1, "--output", sheet)
    assert re.search(r"^classes +2: road, person$", printed, re.MULTILINE)
    assert re.search(r"^person +[\d,]+ +[\d.]+ +[\d.]+ +(person|road) ", printed, re.MULTILINE)
    assert sheet.read_bytes().startswith(b"\x89PNG")
    assert not (tmp_path / "data").exists()


class Received:
    """A registry that keeps what it is asked to register."""

    texts: dict[str, str]

    def register_function(self, texts: dict[str, str], payload: Path, folder: Path) -> None:
        self.texts = texts


def test_a_document_beside_a_hugging_face_folder_adds_to_what_the_folder_says(tmp_path: Path) -> None:
    folder = tmp_path / "segformer.b0"
    folder.mkdir()
    config = {"model_type": "segformer", "id2label": {"0": "road", "1": "person"}}
    (folder / "config.json").write_text(json.dumps(config))
    (folder / "model.safetensors").write_bytes(b"weights")
    folder.with_name("segformer.b0.yaml").write_text("name: mine\noutput: {class_map: {road: void}}\n")
    registry = Received()
    register_file(lambda: nullcontext(registry), folder)  # type: ignore[arg-type, return-value]
    document = json.loads(registry.texts["document"])
    assert document["name"] == "mine"
    assert (document["output"]["classes"], document["output"]["class_map"]) == (["road", "person"], {"road": "void"})


def test_a_registered_function_is_listed_shown_exported_and_removed(  # type: ignore[no-untyped-def]
    valerie, onnx: Path, side: Path, tmp_path: Path
) -> None:
    imported = json.loads(valerie("function", "import", onnx, "--document", side, "--json"))
    listed = json.loads(valerie("function", "list", "--json"))
    assert [function["reference"] for function in listed if function["version"]] == [imported["reference"]]
    assert imported["digest"] in valerie("function", "show", "small")
    valerie("function", "export", "small", tmp_path / "out")
    assert (tmp_path / "out" / "small.onnx").read_bytes() == onnx.read_bytes()
    document = yaml.safe_load((tmp_path / "out" / "small.yaml").read_text())
    assert document["output"]["classes"] == ["road", "person"]
    again = json.loads(
        valerie(
            "function",
            "import",
            tmp_path / "out" / "small.onnx",
            "--document",
            tmp_path / "out" / "small.yaml",
            "--json",
        )
    )
    assert (again["digest"], again["new"]) == (imported["digest"], False), "what was exported is the same function"
    valerie("function", "remove", imported["reference"])
    with pytest.raises(InvalidInput, match="unknown registered function 'small'"):
        valerie("function", "show", "small")


def test_without_a_deployment_the_installed_functions_are_listed_and_nothing_is_written(
    valerie, tmp_path: Path
) -> None:  # type: ignore[no-untyped-def]
    assert "semantic-fpn-small" in valerie("function", "list")
    assert not (tmp_path / "data").exists()


def test_the_card_of_a_shipped_function_shows_input_and_output(valerie) -> None:  # type: ignore[no-untyped-def]
    printed = valerie("function", "show", "semantic-fpn-small")
    for title in ("digest", "classes", "input size", "reduction", "normalisation", "channel order", "precision"):
        assert re.search(rf"^{title} +\S", printed, re.MULTILINE), title
    (listed,) = re.findall(
        r"^semantic-fpn-small +installed +([0-9a-f]{12}) +network ", valerie("function", "list"), re.MULTILINE
    )
    assert re.search(rf"^digest +{listed}", printed, re.MULTILINE), "the list calls it by the same digest"


def test_nothing_to_import_is_an_error(valerie, tmp_path: Path) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(InvalidInput, match="nothing to import"):
        valerie("function", "import")
    with pytest.raises(NotFound, match="there is no file"):
        valerie("function", "import", tmp_path / "none.onnx")


@pytest.fixture
def spec(tmp_path: Path) -> Path:
    path = tmp_path / "spec.yaml"
    path.write_text(
        "name: r\nasset: urban-street\nvary: [[person-1.pos.x, HOMOGENEOUS, 1.5, 5.5, 1.0]]\n"
        "functions: [deeplabv3plus-small]\n"
    )
    return path


def test_other_functions_than_the_specs_are_planned(valerie, spec: Path) -> None:  # type: ignore[no-untyped-def]
    plan = json.loads(valerie("plan", spec, "--functions", "semantic-fpn-small,deeplabv3plus-small", "--json"))
    forecast = json.loads(valerie("plan", spec, "--json"))
    assert plan["evaluations"] == 2 * forecast["evaluations"]
    with pytest.raises(InvalidInput, match="unknown function 'mine'"):
        valerie("plan", spec, "--functions", "mine")


def test_a_missing_file_among_the_functions_of_a_spec_is_said_to_be_missing(spec: Path, tmp_path: Path) -> None:
    spec.write_text(spec.read_text().replace("deeplabv3plus-small", "net.onnx"))
    result = CliRunner().invoke(app, ["plan", str(spec), "--data-dir", str(tmp_path / "data")])
    assert "net.onnx: no such file" in result.stderr
    assert "unknown function 'net.onnx'" in str(result.exception)


def test_a_file_in_place_of_a_name_is_registered_with_the_document_beside_it(  # type: ignore[no-untyped-def]
    valerie, onnx: Path, side: Path, spec: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    side.rename(onnx.with_suffix(".yaml"))
    monkeypatch.chdir(onnx.parent)
    forecast = json.loads(valerie("plan", spec, "--json"))
    plan = json.loads(valerie("plan", spec, "--functions", f"{onnx.name}, semantic-fpn-small", "--json"))
    assert plan["evaluations"] == 2 * forecast["evaluations"]
    version = json.loads(valerie("function", "show", "small", "--json"))
    assert (version["classes"], version["engine"]) == (["road", "person"], "onnxruntime")
    again = json.loads(valerie("function", "import", onnx, "--json"))
    assert (again["reference"], again["new"]) == (version["reference"], False), "the same file, whichever way it comes"


def test_a_registered_file_stands_for_its_own_version(onnx: Path) -> None:
    registry = Registered()
    assert functions_named(f"a, b@123456 ,{onnx}", partial(nullcontext, registry)) == ["a", "b@123456", "small@1"]
    assert registry.given == [({}, onnx)]


def test_a_name_that_looks_like_a_file_is_a_name_while_there_is_no_such_file(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    registry = Registered()
    assert functions_named("net.onnx", partial(nullcontext, registry)) == ["net.onnx"]
    assert capsys.readouterr().err == "net.onnx: no such file; taken as the name of a function\n"
    with pytest.raises(NotFound, match="there is no file"):
        functions_named(f"{tmp_path}/net.onnx", partial(nullcontext, registry))
    assert registry.given == []


def test_a_file_of_another_kind_is_said_to_be_none_of_a_function(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("net.png").write_bytes(b"")
    assert functions_named("net.png", partial(nullcontext, Registered())) == ["net.png"]
    said = capsys.readouterr().err
    assert said.startswith("net.png: not a file of a function (")
    assert ".onnx" in said


class Registered:
    """A registry that records its arguments."""

    def __init__(self) -> None:
        self.given: list[tuple[dict[str, str], Path | None]] = []

    def register_function(self, texts: dict[str, str], payload: Path | None, folder: Path) -> RegisteredFunction:
        assert folder.is_dir()
        self.given.append((texts, payload))
        card = {"name": "small", "digest": "", "architecture": "", "precision": "", "engine": "", "provenance": {}}
        members = {**card, "card": (), "numeric_classes": (), "reference": f"small@{len(self.given)}"}
        return RegisteredFunction(Function.model_validate(members), True)
