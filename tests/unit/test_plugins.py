from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.plugin_package import write_package
from valerie import plugins
from valerie.errors import InvalidInput, InvalidInputs, MissingDependency, UnknownName
from valerie.parameters.samplers import SAMPLERS
from valerie.perception.shipped import FUNCTIONS
from valerie.pipeline.base.pinning import choose_pins
from valerie.runs.resolving.spec import ResolvedRun, parse, resolve
from valerie.scene.assets.manifest import Manifest
from valerie.testing.assets import simple_manifest

WITNESS = """
from valerie.parameters.samplers.random import RandomSampler as Sampler
from valerie.testing.blank import BlankFunction as Function
"""
ENGINE = """
from valerie.rendering.engine import Ability, Engine, EngineSettings


class Settings(EngineSettings):
    samples: int = 8


ENGINE = Engine(
    "pictures:MyRenderer",
    settings=Settings,
    shows=frozenset({Ability.FOG}),
    install_hint="`make mine` installs it",
)
"""
PICTURES = """
from valerie.testing.blank import BlankRenderer


class MyRenderer(BlankRenderer):
    def __init__(self, settings):
        self.samples = settings.samples
"""
OF_WITNESS = {
    "valerie.renderers": {"mine": "engine_of_mine:ENGINE"},
    "valerie.functions": {"my-function": "witness:Function"},
    "valerie.samplers": {"my_design": "witness:Sampler"},
}


@pytest.fixture
def install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., None]]:
    """Return a function that installs a package with plug-ins and lets the operator name packages."""

    def install_package(
        points: dict[str, dict[str, str]] = OF_WITNESS,
        *,
        package: str = "My_Package",
        allowed: str = "my-package",
        witness: str = WITNESS,
    ) -> None:
        modules = {"witness": witness, "engine_of_mine": ENGINE, "pictures": PICTURES}
        folder = write_package(tmp_path / package, package, modules=modules, entry_points=points)
        monkeypatch.syspath_prepend(str(folder))
        monkeypatch.setenv("VALERIE_PLUGINS", allowed)

    yield install_package
    for module in ("witness", "engine_of_mine", "pictures"):
        sys.modules.pop(module, None)


def test_names_are_listed_without_importing_what_they_name() -> None:
    assert plugins.renderer_names() == ("raster", "pyrender", "cycles")
    assert plugins.function_names() == FUNCTIONS
    assert "blank" in plugins.renderer_names(testing=True)
    assert "blank" in plugins.function_names(testing=True)


def test_an_unknown_engine_names_near_matches() -> None:
    with pytest.raises(UnknownName, match="did you mean raster"):
        plugins.create_renderer("rastre")


def test_a_package_can_add_an_engine_a_function_and_a_sampler(install) -> None:
    install()
    assert "mine" in plugins.renderer_names()
    assert plugins.create_renderer("mine").name == "blank"
    assert "my-function" in plugins.function_names()
    assert plugins.create_function("my-function").card.name == "blank"
    assert plugins.samplers()["my_design"] is SAMPLERS["random"]


def test_a_package_cannot_take_over_a_built_in_name(install) -> None:
    install({"valerie.renderers": {"raster": "os:system"}, "valerie.samplers": {"sobol": "witness:Sampler"}})
    assert plugins.renderer_names() == ("raster", "pyrender", "cycles")
    assert plugins.samplers()["sobol"] is SAMPLERS["sobol"]


@pytest.mark.parametrize("engine", ["no_such_package.engine:ENGINE", "witness:ENGINE_WITHOUT_LIBRARY"])
def test_a_missing_library_is_a_clear_error(install, engine: str) -> None:
    declared = (
        'from valerie.rendering.engine import Engine\nENGINE_WITHOUT_LIBRARY = Engine("no_such_package:Renderer")\n'
    )
    install({"valerie.renderers": {"mine": engine}}, witness=WITNESS + declared)
    with pytest.raises(MissingDependency, match="'mine' is not installed"):
        plugins.create_renderer("mine")


def test_settings_of_an_engine_are_complete_whatever_was_said() -> None:
    inputs = plugins.engine_inputs("cycles", {"quality": "draft"})
    assert inputs == plugins.engine_inputs("cycles", {"samples": 16, "denoise": True})
    assert inputs["samples"] == 16
    assert plugins.engine_inputs("cycles", {"quality": "paper"})["samples"] == 1024
    assert plugins.engine_inputs("raster", {}) == {}


def test_what_pictures_cost_follows_the_samples() -> None:
    assert plugins.engine_cost("cycles", {"samples": 256}) == 4 * plugins.engine_cost("cycles", {})
    assert plugins.engine_cost("raster", {}) == 1


@pytest.mark.parametrize(
    ("name", "settings", "message"),
    [
        ("cycles", {"sample": 4}, r"renderer.sample: unknown setting of cycles 'sample'; did you mean samples"),
        ("cycles", {"samples": 0}, r"renderer.samples: .*got 0; limit: >= 1"),
        ("cycles", {"samples": "64"}, r"renderer.samples: .*whole number is needed here; got 64"),
        ("cycles", {"quality": "best"}, "renderer.quality: unknown value 'best'; known: draft, high, paper, standard"),
        ("raster", {"samples": 4}, r"renderer.samples: the renderer 'raster' has no settings"),
    ],
)
def test_a_wrong_setting_is_named_with_its_place(name: str, settings: dict[str, object], message: str) -> None:
    with pytest.raises(InvalidInputs, match=message):
        plugins.engine_inputs(name, settings)


def boxes_in_weather() -> Manifest:
    """Return the manifest of boxes with weather, lamps, and a sun that may set."""
    document = simple_manifest().model_dump(mode="json")
    kept = [entry for entry in document["parameters"] if entry["path"] != "scene.sun-1.elevation"]
    weather = [
        {"path": "scene.environment-1.rain", "minimum": 0, "maximum": 50, "default": 0},
        {"path": "scene.environment-1.cloud_cover", "minimum": 0, "maximum": 1, "default": 0},
        {"path": "scene.environment-1.visibility", "minimum": 30, "maximum": 20_000, "default": 20_000},
        {"path": "scene.environment-1.street_lamps", "choices": ["auto", "on", "off"], "default": "auto"},
        {"path": "scene.sun-1.elevation", "minimum": -20, "maximum": 85, "default": 45},
    ]
    return Manifest.model_validate({**document, "parameters": [*kept, *weather]})


class TestAnEngineOfAPackage:
    """It declares everything itself: settings, abilities, and how people get it."""

    @pytest.fixture(autouse=True)
    def _installed(self, install: Callable[..., None]) -> None:
        install()

    def run(self, **more: Any) -> ResolvedRun:
        document = {
            "name": "part",
            "asset": "boxes",
            "renderer": "mine",
            "functions": [],
            "vary": {"person-1.pos.x": {"uniform": {"from": 0, "to": 5, "count": 2}}},
            **more,
        }
        return resolve(parse(document), boxes_in_weather(), engines=plugins.renderer_names())

    def test_is_made_with_its_settings(self) -> None:
        renderer = plugins.create_renderer("mine", {"samples": 3})
        assert vars(renderer) == {"samples": 3}
        assert plugins.engine_inputs("mine", {}) == {"samples": 8}

    def test_is_known_without_importing_what_makes_pictures(self) -> None:
        self.run(renderer={"name": "mine", "samples": 2})
        assert "engine_of_mine" in sys.modules
        assert "pictures" not in sys.modules

    def test_shows_what_it_declares(self) -> None:
        assert self.run(constants={"environment-1.visibility": "200 m"}).spec.engine == "mine"

    @pytest.mark.parametrize(("path", "value"), [("rain", 5), ("cloud_cover", 0.5), ("street_lamps", "on")])
    def test_refuses_weather_and_lamps_that_it_does_not_declare(self, path: str, value: object) -> None:
        with pytest.raises(InvalidInputs, match=r"the engine 'mine' cannot render it; .*limit: raster, cycles"):
            self.run(constants={f"environment-1.{path}": value})

    def test_without_nights_it_wants_the_sun_above_the_horizon(self) -> None:
        with pytest.raises(InvalidInputs, match="elevation"):
            self.run(constants={"sun-1.elevation": "-10 deg"})

    def test_names_how_people_get_it_to_a_run_that_waits(self) -> None:
        spec = parse({"name": "waits", "asset": "boxes", "renderer": "mine"})
        assert "'mine' (`make mine` installs it)" in str(choose_pins(spec, [], {})[1])


class TestAPackageThatTheOperatorDoesNotName:
    @pytest.fixture(autouse=True)
    def _installed(self, install: Callable[..., None]) -> None:
        install(allowed="another-package")

    def test_offers_nothing(self) -> None:
        assert plugins.renderer_names() == ("raster", "pyrender", "cycles")
        assert plugins.function_names() == FUNCTIONS
        assert plugins.samplers() == SAMPLERS

    @pytest.mark.parametrize(
        ("use", "word", "name"),
        [
            (lambda: plugins.create_renderer("mine"), "renderer", "mine"),
            (lambda: plugins.create_function("my-function"), "function", "my-function"),
            (lambda: plugins.require_renderer("mine", field="renderer"), "renderer", "mine"),
            (lambda: plugins.require_function("my-function", field="function"), "function", "my-function"),
        ],
    )
    def test_is_told_with_the_switch_and_not_imported(self, use: Callable[[], object], word: str, name: str) -> None:
        message = f"{word} {name}: offered by the package my-package, which VALERIE_PLUGINS does not name"
        with pytest.raises(InvalidInput, match=message):
            use()
        assert not {"witness", "engine_of_mine"} & set(sys.modules)

    def test_is_told_in_every_place_of_a_spec(self) -> None:
        document = {
            "name": "part",
            "asset": "boxes",
            "renderer": "mine",
            "functions": ["my-function"],
            "vary": {"person-1.pos.x": {"uniform": {"from": 0, "to": 5}}},
            "design": "my_design",
            "count": 3,
        }
        with pytest.raises(InvalidInputs) as caught:
            resolve(
                parse(document), boxes_in_weather(), engines=plugins.renderer_names(), functions=plugins.function_names(),
                samplers=plugins.samplers(),
            )  # fmt: skip
        offered = "offered by the package my-package, which VALERIE_PLUGINS does not name"
        lines = str(caught.value).splitlines()
        for place in ("renderer: renderer mine", "functions.0: function my-function", "design: design my_design"):
            assert any(line.startswith(f"{place}: {offered}") for line in lines), lines
        assert not {"witness", "engine_of_mine"} & set(sys.modules)

    def test_is_among_the_notices_for_operators(self) -> None:
        left_out, unused = plugins.look_at_installed()
        assert left_out.startswith("the package my-package offers renderer mine, ")
        assert "function my-function, design my_design; VALERIE_PLUGINS does not name it" in left_out
        assert unused.startswith("VALERIE_PLUGINS names another-package, but no package of this name")


def test_of_two_packages_only_the_named_one_is_offered(install) -> None:
    install()
    install({"valerie.functions": {"theirs": "witness:Function"}}, package="other", allowed="other, ")
    assert plugins.function_names() == (*FUNCTIONS, "theirs")
    assert plugins.look_at_installed()[0].startswith("the package my-package offers")


def test_a_misspelt_name_still_has_near_matches_beside_packages_that_are_left_out(install) -> None:
    install(allowed="")
    with pytest.raises(UnknownName, match="did you mean raster"):
        plugins.create_renderer("rastre")
