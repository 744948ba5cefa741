"""The long table of a run: one row per (frame, sensor setting, function, person instance).

Rows are stored as a pyarrow table and read as numpy columns. `valerie.measures` defines the columns.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from io import BytesIO
from itertools import islice
from pathlib import Path
from typing import Any, BinaryIO, Final, Self

import numpy as np
import orjson
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.csv
import pyarrow.parquet
from numpy.typing import ArrayLike, NDArray

from valerie.analysis.rows.design import UNKNOWN, Design, position_paths
from valerie.errors import CorruptArtifact, InvalidInput, UnknownName
from valerie.measures import CLASS_COLUMNS, MEASURES, ColumnType, Measure, Row
from valerie.plain import typed
from valerie.statistics.units import EVEN, Estimand, Units, sampling_units

_NAME: Final = pa.dictionary(pa.int32(), pa.string())
#: Arrow type of a varied parameter's column, by the parameter's type.
PARAMETER_COLUMNS: Final[Mapping[str, pa.DataType]] = {
    "FLOAT": pa.float64(),
    "ANGLE": pa.float64(),
    "INT": pa.int64(),
    "BOOL": pa.bool_(),
    "CATEGORICAL": _NAME,
}
#: Blocks of which results are shown one by one; a run may have thousands.
MOST_BLOCKS: Final = 8
_METADATA_KEY: Final = b"valerie.evaluations"
_BATCH: Final = 65_536


@dataclass(frozen=True, slots=True)
class Codes:
    """A column of names, as indices into the list of names.

    Attributes:
        index: (N,) int64, index into ``names``; −1 where the row is empty.
        names: the distinct names that occur, sorted.
    """

    index: NDArray[np.int64]
    names: tuple[str, ...]

    def where(self, name: str) -> NDArray[np.bool_]:
        """Return (N,) bool: the rows with ``name``."""
        if name not in self.names:
            return np.zeros(len(self.index), np.bool_)
        rows: NDArray[np.bool_] = self.index == self.names.index(name)
        return rows


class EvaluationTable:
    """One row per (frame, sensor setting, function, person instance); immutable.

    Columns are the measures, then one column per varied parameter, named by its path, then `CLASS_COLUMNS` if a run accepts
    several numeric classes. A frame without any person has one
    row per (sensor, function) with ``undefined_reason`` "absent", so that its false positives are counted.

    Attributes:
        arrow: the table.
        parameters: path to parameter type (``FLOAT``, ``INT``, ``BOOL``, ``CATEGORICAL``, ``ANGLE``).
        designs: run id to the design of its variants; `UNKNOWN` for a run without an entry.
    """

    def __init__(
        self, arrow: pa.Table, parameters: Mapping[str, str], designs: Mapping[str, Design] | None = None
    ) -> None:
        self.parameters: Mapping[str, str] = {path: str(kind) for path, kind in parameters.items()}
        self.designs: Mapping[str, Design] = dict(designs or {})
        self.arrow = _conform(arrow, schema_of(self.parameters, arrow.column_names))
        _check(self.arrow)

    @classmethod
    def from_columns(
        cls,
        columns: Mapping[str, ArrayLike | pa.Array],
        parameters: Mapping[str, str],
        designs: Mapping[str, Design] | None = None,
    ) -> Self:
        """Build the table from columns: numpy arrays, lists or Arrow arrays of equal length; NaN and None are empty.

        Raises:
            UnknownName: a column is neither a measure nor a parameter.
            InvalidInput: a column is missing, has the wrong type or breaks a rule of its measure.
        """
        schema = schema_of(parameters, columns)
        for name in columns:
            if name not in schema.names:
                raise UnknownName("column", name, schema.names)
        arrays = [_array(name, columns.get(name), schema.field(name).type) for name in schema.names]
        lengths = {name: len(array) for name, array in zip(schema.names, arrays, strict=True)}
        if len(set(lengths.values())) > 1:
            raise InvalidInput("columns differ in length", field="columns", value=lengths)
        return cls(pa.table(arrays, schema=schema), parameters, designs)

    @classmethod
    def from_rows(
        cls,
        rows: Iterable[Row],
        parameters: Mapping[str, str],
        designs: Mapping[str, Design] | None = None,
    ) -> Self:
        """Build the table from rows, read once in batches; a missing key is an empty value.

        Raises:
            UnknownName: a key is neither a measure nor a parameter.
            InvalidInput: as for `from_columns`.
        """
        batches: list[pa.Table] = []
        for batch in _batches(rows):
            keys = frozenset[str]().union(*batch)
            schema = schema_of(parameters, keys)
            for key in keys - frozenset(schema.names):
                raise UnknownName("column", key, schema.names)
            arrays = [
                _array(name, [row.get(name) for row in batch], without_codes(schema.field(name).type))
                for name in schema.names
            ]
            batches.append(pa.table(arrays, names=schema.names))
        if not batches:
            return cls(schema_of(parameters).empty_table(), parameters, designs)
        return cls(pa.concat_tables(batches, promote_options="default"), parameters, designs)

    @classmethod
    def from_parquet(cls, source: Path | BinaryIO | pa.BufferReader) -> Self:
        """Read a file that `to_parquet` wrote.

        Raises:
            CorruptArtifact: not a Parquet file, or not an evaluation table.
        """
        try:
            arrow = pa.parquet.read_table(source)
        except (pa.ArrowException, OSError, ValueError) as error:
            raise CorruptArtifact(f"not a Parquet evaluation table: {error}") from error
        metadata = arrow.schema.metadata or {}
        if _METADATA_KEY not in metadata:
            raise CorruptArtifact("the Parquet file has no parameter types, so it is not an evaluation table")
        document = orjson.loads(metadata[_METADATA_KEY])
        designs = typed(dict[str, Design], document["designs"])
        return cls(arrow, document["parameters"], designs)

    @classmethod
    def joined(cls, tables: Sequence[Self]) -> Self:
        """Return the rows of several runs as one table.

        Raises:
            InvalidInput: the runs vary different parameters, or there is no table.
        """
        if not tables or any(table.parameters != tables[0].parameters for table in tables):
            raise InvalidInput(
                "runs with different parameters have no common table",
                field="parameters",
                value=[list(table.parameters) for table in tables],
                limit="the same parameters in all",
            )
        designs = {run: design for table in tables for run, design in table.designs.items()}
        rows = pa.concat_tables([table.arrow for table in tables], promote_options="default")
        return cls(rows, tables[0].parameters, designs)

    def to_parquet(self, sink: Path | BinaryIO) -> None:
        """Write a zstd-compressed Parquet file; its metadata contains the types of the parameters and the designs."""
        metadata = {_METADATA_KEY: orjson.dumps({"parameters": self.parameters, "designs": self.designs})}
        pa.parquet.write_table(self.arrow.replace_schema_metadata(metadata), sink, compression="zstd")

    def to_csv(self, sink: Path | BinaryIO, *, without: Sequence[str] = ()) -> None:
        """Write a CSV file with a header; an empty field is a missing value, names are quoted.

        Args:
            sink: file to write.
            without: columns to leave out.
        """
        arrow = self.arrow.drop_columns(list(without))
        plain = arrow.cast(pa.schema([pa.field(f.name, without_codes(f.type)) for f in arrow.schema]))
        pa.csv.write_csv(plain, sink)

    def __len__(self) -> int:
        return int(self.arrow.num_rows)

    def is_number(self, name: str) -> bool:
        """Return True if a column contains numbers.

        Raises:
            UnknownName: no such column.
        """
        kind = self._column(name).type
        return bool(pa.types.is_integer(kind) or pa.types.is_floating(kind))

    def numbers(self, name: str) -> NDArray[np.float64]:
        """Return a numeric or bool column: (N,) float64, NaN where empty; read-only.

        Raises:
            UnknownName: no such column.
            InvalidInput: the column contains names.
        """
        if name not in self._numbers:
            column = self._column(name)
            if pa.types.is_dictionary(column.type) or pa.types.is_string(column.type):
                raise InvalidInput("the column holds names, not numbers", field=name)
            values = column.cast(pa.float64()).to_numpy().astype(np.float64)
            values.flags.writeable = False
            self._numbers[name] = values
        return self._numbers[name]

    def codes(self, name: str) -> Codes:
        """Return a column of any type as `Codes`; numbers become text.

        Raises:
            UnknownName: no such column.
        """
        if name not in self._codes:
            column = self._column(name)
            if not pa.types.is_dictionary(column.type):
                column = column.cast(pa.string()).dictionary_encode()
            array = pa.concat_arrays(column.unify_dictionaries().chunks or [pa.array([], _NAME)])
            raw = np.asarray(array.indices.fill_null(-1), np.int64)
            used = np.flatnonzero(np.bincount(raw + 1, minlength=len(array.dictionary) + 1)[1:])
            names = array.dictionary.take(used)
            order = pc.sort_indices(names)
            rank = np.full(len(array.dictionary) + 1, -1, np.int64)  # the last entry maps −1 to −1
            rank[used[order]] = np.arange(len(used))
            index = rank[raw]
            index.flags.writeable = False
            self._codes[name] = Codes(index, tuple(names.take(order).to_pylist()))
        return self._codes[name]

    def select(self, mask: NDArray[np.bool_]) -> Self:
        """Return the rows where ``mask`` ((N,) bool) is True."""
        return type(self)(self.arrow.filter(pa.array(mask)), self.parameters, self.designs)

    def by_block(self) -> dict[int, Self]:
        """Return the number of each block, from 1, and its rows; of more than `MOST_BLOCKS` those with the most rows."""
        numbers, counts = np.unique(self.blocks, return_counts=True)
        if len(numbers) == 1:
            return {int(numbers[0]) + 1: self}
        largest = np.sort(numbers[np.argsort(-counts, kind="stable")[:MOST_BLOCKS]])
        return {number + 1: self.select(self.blocks == number) for number in largest.tolist()}

    @cached_property
    def evaluations(self) -> NDArray[np.int64]:
        """(N,) int64 number 0…E−1 of the evaluation (frame, sensor, function) of each row."""
        return combine([self.codes(name).index for name in ("frame_id", "sensor", "function")])

    @cached_property
    def units(self) -> Units:
        """Sampling units of the rows by the designs of the runs (`valerie.statistics.units`)."""
        return self._units_among(self._by_run, np.ones(len(self), np.bool_))

    def units_in_run(self, run: str, rows: NDArray[np.bool_]) -> Units:
        """Return the sampling units of some rows ((N,) bool) of one run by its own design, whatever the other runs' are."""
        design, of_run = self._by_run[self.codes("run_id").names.index(run)]
        if run not in self._run_units:
            self._run_units[run] = self._units_among([(design, of_run)], of_run)
        return self._run_units[run].of(rows[of_run])

    def _units_among(self, by_run: Sequence[tuple[Design, NDArray[np.bool_]]], of: NDArray[np.bool_]) -> Units:
        """Return the units of the rows ``of`` some runs."""
        variants = combine([self.codes("run_id").index[of], self._variants[of]])
        designs, numbers = set(), np.zeros(len(self), np.int64)
        for run, (design, rows) in enumerate(by_run):
            name, replicate = design.design_of(self._variants[rows])
            designs.add(name)
            if replicate is not None:
                numbers[rows] = replicate * len(by_run) + run
        if designs <= EVEN:
            return sampling_units("sobol", variants, replicate=numbers[of])
        if "grid" not in designs:
            return sampling_units("random", variants)
        return sampling_units("grid", variants, sites=self._sites[of])

    @cached_property
    def places(self) -> NDArray[np.int64]:
        """(N,) int64 number 0…P−1 of the place of each row; neighbours have adjacent numbers.

        A drawn variant is its own place. Listed variants share a place if all persons have the same positions on one
        site; where the list is repeated on several sites, each site is one place.
        """
        if self.units.estimand is Estimand.SITES:
            return combine([self._sites])
        drawn = np.zeros(len(self), np.bool_)
        for design, rows in self._by_run:
            drawn[rows] = design.drawn(self._variants[rows])
        keys = [self._sites, np.where(drawn, self.numbers("variant_index"), -1.0)]
        return combine([*keys, *(self.numbers(path) for path in position_paths(self.parameters))])

    @cached_property
    def blocks(self) -> NDArray[np.int64]:
        """(N,) int64 number of the block of each row, from 0; runs with equal blocks share them."""
        numbers, firsts = np.zeros(len(self), np.int64), dict[tuple[tuple[str, int], ...], int]()
        for design, rows in self._by_run:
            first = firsts.setdefault(design.blocks, sum(map(len, firsts)))
            numbers[rows] = first + design.blocks_of(self._variants[rows])
        return numbers

    @cached_property
    def place_positions(self) -> NDArray[np.float64] | None:
        """(N, D) positions that make the places of a listed grid on one site, metres; None where places are drawn."""
        paths = position_paths(self.parameters)
        if self.units.estimand is not Estimand.LISTED_GRID or not paths:
            return None
        return np.column_stack([self.numbers(path) for path in paths])

    def positions_of(self, rows: NDArray[np.bool_] | NDArray[np.int64]) -> NDArray[np.float64] | None:
        """Return `place_positions` of some rows."""
        return None if self.place_positions is None else self.place_positions[rows]

    @property
    def _variants(self) -> NDArray[np.int64]:
        return self.numbers("variant_index").astype(np.int64)

    @cached_property
    def _by_run(self) -> list[tuple[Design, NDArray[np.bool_]]]:
        """Design and rows of each run."""
        runs = self.codes("run_id")
        return [(self.designs.get(name, UNKNOWN), runs.where(name)) for name in runs.names]

    @cached_property
    def _sites(self) -> NDArray[np.int64]:
        """(N,) site seeds; −1 where the asset has none."""
        sites = np.full(len(self), -1, np.int64)
        for design, rows in self._by_run:
            if design.site is not None:
                sites[rows] = design.site
        return sites

    @cached_property
    def _run_units(self) -> dict[str, Units]:
        return {}

    @cached_property
    def _numbers(self) -> dict[str, NDArray[np.float64]]:
        return {}

    @cached_property
    def _codes(self) -> dict[str, Codes]:
        return {}

    def _column(self, name: str) -> pa.ChunkedArray:
        if name not in self.arrow.column_names:
            raise UnknownName("column", name, self.arrow.column_names)
        return self.arrow[name]


def schema_of(parameters: Mapping[str, str], present: Iterable[str] = ()) -> pa.Schema:
    """Return the Arrow schema: the measures, one column per parameter, and those `CLASS_COLUMNS` that are ``present``.

    Raises:
        UnknownName: a parameter has an unknown type.
        InvalidInput: a parameter has the name of a measure.
    """
    fields = [pa.field(measure.name, arrow_type(measure)) for measure in MEASURES]
    fixed = {measure.name for measure in MEASURES}
    for path, kind in parameters.items():
        if path in fixed:
            raise InvalidInput("a parameter may not have the name of a measure", field="parameters", value=path)
        if str(kind) not in PARAMETER_COLUMNS:
            raise UnknownName("parameter type", str(kind), PARAMETER_COLUMNS, field=path)
        fields.append(pa.field(path, PARAMETER_COLUMNS[str(kind)]))
    present = frozenset(present)
    return pa.schema([*fields, *(pa.field(name, _NAME) for name in CLASS_COLUMNS if name in present)])


def encoded(table: pa.Table, suffix: str) -> bytes:
    """Return a small table as a file: CSV for the suffix ``csv``, otherwise Parquet."""
    buffer = BytesIO()
    (pa.csv.write_csv if suffix == "csv" else pa.parquet.write_table)(table, buffer)
    return buffer.getvalue()


def arrow_type(measure: Measure) -> pa.DataType:
    """Return the Arrow type of a measure's column; names are dictionary-encoded."""
    return _NAME if measure.type is ColumnType.NAME else pa.type_for_alias(measure.type.value)


def combine(keys: Sequence[NDArray[Any]]) -> NDArray[np.int64]:
    """Number the distinct combinations of columns of equal length: (N,) int64, 0…K−1; NaN equals NaN."""
    combined: NDArray[np.int64] | None = None
    for key in keys:
        values, index = np.unique(key, return_inverse=True, equal_nan=True)
        if combined is None:
            combined = index.astype(np.int64)
        else:
            combined = np.unique(combined * len(values) + index, return_inverse=True)[1].astype(np.int64)
    if combined is None:
        raise InvalidInput("no columns to combine", field="keys", limit="at least one column")
    return combined


def without_codes(dtype: pa.DataType) -> pa.DataType:
    """Return the type of a column's values: text for a column of names."""
    return pa.string() if pa.types.is_dictionary(dtype) else dtype


def _batches(rows: Iterable[Row]) -> Iterator[list[Row]]:
    iterator = iter(rows)
    while batch := list(islice(iterator, _BATCH)):
        yield batch


def _array(name: str, values: object, dtype: pa.DataType) -> pa.Array:
    """Return one column as Arrow with type ``dtype``; NaN becomes empty."""
    if values is None:
        raise InvalidInput("the column is missing; it may contain empty values", field=name)
    try:
        array = values if isinstance(values, pa.Array | pa.ChunkedArray) else pa.array(values, from_pandas=True)
        if pa.types.is_dictionary(dtype) and not pa.types.is_dictionary(array.type):
            array = array.cast(pa.string()).dictionary_encode()
        return array.cast(dtype)
    except (pa.ArrowException, TypeError, ValueError) as error:
        raise InvalidInput(
            f"the values do not fit the column: {error}", field=name, limit=str(without_codes(dtype))
        ) from error


def _conform(arrow: pa.Table, schema: pa.Schema) -> pa.Table:
    """Return the table with the columns, order and types of the schema."""
    for name in arrow.column_names:
        if name not in schema.names:
            raise UnknownName("column", name, schema.names)
    columns = []
    for field in schema:
        column = arrow[field.name] if field.name in arrow.column_names else None
        columns.append(_array(field.name, column, field.type))
    return pa.table(columns, schema=schema)


def _check(arrow: pa.Table) -> None:
    """Check the rules that column types cannot express."""
    for measure in MEASURES:
        column = arrow[measure.name]
        if measure.required and column.null_count:
            raise InvalidInput("empty values in a required column", field=measure.name, value=column.null_count)
        if measure.low is not None or measure.high is not None:
            _check_bounds(measure, *pc.min_max(column).as_py().values())
    unexplained = pc.sum(pc.equal(pc.is_null(arrow["pacc"]), pc.is_null(arrow["undefined_reason"]))).as_py()
    if unexplained:
        raise InvalidInput("pacc is undefined exactly where undefined_reason is given", field="pacc", value=unexplained)


def _check_bounds(measure: Measure, least: float | None, most: float | None) -> None:
    low, high = measure.low, measure.high
    if least is None or most is None:
        return
    if (low is not None and least < low) or (high is not None and most > high):
        limit = f"≥ {low:g}" if high is None else f"{low:g}…{high:g}"
        raise InvalidInput("values out of bounds", field=measure.name, value=(least, most), limit=limit)
