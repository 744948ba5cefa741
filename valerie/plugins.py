"""What can be named in a spec, and the class behind each name, imported only when it is asked for.

Render engines: a built-in table, and entry points of the group ``valerie.renderers`` that installed packages declare. Names
come from here and from nowhere else: nothing in a message or a spec is ever imported.
"""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from importlib.metadata import entry_points
from typing import TYPE_CHECKING, Any, Final

from valerie.errors import MissingDependency, UnknownName
from valerie.perception.base import PerceptionFunction
from valerie.perception.catalog import FUNCTIONS, load_function

if TYPE_CHECKING:
    from valerie.rendering.base import Renderer

#: Engine name to ``module:class``.
RENDERERS: Final[Mapping[str, str]] = {
    "raster": "valerie.rendering.raster.renderer:RasterRenderer",
    "pyrender": "valerie.rendering.pyrender_engine:PyrenderRenderer",
}
#: Accepted in specs only where the settings say so.
TESTING_ENGINE: Final = "blank"
ENTRY_POINT_GROUP: Final = "valerie.renderers"
_TRUTH: Final = "valerie.rendering.ground_truth:TruthPass"


def renderer_names(*, testing: bool = False) -> tuple[str, ...]:
    """All engines that a spec may name; none is imported."""
    extra = (TESTING_ENGINE,) if testing else ()
    return (
        *RENDERERS,
        *extra,
        *sorted({point.name for point in entry_points(group=ENTRY_POINT_GROUP)} - set(RENDERERS)),
    )


def create_renderer(name: str) -> Renderer:
    """Open an engine.

    Raises:
        UnknownName: no such engine.
        MissingDependency: a library of it is not installed.
    """
    target = "valerie.testing.blank:BlankRenderer" if name == TESTING_ENGINE else RENDERERS.get(name)
    if target is None:
        points = {point.name: point.value for point in entry_points(group=ENTRY_POINT_GROUP)}
        if name not in points:
            raise UnknownName("renderer", name, renderer_names(), field="renderer")
        target = points[name]
    renderer: Renderer = _load(target, f"the engine {name!r}")()
    return renderer


def create_truth_pass(numeric_class: str) -> Any:
    """Open the truth pass, which serves all engines (that of the blank engine for the numeric class ``blank``)."""
    testing = numeric_class == TESTING_ENGINE
    return _load("valerie.testing.blank:BlankTruthPass" if testing else _TRUTH, "the truth pass")()


def function_names(*, testing: bool = False) -> tuple[str, ...]:
    """All functions under test that a spec may name; neither torch nor a network is loaded."""
    return (*FUNCTIONS, TESTING_ENGINE) if testing else FUNCTIONS


def create_function(name: str, *, threads: int = 1) -> PerceptionFunction:
    """Load a function under test.

    Raises:
        UnknownName: no such function.
        NotFound, InvalidInput: its file is missing or damaged.
        MissingDependency: torch is not installed.
    """
    if name == TESTING_ENGINE:
        function: PerceptionFunction = _load("valerie.testing.blank:BlankFunction", "the blank function")()
        return function
    return load_function(name, threads=threads)


def _load(target: str, what: str) -> Any:
    module, _, attribute = target.partition(":")
    try:
        return getattr(import_module(module), attribute)
    except ImportError as error:
        raise MissingDependency(
            f"{what} needs a library that is not installed: {error} (install valerie[render])"
        ) from error
