from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tests.plugin_package import look_again, write_package
from valerie import plugins
from valerie.errors import InvalidInput, InvalidInputs, MissingDependency, UnknownName
from valerie.parameters.samplers import SAMPLERS
from valerie.perception.catalog import FUNCTIONS
from valerie.runs.spec import parse, resolve
from valerie.scene.assets.asset import asset_manifest

WITNESS = """
from valerie.parameters.samplers.random import RandomSampler as Sampler
from valerie.rendering.cycles.settings import CyclesSettings as Settings
from valerie.testing.blank import BlankFunction as Function
from valerie.testing.blank import BlankRenderer as Renderer
"""
OF_WITNESS = {
    "valerie.renderers": {"mine": "witness:Renderer"},
    "valerie.functions": {"my-function": "witness:Function"},
    "valerie.samplers": {"my_design": "witness:Sampler"},
}


@pytest.fixture
def install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., None]]:
    """Installs a package with plug-ins, and lets the operator name packages."""

    def made(
        points: dict[str, dict[str, str]] = OF_WITNESS, *, package: str = "My_Package", allowed: str = "my-package"
    ) -> None:
        folder = write_package(tmp_path / package, package, modules={"witness": WITNESS}, entry_points=points)
        monkeypatch.syspath_prepend(str(folder))
        monkeypatch.setenv("VALERIE_PLUGINS", allowed)
        look_again()

    yield made
    sys.modules.pop("witness", None)
    look_again()


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


def test_a_missing_library_is_a_clear_error(install) -> None:
    install({"valerie.renderers": {"mine": "no_such_package.engine:Engine"}})
    with pytest.raises(MissingDependency, match="'mine' needs what is not installed"):
        plugins.create_renderer("mine")


def test_settings_of_an_engine_are_complete_whatever_was_said() -> None:
    said = plugins.engine_inputs("cycles", {"quality": "draft"})
    assert said == plugins.engine_inputs("cycles", {"samples": 16, "denoise": True})
    assert said["samples"] == 16
    assert plugins.engine_inputs("cycles", {"quality": "paper"})["samples"] == 1024
    assert plugins.engine_inputs("raster", {}) == {}


def test_what_pictures_cost_follows_the_samples() -> None:
    assert plugins.engine_cost("cycles", {"samples": 256}) == 4 * plugins.engine_cost("cycles", {})
    assert plugins.engine_cost("raster", {}) == 1


@pytest.mark.parametrize(
    ("name", "given", "message"),
    [
        ("cycles", {"sample": 4}, r"renderer.sample: unknown setting of cycles 'sample'; did you mean samples"),
        ("cycles", {"samples": 0}, r"renderer.samples: .*got 0; limit: >= 1"),
        ("cycles", {"samples": "64"}, r"renderer.samples: .*whole number is needed here; got 64"),
        ("cycles", {"quality": "best"}, "renderer.quality: unknown value 'best'; known: draft, high, paper, standard"),
        ("raster", {"samples": 4}, r"renderer.samples: the renderer 'raster' has no settings"),
    ],
)
def test_a_wrong_setting_is_named_with_its_place(name: str, given: dict[str, object], message: str) -> None:
    with pytest.raises(InvalidInputs, match=message):
        plugins.engine_settings(name, given)


def test_a_package_can_add_an_engine_with_settings(install) -> None:
    install(OF_WITNESS | {"valerie.engine_settings": {"mine": "witness:Settings"}})
    assert plugins.engine_inputs("mine", {"samples": 3})["samples"] == 3


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
        said = f"{word} {name}: offered by the package my-package, which VALERIE_PLUGINS does not name"
        with pytest.raises(InvalidInput, match=said):
            use()
        assert "witness" not in sys.modules

    def test_is_told_in_every_place_of_a_spec(self) -> None:
        manifest, _ = asset_manifest("urban-street")
        document = {
            "name": "part",
            "asset": "urban-street",
            "renderer": "mine",
            "functions": ["my-function"],
            "vary": {"person-1.pos.x": {"uniform": {"from": 0, "to": 5}}},
            "design": "my_design",
            "count": 3,
        }
        with pytest.raises(InvalidInputs) as caught:
            resolve(
                parse(document), manifest, engines=plugins.renderer_names(), functions=plugins.function_names(),
                samplers=plugins.samplers(),
            )  # fmt: skip
        offered = "offered by the package my-package, which VALERIE_PLUGINS does not name"
        lines = str(caught.value).splitlines()
        for place in ("renderer: renderer mine", "functions.0: function my-function", "design: design my_design"):
            assert any(line.startswith(f"{place}: {offered}") for line in lines), lines
        assert "witness" not in sys.modules

    def test_is_among_the_notices_for_operators(self) -> None:
        left_out, unused = plugins.look_at_installed()
        assert left_out.startswith("the package my-package offers renderer mine, ")
        assert "function my-function, design my_design; VALERIE_PLUGINS does not name it" in left_out
        assert unused.startswith("VALERIE_PLUGINS names another-package, and no package of this name")


def test_of_two_packages_only_the_named_one_is_offered(install) -> None:
    install()
    install({"valerie.functions": {"theirs": "witness:Function"}}, package="other", allowed="other, ")
    assert plugins.function_names() == (*FUNCTIONS, "theirs")
    assert plugins.look_at_installed()[0].startswith("the package my-package offers")


def test_a_misspelt_name_still_has_near_matches_beside_packages_that_are_left_out(install) -> None:
    install(allowed="")
    with pytest.raises(UnknownName, match="did you mean raster"):
        plugins.create_renderer("rastre")
