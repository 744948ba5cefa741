from __future__ import annotations

from collections.abc import Iterator
from importlib.metadata import EntryPoint, EntryPoints

import pytest

from valerie import plugins
from valerie.errors import InvalidInputs, MissingDependency, UnknownName
from valerie.parameters.samplers import SAMPLERS
from valerie.perception.catalog import FUNCTIONS


@pytest.fixture
def declare(monkeypatch: pytest.MonkeyPatch) -> Iterator[object]:
    """Pretends that an installed package declares entry points."""
    declared: list[EntryPoint] = []
    monkeypatch.setattr(plugins, "_installed", lambda group: EntryPoints(declared).select(group=group))
    plugins.samplers.cache_clear()
    yield lambda group, name, value: declared.append(EntryPoint(name, value, f"valerie.{group}"))
    plugins.samplers.cache_clear()


def test_names_are_listed_without_importing_what_they_name() -> None:
    assert plugins.renderer_names() == ("raster", "pyrender", "cycles")
    assert plugins.function_names() == FUNCTIONS
    assert "blank" in plugins.renderer_names(testing=True)
    assert "blank" in plugins.function_names(testing=True)


def test_an_unknown_engine_names_near_matches() -> None:
    with pytest.raises(UnknownName, match="did you mean raster"):
        plugins.create_renderer("rastre")


def test_a_package_can_add_an_engine_a_function_and_a_sampler(declare) -> None:
    declare("renderers", "mine", "valerie.testing.blank:BlankRenderer")
    declare("functions", "my-function", "valerie.testing.blank:BlankFunction")
    declare("samplers", "my_design", "valerie.parameters.samplers.random:RandomSampler")
    assert "mine" in plugins.renderer_names()
    assert plugins.create_renderer("mine").name == "blank"
    assert "my-function" in plugins.function_names()
    assert plugins.create_function("my-function").card.name == "blank"
    assert plugins.samplers()["my_design"] is SAMPLERS["random"]


def test_a_package_cannot_take_over_a_built_in_name(declare) -> None:
    declare("renderers", "raster", "os:system")
    declare("samplers", "sobol", "valerie.parameters.samplers.random:RandomSampler")
    assert plugins.renderer_names() == ("raster", "pyrender", "cycles")
    assert plugins.samplers()["sobol"] is SAMPLERS["sobol"]


def test_a_missing_library_is_a_clear_error(declare) -> None:
    declare("renderers", "mine", "no_such_package.engine:Engine")
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


def test_a_package_can_add_an_engine_with_settings(declare) -> None:
    declare("renderers", "mine", "valerie.testing.blank:BlankRenderer")
    declare("engine_settings", "mine", "valerie.rendering.cycles.settings:CyclesSettings")
    assert plugins.engine_inputs("mine", {"samples": 3})["samples"] == 3
