"""What can be named in a spec, and the class behind each name, imported only when it is asked for.

Three kinds: render engines, functions under test, samplers. Each has what is built in, and what installed packages declare as
entry points, where the operator names the package in ``VALERIE_PLUGINS``: a plug-in is a program, and being installed (perhaps
for the sake of something else) is no permission to run in every worker. Names come from here and from nowhere else: nothing in
a message or a spec is ever imported.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from importlib import import_module
from importlib.metadata import EntryPoint, EntryPoints, entry_points
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Final, Literal

from pydantic import BaseModel, ValidationError

from valerie.errors import InvalidInput, InvalidInputs, MissingDependency, UnknownName
from valerie.parameters.samplers import SAMPLERS, SamplerFactory
from valerie.perception.base import PerceptionFunction
from valerie.perception.shipped import FUNCTIONS, load_function
from valerie.settings import load_settings
from valerie.spelling import package_name
from valerie.validation import problem_of

if TYPE_CHECKING:
    from valerie.rendering.base import EngineSettings, Renderer

#: Accepted in specs only where the settings say so.
TESTING_ENGINE: Final = "blank"


@lru_cache
def _installed(group: str) -> EntryPoints:
    """What installed packages declare. Kept: it is asked for at each name in a spec, and opens a file of every package."""
    return entry_points(group=group)


@lru_cache
def _allowed() -> frozenset[str]:
    """The packages that the operator named.

    Of this process's environment, as everything that is installed here is: who asks for a name is deep in the science and
    knows no settings.
    """
    return frozenset(load_settings().plugin_packages)


def _package(point: EntryPoint) -> str:
    return package_name(point.dist.name) if point.dist is not None else ""


@dataclass(frozen=True, slots=True)
class _Kind:
    """One kind of plugin: built-in names to ``module:attribute``, and a group of entry points."""

    word: str
    group: str
    built_in: Mapping[str, str]

    def declared(self) -> dict[str, str]:
        """Name to ``module:attribute`` of what allowed packages declare; built-in names cannot be taken over."""
        return {p.name: p.value for p in self._offered() if _package(p) in _allowed()}

    def left_out(self) -> dict[str, str]:
        """Name to package of what is installed and not allowed."""
        names = self.names()
        return {p.name: _package(p) for p in self._offered() if p.name not in names}

    def _offered(self) -> list[EntryPoint]:
        return [point for point in _installed(self.group) if point.name not in self.built_in]

    def names(self) -> set[str]:
        """Of all."""
        return {*self.declared(), *self.built_in}

    def load(self, name: str) -> Any:
        """The attribute behind a name.

        Raises:
            UnknownName: no such name.
            InvalidInput: it is installed, but the operator does not allow its package.
            MissingDependency: a library of it is not installed.
        """
        table = {**self.declared(), **self.built_in}
        if name not in table:
            raise self.unknown(name, table, field=self.word)
        module, _, attribute = table[name].partition(":")
        try:
            return getattr(import_module(module), attribute)
        except ImportError as error:
            raise MissingDependency(f"the {self.word} {name!r} needs what is not installed: {error}") from error

    def unknown(self, name: str, known: Iterable[str], *, field: str) -> InvalidInput:
        """What to say of a name that is not among ``known``: which switch would allow it, or near matches."""
        package = self.left_out().get(name)
        if package is None:
            return UnknownName(self.word, name, known, field=field)
        return InvalidInput(
            f"{self.word} {name}: offered by the package {package}, which VALERIE_PLUGINS does not name",
            field=field,
            limit="whoever operates this deployment can allow it: packages in VALERIE_PLUGINS run as part of VALERIE",
        )


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
_RENDERERS: Final = _Kind(
    "renderer", "valerie.renderers", {**RENDERERS, TESTING_ENGINE: "valerie.testing.blank:BlankRenderer"}
)
_ENGINE_SETTINGS: Final = _Kind(
    "engine settings", "valerie.engine_settings", {"cycles": "valerie.rendering.cycles.settings:CyclesSettings"}
)
_TRUTH_PASSES: Final = _Kind(
    "truth pass",
    "valerie.truth_passes",
    {"raster": "valerie.rendering.ground_truth:TruthPass", TESTING_ENGINE: "valerie.testing.blank:BlankTruthPass"},
)
_FUNCTIONS: Final = _Kind("function", "valerie.functions", {TESTING_ENGINE: "valerie.testing.blank:BlankFunction"})
_SAMPLERS: Final = _Kind("design", "valerie.samplers", {})


_KINDS: Final = (_RENDERERS, _ENGINE_SETTINGS, _TRUTH_PASSES, _FUNCTIONS, _SAMPLERS)


def look_at_installed() -> tuple[str, ...]:
    """Read once what installed packages declare, so that no request waits for it (some 50 ms).

    Returns:
        What an operator may not expect, in sentences: packages that are installed and left out, or named and without plug-ins.
    """
    left_out: dict[str, list[str]] = {}
    for kind in _KINDS:
        for name, package in sorted(kind.left_out().items()):
            left_out.setdefault(package, []).append(f"{kind.word} {name}")
    offering = {_package(point) for kind in _KINDS for point in _installed(kind.group)}
    return (
        *(
            f"the package {package} offers {', '.join(left_out[package])}; VALERIE_PLUGINS does not name it"
            for package in sorted(left_out)
        ),
        *(
            f"VALERIE_PLUGINS names {package}, and no package of this name with plug-ins is installed here"
            for package in sorted(_allowed() - offering)
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
    return (*RENDERERS, *sorted(_RENDERERS.declared()), *((TESTING_ENGINE,) if testing else ()))


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
        UnknownName, InvalidInput, MissingDependency: see `_Kind.load`.
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
    return (*FUNCTIONS, *sorted(_FUNCTIONS.declared()), *((TESTING_ENGINE,) if testing else ()))


def create_function(name: str, *, threads: int = 1, device: str = "auto") -> PerceptionFunction:
    """Load a function under test; one of an installed package is made by calling its entry point without arguments.

    Raises:
        UnknownName, InvalidInput, MissingDependency: see `_Kind.load`.
        NotFound, InvalidInput: its file is missing or damaged.
    """
    if name in FUNCTIONS:
        return load_function(name, threads=threads, device=device)
    function: PerceptionFunction = _FUNCTIONS.load(name)()
    return function


@lru_cache(maxsize=1)
def samplers() -> Mapping[str, SamplerFactory]:
    """Name to sampler of all designs that draw variants."""
    plugged: dict[str, SamplerFactory] = {name: _SAMPLERS.load(name) for name in sorted(_SAMPLERS.declared())}
    return MappingProxyType({**plugged, **SAMPLERS})
