"""The validation parameter space (VPS) of one run: a sequence of assignments that is indexed, never stored.

    >>> along_x = Variation("p1", Homogeneous(minimum=0, maximum=9, step=1))
    >>> space = ParameterSpace(definitions, [Block(variations=(along_x,))])
    >>> len(space), space[3].values
    (10, {'scene.person-1.pos.x': 3.0})

A space is the union of its blocks, in order. Any assignment follows from (blocks, constants, seed, index).
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import accumulate

from valerie.errors import InvalidInput, UnknownName
from valerie.parameters.assignment import Assignment
from valerie.parameters.blocks import Block, BlockRows, GridRows, Variation, at, rows_of
from valerie.parameters.constraints import Constraint, compile_constraint
from valerie.parameters.definitions import ParameterDefinition, Value
from valerie.parameters.distributions import Constant
from valerie.parameters.samplers import SAMPLERS, SamplerFactory


class ParameterSpace:
    """An immutable sequence of `Assignment`.

    Args:
        definitions: the parameters that may be varied. Blocks, constants and constraints may refer to a parameter
            by its name or its path.
        blocks: the blocks in order. An empty sequence stands for one variant of constants and defaults.
        constants: name or path to value, for all blocks. A block's constants and variations override them.
        constraints: comparisons that a variant must satisfy. A variant that does not stays in the space and is rejected, so
            that indexes are the same with and without constraints.
        seed: seed of all random designs; 0 has no special meaning.
        samplers: name to sampler, for designs other than ``grid`` and ``points``.
        aliases: further names of parameters, to their paths.

    Attributes:
        definitions: path to definition.
        names: every name, alias and path to its definition; a name overrides an alias.
        seed: see above.
        blocks: see above; never empty.
        constants: path to value for each block, the run's constants included.
        constraints: the compiled constraints.

    Raises:
        InvalidInput, UnknownName: a part is invalid. The field begins with ``blocks.N``, ``constants`` or ``constraints.N``.
    """

    def __init__(
        self,
        definitions: Iterable[ParameterDefinition],
        blocks: Sequence[Block] = (),
        *,
        constants: Mapping[str, Value] | None = None,
        constraints: Sequence[str] = (),
        seed: int = 0,
        samplers: Mapping[str, SamplerFactory] = SAMPLERS,
        aliases: Mapping[str, str] | None = None,
    ) -> None:
        self.definitions = {definition.path: definition for definition in definitions}
        by_name = {definition.name: definition for definition in self.definitions.values()}
        by_alias = {alias: self.definitions[path] for alias, path in (aliases or {}).items()}
        self.names = by_alias | self.definitions | by_name
        self.seed = seed
        of_run = self._checked(constants or {}, "constants")
        self.blocks: tuple[Block, ...] = tuple(blocks) or (Block(),)
        self._rows: list[BlockRows] = []
        self.constants: list[dict[str, Value]] = []
        for i, block in enumerate(self.blocks):
            try:
                by_path = self._by_path(block)
                of_block = self._checked(block.constants or {}, "constants")
                rows = rows_of(by_path, self.definitions, seed=seed, index=i, samplers=samplers)
            except InvalidInput as problem:
                raise at(f"blocks.{i}", problem) from None
            self._rows.append(rows)
            self.constants.append(of_run | of_block)
        self._ends = list(accumulate(rows.size for rows in self._rows))
        self.constraints: tuple[Constraint, ...] = tuple(
            compile_constraint(text, self.names, field=f"constraints.{i}") for i, text in enumerate(constraints)
        )

    def _path(self, name: str, field: str) -> str:
        if name not in self.names:
            raise UnknownName("parameter", name, self.names, field=field)
        return self.names[name].path

    def _checked(self, constants: Mapping[str, Value], field: str) -> dict[str, Value]:
        checked: dict[str, Value] = {}
        for name, value in constants.items():
            path = self._path(name, f"{field}.{name}")
            if path in checked:
                raise InvalidInput("the parameter is given twice", field=f"{field}.{name}", value=path)
            checked[path] = self.definitions[path].check(value, field=f"{field}.{name}")
        return checked

    def _by_path(self, block: Block) -> Block:
        return Block(
            design=block.design,
            variations=tuple(
                Variation(self._path(v.path, f"vary.{i}"), v.distribution) for i, v in enumerate(block.variations)
            ),
            count=block.count,
            points=tuple(
                {self._path(name, f"points.{i}.{name}"): value for name, value in point.items()}
                for i, point in enumerate(block.points)
            ),
        )

    @property
    def size(self) -> int:
        """Number of variants, exact at any size (``len`` stops at 2^63 − 1)."""
        return self._ends[-1]

    @property
    def block_sizes(self) -> tuple[int, ...]:
        """Number of variants of each block."""
        return tuple(rows.size for rows in self._rows)

    def __len__(self) -> int:
        return self.size

    def block_of(self, index: int) -> int:
        """Return the index of a variant's block.

        Raises:
            IndexError: ``index`` is not in 0 … size − 1.
        """
        if not 0 <= index < self.size:
            raise IndexError(index)
        return bisect_right(self._ends, index)

    def __getitem__(self, index: int) -> Assignment:
        if index < 0:
            index += self.size
        block = self.block_of(index)
        ((_, values),) = self.values(index, index + 1)
        return Assignment(index, block, values)

    def lines(self, index: int) -> dict[str, range]:
        """Return for each path that a grid varies the variants that differ from this one in it only, in the order of values.

        The variant itself is among them. Other designs have none.
        """
        block = self.block_of(index)
        rows, first = self._rows[block], self._ends[block - 1] if block else 0
        if not isinstance(rows, GridRows):
            return {}
        lines = rows.lines(index - first)
        return {path: range(line.start + first, line.stop + first, line.step) for path, line in lines.items()}

    def __iter__(self) -> Iterator[Assignment]:
        for index, (block, values) in enumerate(self.values(0, self.size)):
            yield Assignment(index, block, values)

    def values(self, start: int, stop: int) -> Iterator[tuple[int, dict[str, Value]]]:
        """Yield (block, path to value) for variants start … stop − 1, faster than by index.

        Each dictionary belongs to the caller and holds the constants first.
        """
        stop = min(stop, self.size)
        while start < stop:
            block = self.block_of(start)
            first = self._ends[block - 1] if block else 0
            end = min(stop, self._ends[block])
            constants = self.constants[block]
            for row in self._rows[block].read(start - first, end - first):
                yield block, ({**constants, **row} if constants else row)
            start = end

    @property
    def varied(self) -> tuple[str, ...]:
        """Paths that may have more than one value in the run, in the order of their first mention in the blocks."""
        paths: dict[str, None] = {}
        constants: dict[str, set[Value]] = {}
        for block, of_block in zip(self.blocks, self.constants, strict=True):
            for variation in block.variations:
                if not isinstance(variation.distribution, Constant):
                    paths.setdefault(self._path(variation.path, "vary"))
            for point in block.points:
                paths.update(dict.fromkeys(self._path(name, "points") for name in point))
            for path, value in of_block.items():
                constants.setdefault(path, set()).add(value)
        for path, values in constants.items():
            in_all_blocks = all(path in of_block for of_block in self.constants)
            if len(values if in_all_blocks else values | {self.definitions[path].default}) > 1:
                paths.setdefault(path)
        return tuple(paths)

    @property
    def used(self) -> frozenset[str]:
        """Paths that any block varies, keeps constant or sets in a point."""
        paths = {path for constants in self.constants for path in constants}
        paths |= {self._path(v.path, "vary") for block in self.blocks for v in block.variations}
        paths |= {self._path(name, "points") for block in self.blocks for point in block.points for name in point}
        return frozenset(paths)

    def violated(self, values: Mapping[str, Value]) -> str | None:
        """Return the reason why a variant is rejected: the first constraint that it violates; None if it satisfies all.

        Args:
            values: path to value; missing paths take their defaults.
        """
        for constraint in self.constraints:
            if not constraint.holds(values):
                return f"the constraint {constraint.text} is not met"
        return None
