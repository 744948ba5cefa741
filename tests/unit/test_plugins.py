from __future__ import annotations

from collections.abc import Iterator
from importlib.metadata import EntryPoint

import pytest

from valerie import plugins
from valerie.errors import MissingDependency, UnknownName
from valerie.parameters.samplers import SAMPLERS
from valerie.perception.catalog import FUNCTIONS


@pytest.fixture
def declare(monkeypatch: pytest.MonkeyPatch) -> Iterator[object]:
    """Pretends that an installed package declares entry points."""
    declared: list[EntryPoint] = []
    monkeypatch.setattr(plugins, "entry_points", lambda group: [p for p in declared if p.group == group])
    plugins.samplers.cache_clear()
    yield lambda group, name, value: declared.append(EntryPoint(name, value, f"valerie.{group}"))
    plugins.samplers.cache_clear()


def test_names_are_listed_without_importing_what_they_name() -> None:
    assert plugins.renderer_names() == ("raster", "pyrender")
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
    assert plugins.renderer_names() == ("raster", "pyrender")
    assert plugins.samplers()["sobol"] is SAMPLERS["sobol"]


def test_a_missing_library_is_a_clear_error(declare) -> None:
    declare("renderers", "mine", "no_such_package.engine:Engine")
    with pytest.raises(MissingDependency, match="'mine' needs what is not installed"):
        plugins.create_renderer("mine")
