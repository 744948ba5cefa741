"""The plugins that a spec can name, and the class of each, imported only when needed.

There are five kinds: render engines, functions under test, samplers, strategies of studies, and asset packs
(`valerie.scene.assets.asset`). Each has built-in plugins, and those that installed packages declare as entry points, if the
operator allows it (`valerie.entry_points`).
Names come from nowhere else: nothing in a message or a spec is ever imported.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from importlib import import_module
from pathlib import PurePath
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Final, Literal

from pydantic import ValidationError

from valerie.entry_points import PluginKind, installed, named_packages
from valerie.errors import InvalidInput, InvalidInputs, MissingDependency, UnknownName
from valerie.parameters.definitions import Value
from valerie.parameters.samplers import SAMPLERS, SamplerFactory
from valerie.perception.base import PerceptionFunction
from valerie.perception.running.choice import AUTO
from valerie.perception.shipped import FUNCTIONS, load_function
from valerie.rendering.engine import Engine, EngineSettings
from valerie.scene.assets.asset import PACKS
from valerie.validation import problem_of

if TYPE_CHECKING:
    from valerie.rendering.base import Renderer
    from valerie.rendering.truth import TruthMaker

#: Engine that specs may name only if the settings allow it.
TESTING_ENGINE: Final = "blank"
#: Engines that are built in; all others come from packages.
RENDERERS: Final = ("raster", "pyrender", "cycles")
#: Goals of studies whose strategies are built in.
GOALS: Final = ("estimate", "find", "map", "explain", "verify", "compare", "rank", "cascade")

_RENDERERS: Final = PluginKind(
    "renderer",
    "valerie.renderers",
    {
        **{name: f"valerie.rendering.{name}.engine:ENGINE" for name in RENDERERS},
        TESTING_ENGINE: "valerie.testing.blank:ENGINE",
    },
)
_TRUTH_PASSES: Final = PluginKind(
    "truth pass",
    "valerie.truth_passes",
    {"raster": "valerie.rendering.ground_truth:TruthPass", TESTING_ENGINE: "valerie.testing.blank:BlankTruthPass"},
)
_FUNCTIONS: Final = PluginKind("function", "valerie.functions", {TESTING_ENGINE: "valerie.testing.blank:BlankFunction"})
_SAMPLERS: Final = PluginKind("design", "valerie.samplers")
_STRATEGIES: Final = PluginKind(
    "goal", "valerie.strategies", {name: f"valerie.guided.{name}:{name.capitalize()}" for name in GOALS}
)

#: Program to the engine that runs in it.
_PROGRAMS: Final = {"blender": "cycles"}
#: Suffixes of names in specs that are probably files of functions.
_FUNCTION_FILES: Final = (".onnx", ".safetensors", ".pth", ".pt")

_KINDS: Final = (_RENDERERS, _TRUTH_PASSES, _FUNCTIONS, _SAMPLERS, _STRATEGIES, PACKS)


def look_at_installed() -> tuple[str, ...]:
    """Read the declarations of installed packages (some 50 ms), so that no request waits for it.

    Returns:
        Sentences about packages that are installed but not allowed, or allowed but without plug-ins.
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
            f"VALERIE_PLUGINS names {package}, but no package of this name with plug-ins is installed here"
            for package in sorted(named_packages() - offering)
        ),
    )


def unknown_name(
    word: Literal["renderer", "function", "design", "goal"], name: str, names: Iterable[str], *, field: str
) -> InvalidInput:
    """Return the error for an unknown name in a spec, with near matches or the switch that would allow it."""
    names = tuple(names)
    if word == "renderer" and _PROGRAMS.get(name) in names:
        return InvalidInput(f"unknown renderer {name!r}; did you mean {_PROGRAMS[name]}?", field=field)
    if word == "function" and PurePath(name).suffix in _FUNCTION_FILES:
        return InvalidInput(
            f"unknown function {name!r}",
            field=field,
            limit="names of functions; a file is named with --functions FILE, or registered with "
            "`valerie function import FILE`",
        )
    kind = next(kind for kind in _KINDS if kind.word == word)
    return kind.unknown(name, names, field=field)


def renderer_names(*, testing: bool = False) -> tuple[str, ...]:
    """Return all engines that a spec may name, without importing them."""
    return (*RENDERERS, *_RENDERERS.declared(), *((TESTING_ENGINE,) if testing else ()))


def require_renderer(name: str, *, field: str) -> None:
    """Check the name of an engine.

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
    names = function_names(testing=True)
    if name not in names:
        raise _FUNCTIONS.unknown(name, names, field=field)


def declared_engine(name: str) -> Engine:
    """Return the declaration of an engine, without importing its libraries.

    Raises:
        UnknownName, InvalidInput, MissingDependency: see `PluginKind.load`.
    """
    engine: Engine = _RENDERERS.load(name)
    return engine


def known_engine(name: str) -> Engine | None:
    """Return the declaration of an engine, or None if it is no longer installed: a stored run outlives its engine."""
    return declared_engine(name) if name in _RENDERERS.names() else None


def create_renderer(name: str, settings: Mapping[str, Value] | None = None) -> Renderer:
    """Open an engine with the settings of a spec.

    Raises:
        UnknownName, InvalidInput, MissingDependency: see `PluginKind.load`.
        InvalidInputs: see `engine_settings`.
    """
    engine = declared_engine(name)
    checked_settings = engine_settings(name, engine, settings or {})
    module, _, attribute = engine.renderer.partition(":")
    try:
        opened = getattr(import_module(module), attribute)
    except ImportError as error:
        raise MissingDependency(f"a dependency of the renderer {name!r} is not installed: {error}") from error
    renderer: Renderer = opened(checked_settings) if engine.has_settings else opened()
    return renderer


def engine_settings(name: str, engine: Engine, settings: Mapping[str, Value]) -> EngineSettings:
    """Check the settings that a spec gives an engine.

    Raises:
        InvalidInputs: the engine has no such setting, or refuses its value; the field is e.g. ``renderer.samples``.
    """
    model = engine.settings
    if settings and not engine.has_settings:
        raise InvalidInputs(
            [InvalidInput(f"the renderer {name!r} has no settings", field=f"renderer.{key}") for key in settings]
        )
    unknown = [key for key in settings if key not in model.model_fields]
    if unknown:
        kind = f"setting of {name}"
        raise InvalidInputs([UnknownName(kind, key, model.model_fields, field=f"renderer.{key}") for key in unknown])
    try:
        return model.model_validate(dict(settings))
    except ValidationError as error:
        raise InvalidInputs(
            [problem_of(detail, f"renderer.{detail['loc'][0]}") for detail in error.errors(include_url=False)]
        ) from None


def engine_inputs(name: str, settings: Mapping[str, Value]) -> dict[str, Value]:
    """Return all settings that an engine's pixels depend on; for an engine that is gone, the settings as they are.

    Raises:
        InvalidInputs: see `engine_settings`.
    """
    engine = known_engine(name)
    return dict(settings) if engine is None else engine_settings(name, engine, settings).inputs()


def engine_cost(name: str, settings: Mapping[str, Value]) -> float:
    """Return the CPU seconds of a picture relative to the engine's default settings."""
    engine = known_engine(name)
    return 1.0 if engine is None else engine_settings(name, engine, settings).cost()


def create_truth_pass(numeric_class: str) -> TruthMaker:
    """Open the truth pass, which all engines share; the numeric class of the testing engine has its own."""
    truth_pass: TruthMaker = _TRUTH_PASSES.load(light_engine(numeric_class))()
    return truth_pass


def light_engine(numeric_class: str) -> str:
    """Return the engine that measures the light on surfaces for all engines, given the numeric class of the truth pass."""
    return TESTING_ENGINE if numeric_class.partition("-")[0] == TESTING_ENGINE else "raster"


def function_names(*, testing: bool = False) -> tuple[str, ...]:
    """Return all functions under test that a spec may name, without loading torch or a network."""
    return (*FUNCTIONS, *_FUNCTIONS.declared(), *((TESTING_ENGINE,) if testing else ()))


def create_function(name: str, *, threads: int = 1, device: str = "auto", precision: str = AUTO) -> PerceptionFunction:
    """Load a function under test. The entry point of an installed package is called without arguments.

    Args:
        name: name of a shipped function, or of a function of an installed package.
        threads, device, precision: options of a shipped function; see `valerie.perception.shipped.load_function`.

    Raises:
        UnknownName, InvalidInput, MissingDependency: see `PluginKind.load`.
        NotFound, InvalidInput: its file is missing or damaged.
    """
    if name in FUNCTIONS:
        return load_function(name, threads=threads, device=device, precision=precision)
    function: PerceptionFunction = _FUNCTIONS.load(name)()
    return function


def samplers() -> Mapping[str, SamplerFactory]:
    """Return name to sampler of all designs that draw variants."""
    plugged: dict[str, SamplerFactory] = {name: _SAMPLERS.load(name) for name in _SAMPLERS.declared()}
    return MappingProxyType({**plugged, **SAMPLERS})


def goal_names() -> tuple[str, ...]:
    """Return all goals that a study may name, without importing a strategy."""
    return _STRATEGIES.names()


def strategy_of(name: str) -> Any:
    """Return the factory of a strategy, as `valerie.guided.strategy.StrategyFactory` describes it.

    Raises:
        UnknownName, InvalidInput, MissingDependency: see `PluginKind.load`.
    """
    return _STRATEGIES.load(name)
