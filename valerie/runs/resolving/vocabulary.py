"""The parameters that a spec can name: the asset's, with the spec's own names, narrowed ranges and units."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

from valerie import plugins
from valerie.errors import InvalidInput, UnknownName
from valerie.parameters.definitions import ParameterDefinition, Value
from valerie.parameters.distributions import check_range
from valerie.parameters.odd import OddAttribute
from valerie.parameters.quantities import is_quantity, to_unit
from valerie.rendering.engine import Ability, Engine
from valerie.runs.document.run_spec import DeclaredParameter, RunSpec
from valerie.runs.values import Scalar
from valerie.scene.assets.manifest import Manifest
from valerie.scene.graph.naming import ENVIRONMENT_PATH, ROOT
from valerie.scene.light.solar import ELEVATION
from valerie.scene.motion.trajectory import Motion


@dataclass
class Vocabulary:
    """Names and units of one spec: looks up parameters and converts numbers to the units of their declarations.

    Attributes:
        spec: the spec.
        manifest: manifest of its asset.
        motion: motion in the run; its parameters can be named too.
        problems: receives every problem with the spec's declarations, each with its dotted field.
        definitions: path to definition, with the spec's names and ranges in force.
        paths: every name (the asset's and the spec's) and every path to its path.
    """

    spec: RunSpec
    manifest: Manifest
    motion: Motion | None
    problems: list[InvalidInput]
    definitions: dict[str, ParameterDefinition] = field(init=False)
    paths: dict[str, str] = field(init=False)
    _engine: Engine | None = field(init=False)
    #: Paths of parameters whose numbers were written without a unit, in order.
    _unitless: dict[str, None] = field(init=False, default_factory=dict)

    def __post_init__(self) -> None:
        self._engine = plugins.known_engine(self.spec.engine)
        from_motion = () if self.motion is None else self.motion.parameters
        self.definitions = {definition.path: definition for definition in (*self.manifest.parameters, *from_motion)}
        elevation = self.definitions.get(ELEVATION)
        if not self.renders(Ability.NIGHT) and elevation is not None and elevation.minimum is not None:
            daylight = {"minimum": max(elevation.minimum, 0.0)}
            self.definitions[ELEVATION] = elevation.model_copy(update=daylight)
        self.paths = {definition.name: path for path, definition in self.definitions.items()}
        self.paths |= {path: path for path in self.definitions}
        declared: dict[str, str] = {}
        for i, parameter in enumerate(self.spec.parameters):
            try:
                self._declare(parameter, f"parameters.{i}", declared)
            except InvalidInput as problem:
                self.problems.append(problem)

    def _declare(self, parameter: DeclaredParameter, place: str, declared: dict[str, str]) -> None:
        path = self.path(parameter.path, f"{place}.path")
        if path in declared:
            raise InvalidInput(f"already declared as {declared[path]}", field=f"{place}.path", value=path)
        declared[path] = place
        if self.paths.get(parameter.name, path) != path:
            raise InvalidInput(
                "the name belongs to another parameter of the asset", field=f"{place}.name", value=parameter.name
            )
        asset = self.definitions[path]
        # The name counts from here on, so that a wrong range does not make every use of the name an error.
        self.paths[parameter.name] = path
        self.definitions[path] = asset.model_copy(update={"name": parameter.name})
        if parameter.type is not asset.type:
            raise InvalidInput(
                "the asset declares another type",
                field=f"{place}.type",
                value=parameter.type.value,
                limit=asset.type.value,
            )
        self.definitions[path] = self._narrowed(parameter, asset, place)

    def _narrowed(self, parameter: DeclaredParameter, asset: ParameterDefinition, place: str) -> ParameterDefinition:
        changes: dict[str, str | float | OddAttribute | tuple[str, ...]] = {"name": parameter.name}
        if parameter.odd is not None:
            changes["odd"] = parameter.odd
        if parameter.source:
            changes["source"] = parameter.source
        if parameter.choices:
            for k, choice in enumerate(parameter.choices):
                asset.check(choice, field=f"{place}.choices.{k}")
            if len(set(parameter.choices)) != len(parameter.choices):
                raise InvalidInput("a choice is listed twice", field=f"{place}.choices", value=list(parameter.choices))
            changes["choices"] = parameter.choices
        for end, bound in (("minimum", parameter.minimum), ("maximum", parameter.maximum)):
            if bound is None:
                continue
            if not asset.is_number:
                raise InvalidInput(f"a {asset.type} parameter has no range", field=f"{place}.{end}", value=bound)
            changes[end] = self.number(bound, asset, f"{place}.{end}")
        narrowed = asset.model_copy(update=changes)
        low, high = narrowed.minimum, narrowed.maximum
        if low is not None and high is not None:
            if low > high:
                raise InvalidInput("the minimum is above the maximum", field=f"{place}.minimum", value=low, limit=high)
            try:
                check_range(low, high, asset)
            except InvalidInput as problem:
                message = f"a spec may narrow the asset's declaration, never widen it: {problem.message}"
                end = f"{place}.{problem.field}"
                raise InvalidInput(message, field=end, value=problem.value, limit=problem.limit) from None
        return narrowed

    def path(self, name: str, place: str) -> str:
        """Return the path of a parameter that a variant may set.

        Args:
            name: name or path of the parameter.
            place: dotted field for errors.

        Raises:
            UnknownName: no parameter has this name.
            InvalidInput: a trajectory sets the parameter, or the run's engine cannot render it.
        """
        if name not in self.paths:
            raise UnknownName("parameter", name, self.paths, field=place)
        path = self.paths[name]
        if self.motion is not None and path in self.motion.moved:
            trajectory = self.motion.moved[path]
            channel = path.removeprefix(f"{trajectory.path}.")
            other = trajectory.key(0, channel) if channel in trajectory.channels else "facing: kept"
            raise InvalidInput(
                f"it follows the trajectory of {trajectory.name}; vary the trajectory instead",
                field=place, value=name, limit=f"as {other.removeprefix(f'{ROOT}.')}",
            )  # fmt: skip
        node, _, attribute = path.rpartition(".")
        if node == ENVIRONMENT_PATH and attribute in set(Ability) and not self.renders(Ability(attribute)):
            able = (each for each in plugins.RENDERERS if Ability(attribute) in plugins.declared_engine(each).shows)
            raise InvalidInput(
                f"the engine {self.spec.engine!r} cannot render it", field=place, value=path, limit=", ".join(able)
            )
        return path

    def renders(self, ability: Ability) -> bool:
        """Return True if the run's engine has an ability; one that is not installed is assumed to have all."""
        return self._engine is None or ability in self._engine.shows

    def number(self, written: Any, definition: ParameterDefinition, place: str) -> float:
        """Return a number of the spec in the unit of its parameter.

        Raises:
            InvalidInput, UnknownName: see `valerie.parameters.quantities.to_unit`.
        """
        number, has_unit = to_unit(written, definition.unit, field=place)
        if definition.unit and not has_unit:
            self._unitless.setdefault(definition.path)
        return number

    def value(self, written: Any, definition: ParameterDefinition, place: str) -> Value:
        """Return a value of the spec, checked against its parameter and in the parameter's unit.

        Raises:
            InvalidInput, UnknownName: the parameter cannot take the value.
        """
        is_number = isinstance(written, int | float) and not isinstance(written, bool)
        if definition.is_number and (is_number or (isinstance(written, str) and is_quantity(written))):
            return definition.check(self.number(written, definition, place), field=place)
        return definition.check(written, field=place)

    def values(self, written: Mapping[str, Scalar], place: str) -> dict[str, Value]:
        """Return path to value for a mapping of names to values in a spec.

        An entry with a problem is left out, and the problem is added to `problems`.
        """
        values: dict[str, Value] = {}
        for name, value in written.items():
            try:
                path = self.path(name, f"{place}.{name}")
                if path in values:
                    raise InvalidInput("the parameter has two values", field=f"{place}.{name}", value=path)
                values[path] = self.value(value, self.definitions[path], f"{place}.{name}")
            except InvalidInput as problem:
                self.problems.append(problem)
        return values

    def notes(self) -> Iterator[str]:
        """Yield notes about the units that were assumed for numbers without one."""
        for path in self._unitless:
            definition = self.definitions[path]
            yield f"{definition.name}: numbers without unit are in {definition.unit}"
