"""Statements of the documents: links resolve, settings, commands and targets exist, examples work."""

from __future__ import annotations

import re
import shlex
import tomllib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any
from urllib.parse import unquote
from xml.etree import ElementTree

import numpy as np
import pytest
import typer.main
import yaml

from tests.plugin_package import write_package
from tools.architecture_picture import PICTURE, layers, picture
from valerie import plugins
from valerie.cli.main import app
from valerie.cli.shell import Exit
from valerie.guided.domain import Cube
from valerie.guided.strategy import Strategy
from valerie.loading import load_document
from valerie.parameters.samplers import SamplerFactory
from valerie.perception.base import PerceptionFunction
from valerie.perception.documents.function import parse_function
from valerie.pipeline.functions.probe import probe_function
from valerie.rendering.base import Renderer, View
from valerie.rendering.engine import EVERYTHING, Ability
from valerie.runs.resolving.spec import parse, resolve
from valerie.scene.assets.asset import asset_manifest
from valerie.scene.assets.manifest import parse_manifest
from valerie.settings import PREFIX, Settings
from valerie.testing.assets import simple_asset
from valerie.testing.perception import PerceptionContract
from valerie.testing.samplers import SamplerContract
from valerie.testing.strategies import StrategyContract

ROOT = Path(__file__).parents[2]
DOCUMENTS = sorted([*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")])
EVERY = pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: str(path.relative_to(ROOT)))

#: Tables of the documents that must be complete.
OPERATIONS = (ROOT / "docs" / "operations.md").read_text("utf-8")
EXTENDING = (ROOT / "docs" / "extending.md").read_text("utf-8")
ARCHITECTURE = (ROOT / "docs" / "architecture.md").read_text("utf-8")


def blocks(text: str, language: str) -> list[str]:
    """The fenced blocks of a language."""
    return re.findall(rf"```{language}\n(.*?)```", text, re.DOTALL)


def prose(text: str) -> str:
    """The text without fenced blocks."""
    return re.sub(r"```.*?```", "", text, flags=re.DOTALL)


def anchor(heading: str) -> str:
    """The fragment that a heading gets."""
    return re.sub(r"[^\w\- ]", "", heading.strip().lower()).replace(" ", "-")


def names_in(text: str, pattern: str) -> set[str]:
    """Every first group of ``pattern`` in code spans and fenced blocks."""
    code = [*re.findall(r"`([^`\n]+)`", prose(text)), *re.findall(r"```\w*\n(.*?)```", text, re.DOTALL)]
    return {match for piece in code for match in re.findall(pattern, piece, re.MULTILINE)}


@EVERY
def test_relative_links_lead_to_files_and_headings(document: Path) -> None:
    for target in re.findall(r"\]\(([^)\s]+)\)", prose(document.read_text("utf-8"))):
        if re.match(r"[a-z]+:", target):
            continue
        path, _, fragment = unquote(target).partition("#")
        linked = document.parent / path if path else document
        assert linked.exists(), f"{target} leads nowhere"
        if fragment:
            headings = re.findall(r"^#+ (.+)$", linked.read_text("utf-8"), re.MULTILINE)
            assert fragment in {anchor(heading) for heading in headings}, f"{target} has no such heading"


@EVERY
def test_named_variables_are_settings(document: Path) -> None:
    settings = {PREFIX + name.upper() for name in Settings.model_fields}
    of_set_up = set(re.findall(r"VALERIE_SETUP_[A-Z_]+", (ROOT / "bin" / "setup").read_text("utf-8")))
    named = set(re.findall(r"VALERIE_[A-Z0-9_]+", document.read_text("utf-8")))
    of_tests = {name for name in named if name.startswith("VALERIE_TEST_")}
    assert named - {"VALERIE_"} - of_tests <= settings | of_set_up


#: Longest line of prose.
WIDTH = 100


@EVERY
def test_prose_wraps_at_one_width(document: Path) -> None:
    lines = re.sub(r"`[^`\n]+`", "", prose(document.read_text("utf-8"))).splitlines()
    assert [line for line in lines if len(line) > WIDTH and line[:1] not in "|#!["] == []


@EVERY
def test_named_files_of_the_tree_exist(document: Path) -> None:
    roots = "valerie|urban_street|services|tests|tools|benchmarks|examples|migrations|docs"
    named = re.findall(rf"`((?:{roots})/[\w./-]+)`", prose(document.read_text("utf-8")))
    assert [path for path in named if not (ROOT / path).exists()] == []


def test_the_layout_names_every_package_of_the_tree_and_nothing_else() -> None:
    (layout,) = [block for block in blocks(ARCHITECTURE, "text") if "valerie/" in block]
    tree = layout.partition("valerie/\n")[2]
    shown, parent = set(), ""
    for indent, name in re.findall(r"^( +)([\w.]+/?) ", tree, re.MULTILINE):
        parent = parent if len(indent) > 2 else name
        shown.add(name if len(indent) == 2 else parent + name)
    assert shown == {
        *_members("valerie"),
        *(f"{name}/{inner}" for name in EXPANDED for inner in _members(f"valerie/{name}")),
    }


#: Packages whose own packages the layout shows.
EXPANDED = ("analysis", "perception", "pipeline", "runs", "scene")


def _members(folder: str) -> Iterator[str]:
    """Yield the packages and modules of a folder, packages with a slash."""
    for path in (ROOT / folder).iterdir():
        if (path / "__init__.py").exists():
            yield f"{path.name}/"
        elif path.suffix == ".py" and not path.name.startswith("__"):
            yield path.name


def test_the_picture_of_the_architecture_shows_the_import_contracts() -> None:
    assert PICTURE.read_text("utf-8") == picture(), "run: python -m tools.architecture_picture"


def test_no_box_of_the_picture_leaves_the_box_around_it() -> None:
    boxes = [
        tuple(float(rect.attrib[name]) for name in ("x", "y", "width", "height"))
        for rect in ElementTree.fromstring(picture()).iter("{http://www.w3.org/2000/svg}rect")
        if "x" in rect.attrib
    ]
    for x, y, width, height in boxes:
        for left, top, across, down in boxes:
            apart = x + width <= left or left + across <= x or y + height <= top or top + down <= y
            inside = left <= x and x + width <= left + across and top <= y and y + height <= top + down
            around = x <= left and left + across <= x + width and y <= top and top + down <= y + height
            assert apart or inside or around


def test_the_import_contract_places_every_package_of_the_tree() -> None:
    placed = {name for row in layers() for name in row}
    packages = {path.removesuffix("/").removesuffix(".py") for path in _members("valerie")}
    assert placed - {"services"} == packages


def test_the_table_of_settings_is_complete() -> None:
    rows = set(re.findall(r"^\| `(VALERIE_[A-Z0-9_]+)`", OPERATIONS, re.MULTILINE))
    assert rows == {PREFIX + name.upper() for name in Settings.model_fields}


def test_the_table_of_settings_has_the_defaults() -> None:
    table = dict(re.findall(r"^\| `VALERIE_([A-Z0-9_]+)` \| `?([^|`]+?)`? \|", OPERATIONS, re.MULTILINE))
    for name, field in Settings.model_fields.items():
        default = field.default
        if isinstance(default, bool) or default in (None, "", Path()):
            continue  # told in words
        assert table[name.upper()].replace(",", "") == re.sub(r"\.0$", "", str(default)).replace(",", ""), name


def test_the_table_of_exit_codes_is_complete() -> None:
    section = OPERATIONS.partition("## Exit codes")[2].partition("\n## ")[0]
    codes = {int(code) for code in re.findall(r"^\| (\d+) \|", section, re.MULTILINE)}
    assert codes == {int(code) for code in Exit}


def commands() -> dict[tuple[str, ...], Any]:
    """Every command and subcommand by its words."""
    command_names: dict[tuple[str, ...], Any] = {}
    group: Any = typer.main.get_command(app)
    for name, command in group.commands.items():
        command_names[name,] = command
        command_names |= {(name, inner): command for inner, command in getattr(command, "commands", {}).items()}
    return command_names


@EVERY
def test_named_commands_exist(document: Path) -> None:
    known = set(commands())
    groups = {command[0] for command in known if len(command) == 2}
    text = document.read_text("utf-8")
    # Where a command stands: at the beginning of a code span or a line, or behind a variable's value.
    for first, second in names_in(text, r"^(?:[A-Z_]+=\S+ )*valerie ([a-z]+(?:-[a-z]+)*)(?: ([a-z]+(?:-[a-z]+)*))?"):
        assert (first,) in known, f"valerie {first}"
        if first in groups and second:
            assert (first, second) in known, f"valerie {first} {second}"


@EVERY
def test_named_options_of_commands_exist(document: Path) -> None:
    known = commands()
    for line in names_in(document.read_text("utf-8"), r"^valerie ([a-z][^\n#]*)"):
        words = line.split()
        command = known.get(tuple(words[:2]), known.get(tuple(words[:1])))
        assert command is not None, line
        options = {option for parameter in command.params for option in parameter.opts}
        assert {word for word in words if word.startswith("-")} - {"-"} <= options | {"--help"}, line


@EVERY
def test_commands_that_make_frames_and_networks_are_accepted_as_they_stand(document: Path) -> None:
    for block in blocks(document.read_text("utf-8"), "sh"):
        for line in re.findall(r"^valerie train ((?:frames|fit) [^\n#]+)", block.replace("\\\n", " "), re.MULTILINE):
            name, *arguments = shlex.split(line)
            commands()["train", name].make_context(name, arguments)


@EVERY
def test_named_targets_exist(document: Path) -> None:
    makefile = (ROOT / "Makefile").read_text("utf-8")
    targets = set(re.findall(r"^([a-z][a-z0-9-]*):", makefile, re.MULTILINE))
    targets |= {f"bench-{file.stem[6:].replace('_', '-')}" for file in (ROOT / "benchmarks").glob("bench_*.py")}
    named = names_in(document.read_text("utf-8"), r"(?:^|\s|> )make ([a-z][a-z0-9-]*)")
    assert named <= targets


def test_the_notice_names_every_library_that_the_project_requires() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    lists = [project["dependencies"], *project["optional-dependencies"].values()]
    required = {re.split(r"[^\w.-]", line)[0].lower().replace("_", "-") for lines in lists for line in lines}
    notice = (ROOT / "NOTICE").read_text("utf-8").lower().replace("_", "-")
    named = set(re.findall(r"[a-z0-9][a-z0-9.-]*", notice))
    assert required - {"valerie"} - named == set()


#: How the document of a function begins in the README.
_FUNCTION = "# my.yaml"


def test_the_readmes_document_of_a_function_is_one() -> None:
    functions = [
        block for block in blocks((ROOT / "README.md").read_text("utf-8"), "yaml") if block.startswith(_FUNCTION)
    ]
    payload = {"sha256": "0" * 64, "bytes": 1, "format": "onnx"}
    documents = [parse_function(one, kind="onnx", payload=payload) for one in functions]
    assert [document.output.reached for document in documents] == [("person", "car")]


def specs() -> Iterator[Any]:
    """The YAML of README and docs/spec.md; a part of a spec is completed with a name and an asset."""
    for document in (ROOT / "README.md", ROOT / "docs" / "spec.md"):
        for i, block in enumerate(blocks(document.read_text("utf-8"), "yaml")):
            if not block.startswith(("# manifest.yaml", _FUNCTION)):
                yield pytest.param(block, id=f"{document.name}-{i}")


@pytest.mark.parametrize("text", list(specs()))
def test_examples_of_specs_can_be_run(text: str) -> None:
    spec = parse({"name": "part", "asset": "urban-street", **load_document(text)})
    manifest, digest = asset_manifest(spec.asset)
    run = resolve(
        spec,
        manifest,
        asset_digest=digest,
        engines=("raster", "pyrender"),
        functions=("deeplabv3plus-small", "semantic-fpn-small"),
    )
    assert len(run.space) >= 1
    assert all("no function under test" in warning for warning in run.warnings)


def test_the_two_notations_of_a_parameter_mean_the_same() -> None:
    first, second = (
        parse({"name": "part", "asset": "urban-street", **load_document(block)}).parameters
        for block in blocks((ROOT / "docs" / "spec.md").read_text("utf-8"), "yaml")
        if block.startswith("parameters:")
    )
    manifest, _ = asset_manifest("urban-street")
    ranges = []
    for parameters in (first, second):
        spec = parse({"name": "part", "asset": "urban-street", "parameters": [parameters[0].model_dump()]})
        resolved = resolve(spec, manifest)
        ranges.append(next((d.minimum, d.maximum) for d in resolved.definitions if d.name == "p1"))
    assert ranges == [(0.0, 5.0), (0.0, 5.0)]


def test_the_example_of_a_manifest_is_one() -> None:
    text = next(
        block for block in blocks((ROOT / "README.md").read_text("utf-8"), "yaml") if "# manifest.yaml" in block
    )
    manifest = parse_manifest({"name": "crossing", **yaml.safe_load(text)})
    assert manifest.persons == ("scene.person-1",)


def test_the_errors_of_specs_read_as_they_are_shown() -> None:
    arguments = [
        "vary: {person-1.posx: {choice: [1]}}",
        "vary: {person-1.pos.x: {homogeneous: {from: 0, to: 5, step: 1e-7}}}",
        "vary: {person-1.pos.x: {homogeneous: {from: 0 deg, to: 5, step: 1}}}",
        "parameters: [[p1, scene.person-1.pos.x, FLOAT, 0, 30]]",
    ]
    (shown,) = blocks((ROOT / "docs" / "spec.md").read_text("utf-8"), "text")
    manifest, _ = asset_manifest("urban-street")
    for text, expected in zip(arguments, shown.splitlines(), strict=True):
        with pytest.raises(Exception, match=r".") as caught:
            resolve(parse({"name": "part", "asset": "urban-street", **load_document(text)}), manifest)
        assert str(caught.value) == expected


def python_example(name: str) -> Any:
    """A class of docs/extending.md."""
    settings: dict[str, Any] = {}
    exec(next(block for block in blocks(EXTENDING, "python") if f"class {name}" in block), settings)
    return settings[name]


class TestTheExampleOfAFunction(PerceptionContract):
    @pytest.fixture
    def function(self) -> PerceptionFunction:  # type: ignore[override]
        function: PerceptionFunction = python_example("DarkIsPerson")()
        return function


class TestTheExampleOfASampler(SamplerContract):
    @pytest.fixture
    def factory(self) -> SamplerFactory:
        factory: SamplerFactory = python_example("Golden")
        return factory


class TestTheExampleOfAStrategy(StrategyContract):
    size = 3

    @pytest.fixture
    def build(self) -> Callable[[], Strategy]:
        return lambda: python_example("Corners")(Cube(3), at_least=0.5, seed=0)


@pytest.mark.gl
def test_the_example_of_an_engine_puts_its_filter_before_the_frame() -> None:
    engine: Renderer = python_example("WarmRenderer")()
    plain: Renderer = python_example("WarmRenderer").__mro__[1]()
    view, scene = View("camera-1", 96, 54), simple_asset().base
    try:
        warm, cold = engine.full(scene, view).pixels, plain.full(scene, view).pixels
        np.testing.assert_array_equal(warm, cold * np.array([1.0, 0.875, 0.75], np.float16))
        frame = engine.layer(scene, view).over(engine.background(scene, view))
        np.testing.assert_array_equal(frame.pixels, warm)
    finally:
        engine.close()
        plain.close()


def example_defining(name: str) -> str:
    """Return the Python block of docs/extending.md that defines a class, function or constant."""
    definition = re.compile(rf"^(class |def )?{name}\b", re.MULTILINE)
    return next(block for block in blocks(EXTENDING, "python") if definition.search(block))


def test_the_example_of_a_package_is_offered_where_the_operator_names_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (text,) = blocks(EXTENDING, "toml")
    groups = tomllib.loads(text)["project"]["entry-points"]
    modules = {"my_package.warm": example_defining("WarmRenderer")}
    for module, _, attribute in (target.partition(":") for points in groups.values() for target in points.values()):
        modules[module] = example_defining(attribute or "make_manifest")
    monkeypatch.syspath_prepend(str(write_package(tmp_path, "my-package", modules=modules, entry_points=groups)))
    for variable, value in re.findall(r"^export (VALERIE_PLUGINS)=(\S+)$", EXTENDING, re.MULTILINE):
        monkeypatch.setenv(variable, value)
    (offered,) = probe_function("dark-is-person")
    assert (offered.name, offered.revision, offered.numeric_class) == ("dark-is-person", 1, "numpy-uint8")
    assert "warm" in plugins.renderer_names()
    assert plugins.declared_engine("warm").shows == EVERYTHING - {Ability.NIGHT}
    assert plugins.samplers()["golden"](dimensions=2, count=3, seed=0).points(0, 3).shape == (3, 2)
    assert len(plugins.strategy_of("corners")(Cube(2), at_least=0.5, seed=0, inset=0.1).ask(9)) == 4
    manifest, _ = asset_manifest({"name": "boxes", "bearing_deg": 90.0})
    assert manifest.bearing_deg == 90.0
