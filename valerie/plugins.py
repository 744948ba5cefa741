"""What can be named in a spec, and the class behind each name, imported only when it is asked for.

Four kinds: render engines, functions under test, samplers, and asset packs (`valerie.scene.assets.asset`). Each has what is
built in, and what installed packages declare as entry points, where the operator allows it (`valerie.entry_points`). Names come
from there and from nowhere else: nothing in a message or a spec is ever imported.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import lru_cache
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Final, Literal

from pydantic import BaseModel, ValidationError

from valerie.entry_points import PluginKind, installed, named_packages
from valerie.errors import InvalidInput, InvalidInputs, UnknownName
from valerie.parameters.samplers import SAMPLERS, SamplerFactory
from valerie.perception.base import PerceptionFunction
from valerie.perception.catalog import FUNCTIONS, load_function
from valerie.scene.assets.asset import PACKS
from valerie.validation import problem_of

if TYPE_CHECKING:
    from valerie.rendering.base import EngineSettings, Renderer

#: Accepted in specs only where the settings say so.
TESTING_ENGINE: Final = "blank"


RENDERERS: Final = MappingProxyType(
    {
        "raster": "valerie.rendering.raster.renderer:RasterRenderer",
        "pyrender": "valerie.rendering.pyrender_engine:PyrenderRenderer",
        "cycles": "valerie.rendering.cycles.renderer:CyclesRenderer",
    }
)
#: Engine to what a run that waits for it is told.
ENGINE_HINTS: Final = MappingProxyType({"cycles": "`make cycles` installs it"})
#: What an engine cannot show: name to the attributes of the environment that a spec with it may not name.
_WEATHER: Final = frozenset({"cloud_cover", "visibility", "rain"})
WITHOUT: Final = MappingProxyType({"pyrender": _WEATHER | {"street_lamps", "car_lamps"}})
#: Engines that need the sun above the horizon.
BY_DAY_ONLY: Final = frozenset({"pyrender"})
#: Engines without cut-out textures.
WHOLE_CARDS: Final = frozenset({"pyrender"})
_RENDERERS: Final = PluginKind(
    "renderer", "valerie.renderers", {**RENDERERS, TESTING_ENGINE: "valerie.testing.blank:BlankRenderer"}
)
_ENGINE_SETTINGS: Final = PluginKind(
    "engine settings", "valerie.engine_settings", {"cycles": "valerie.rendering.cycles.settings:CyclesSettings"}
)
_TRUTH_PASSES: Final = PluginKind(
    "truth pass",
    "valerie.truth_passes",
    {"raster": "valerie.rendering.ground_truth:TruthPass", TESTING_ENGINE: "valerie.testing.blank:BlankTruthPass"},
)
_FUNCTIONS: Final = PluginKind("function", "valerie.functions", {TESTING_ENGINE: "valerie.testing.blank:BlankFunction"})
_SAMPLERS: Final = PluginKind("design", "valerie.samplers")


_KINDS: Final = (_RENDERERS, _ENGINE_SETTINGS, _TRUTH_PASSES, _FUNCTIONS, _SAMPLERS, PACKS)


def look_at_installed() -> tuple[str, ...]:
    """Read once what installed packages declare, so that no request waits for it (some 50 ms).

    Returns:
        What an operator may not expect, in sentences: packages that are installed and left out, or named and without plug-ins.
    """
    left_out: dict[str, list[str]] = {}
    for kind in _KINDS:
        for name, package in sorted(kind.left_out().items()):
            left_out.setdefault(package, []).append(f"{kind.word} {name}")
    offering = {offer.package for kind in _KINDS for offer in installed(kind.group)}
    return (
        *(
            f"the package {package} offers {', '.join(left_out[package])}; VALERIE_PLUGINS does not name it"
            for package in sorted(left_out)
        ),
        *(
            f"VALERIE_PLUGINS names {package}, and no package of this name with plug-ins is installed here"
            for package in sorted(named_packages() - offering)
        ),
    )


def unknown_name(
    word: Literal["renderer", "function", "design"], name: str, known: Iterable[str], *, field: str
) -> InvalidInput:
    """The error for a name in a spec that is not among ``known``: near matches, or which switch would allow it."""
    kind = next(kind for kind in _KINDS if kind.word == word)
    return kind.unknown(name, known, field=field)


def renderer_names(*, testing: bool = False) -> tuple[str, ...]:
    """All engines that a spec may name; none is imported."""
    return (*RENDERERS, *_RENDERERS.declared(), *((TESTING_ENGINE,) if testing else ()))


def require_renderer(name: str, *, field: str) -> None:
    """Check a name.

    Raises:
        UnknownName: no such engine.
        InvalidInput: the operator does not allow its package.
    """
    if name not in _RENDERERS.names():
        raise _RENDERERS.unknown(name, _RENDERERS.names(), field=field)


def require_function(name: str, *, field: str) -> None:
    """Check the name of an installed function.

    Raises:
        UnknownName: no such function.
        InvalidInput: the operator does not allow its package.
    """
    known = function_names(testing=True)
    if name not in known:
        raise _FUNCTIONS.unknown(name, known, field=field)


def create_renderer(name: str, settings: Mapping[str, Any] | None = None) -> Renderer:
    """Open an engine, with what a spec says of its settings.

    Raises:
        UnknownName, InvalidInput, MissingDependency: see `PluginKind.load`.
        InvalidInputs: see `engine_settings`.
    """
    engine = _RENDERERS.load(name)
    chosen = engine_settings(name, settings or {})
    renderer: Renderer = engine() if chosen is None else engine(chosen)
    return renderer


def engine_settings(name: str, given: Mapping[str, Any]) -> EngineSettings | None:
    """The settings of an engine; None for one that has none. The engine itself is not imported.

    Raises:
        InvalidInputs: a setting that the engine does not have, or a value that it does not take, as ``renderer.samples``.
    """
    if name not in _ENGINE_SETTINGS.names():
        if given:
            raise InvalidInputs(
                [InvalidInput(f"the renderer {name!r} has no settings", field=f"renderer.{key}") for key in given]
            )
        return None
    model = _ENGINE_SETTINGS.load(name)
    unknown = [key for key in given if key not in model.model_fields]
    if unknown:
        what = f"setting of {name}"
        raise InvalidInputs([UnknownName(what, key, model.model_fields, field=f"renderer.{key}") for key in unknown])
    try:
        settings: EngineSettings = model.model_validate(dict(given))
    except ValidationError as error:
        raise InvalidInputs(
            [problem_of(detail, f"renderer.{detail['loc'][0]}") for detail in error.errors(include_url=False)]
        ) from None
    return settings


def engine_settings_models() -> dict[str, type[BaseModel]]:
    """Built-in engine to the model of its settings."""
    return {name: _ENGINE_SETTINGS.load(name) for name in _ENGINE_SETTINGS.built_in}


def engine_inputs(name: str, given: Mapping[str, Any]) -> dict[str, Any]:
    """All settings that an engine's pixels depend on; see `engine_settings`. Of an engine that is gone: what was given."""
    settings = engine_settings(name, given) if name in _RENDERERS.names() else None
    return dict(given) if settings is None else settings.inputs()


def engine_cost(name: str, given: Mapping[str, Any]) -> float:
    """CPU seconds of a picture relative to the engine's default settings."""
    settings = engine_settings(name, given) if name in _RENDERERS.names() else None
    return 1.0 if settings is None else settings.cost()


def create_truth_pass(numeric_class: str) -> Any:
    """Open the truth pass: one for all engines, but for the numeric class of the testing engine."""
    return _TRUTH_PASSES.load(TESTING_ENGINE if numeric_class == TESTING_ENGINE else "raster")()


def light_engine(numeric_class: str) -> str:
    """The engine that says what light arrives where, for all engines: as `create_truth_pass`."""
    return TESTING_ENGINE if numeric_class == TESTING_ENGINE else "raster"


def function_names(*, testing: bool = False) -> tuple[str, ...]:
    """All functions under test that a spec may name; neither torch nor a network is loaded."""
    return (*FUNCTIONS, *_FUNCTIONS.declared(), *((TESTING_ENGINE,) if testing else ()))


def create_function(name: str, *, threads: int = 1, device: str = "auto") -> PerceptionFunction:
    """Load a function under test; one of an installed package is made by calling its entry point without arguments.

    Raises:
        UnknownName, InvalidInput, MissingDependency: see `PluginKind.load`.
        NotFound, InvalidInput: its file is missing or damaged.
    """
    if name in FUNCTIONS:
        return load_function(name, threads=threads, device=device)
    function: PerceptionFunction = _FUNCTIONS.load(name)()
    return function


@lru_cache(maxsize=1)
def samplers() -> Mapping[str, SamplerFactory]:
    """Name to sampler of all designs that draw variants."""
    plugged: dict[str, SamplerFactory] = {name: _SAMPLERS.load(name) for name in _SAMPLERS.declared()}
    return MappingProxyType({**plugged, **SAMPLERS})
