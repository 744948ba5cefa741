"""Describe a data set in Croissant 1.0, the JSON-LD of data catalogues and loaders.

http://mlcommons.org/croissant/1.0; Akhtar et al. 2024, doi:10.1145/3650203.3663326.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from datetime import datetime
from hashlib import file_digest
from pathlib import Path
from typing import Final

import pyarrow as pa
import pyarrow.parquet as pq

from valerie.datasets.index import COLUMNS
from valerie.measures import MEASURES
from valerie.plain import JsonObject

FILE: Final = "croissant.json"
_SPECIFICATION: Final = "http://mlcommons.org/croissant/1.0"
#: The context of every document of this version, verbatim.
_CONTEXT: Final[JsonObject] = {
    "@language": "en",
    "@vocab": "https://schema.org/",
    "cr": "http://mlcommons.org/croissant/",
    "dct": "http://purl.org/dc/terms/",
    "rai": "http://mlcommons.org/croissant/RAI/",
    "sc": "https://schema.org/",
    "conformsTo": "dct:conformsTo",
    "data": {"@id": "cr:data", "@type": "@json"},
    "dataType": {"@id": "cr:dataType", "@type": "@vocab"},
    "examples": {"@id": "cr:examples", "@type": "@json"},
    **{
        term: f"cr:{term}"
        for term in (
            "citeAs", "column", "extract", "field", "fileObject", "fileProperty", "fileSet", "format", "includes",
            "isLiveDataset", "jsonPath", "key", "md5", "parentField", "path", "recordSet", "references", "regex",
            "repeated", "replace", "separator", "source", "subField", "transform",
        )
    },
}  # fmt: skip
#: Table to the name of its records and a description of one record.
_TABLES: Final = {
    "index.parquet": ("persons", "a person in a frame, with measures and the paths of the frame's files"),
    "evaluations.parquet": ("evaluations", "a person in a frame as a function sees it: the long table"),
}
#: Documents besides the tables, by pattern: format and description.
_DOCUMENTS: Final = {
    "dataset.json": ("application/json", "provenance: run, digests, settings"),
    "coco/*.json": ("application/json", "COCO annotations of a split"),
}
#: Many files of one kind, by pattern: name, format and description.
_SETS: Final = {
    "leftImg8bit/**/*.png": ("pictures", "image/png", "the pictures that functions see"),
    "gtFine/**/*.png": ("labels", "image/png", "label ids, instance ids and colours, in the layout of Cityscapes"),
    "gtFine/**/*.json": ("polygons", "application/json", "outlines in the layout of Cityscapes"),
    "camera/**/*.json": ("cameras", "application/json", "intrinsic and extrinsic parameters"),
    "openlabel/**/*.json": ("openlabel", "application/json", "ASAM OpenLABEL 1.0"),
    "coco/**/*.png": ("panoptic", "image/png", "panoptic segments of COCO"),
    "predictions/**/*.png": ("predictions", "image/png", "label ids that functions predict"),
    "annotations/**/*.npz": ("annotations", "application/octet-stream", "further truth, as arrays of numpy"),
}
_MEANINGS: Final = {name: text for name, _, text in COLUMNS} | {
    measure.name: measure.description for measure in MEASURES
}


def describe(folder: Path, *, name: str, description: str, published: datetime, version: str) -> JsonObject:
    """Return the description of a finished data set.

    Args:
        folder: the data set with all its files.
        name: name of the data set.
        description: text for users.
        published: date of its content, so that equal content has an equal description.
        version: version of the format.
    """
    tables = [path for path in _TABLES if (folder / path).is_file()]
    return {
        "@context": _CONTEXT,
        "@type": "sc:Dataset",
        "conformsTo": _SPECIFICATION,
        "name": name,
        "description": description,
        "version": version,
        "datePublished": published.date().isoformat(),
        "license": "No licence is stated. The distributor of this data set decides how it may be used.",
        "distribution": [*_files(folder, tables), *_file_sets(folder)],
        "recordSet": [_records(folder / path) for path in tables],
    }


def _files(folder: Path, tables: list[str]) -> Iterator[JsonObject]:
    for path in tables:
        yield _file(folder, path, "application/x-parquet", f"each row is {_TABLES[path][1]}")
    for pattern, (encoding, text) in _DOCUMENTS.items():
        for document in sorted(folder.glob(pattern)):
            yield _file(folder, document.relative_to(folder).as_posix(), encoding, text)


def _file(folder: Path, path: str, encoding: str, text: str) -> JsonObject:
    with (folder / path).open("rb") as file:
        sha256 = file_digest(file, "sha256").hexdigest()
    return {
        "@type": "cr:FileObject", "@id": path, "name": path, "description": text,
        "contentUrl": path, "encodingFormat": encoding, "sha256": sha256,
    }  # fmt: skip


def _file_sets(folder: Path) -> Iterator[JsonObject]:
    for pattern, (name, encoding, text) in _SETS.items():
        if next(folder.glob(pattern), None) is not None:
            yield {
                "@type": "cr:FileSet", "@id": name, "name": name, "description": text,
                "encodingFormat": encoding, "includes": pattern,
            }  # fmt: skip


def _records(path: Path) -> JsonObject:
    name, text = _TABLES[path.name]
    schema: Mapping[str, pa.DataType] = {field.name: field.type for field in pq.read_schema(path)}
    fields: list[JsonObject] = [
        {
            "@type": "cr:Field",
            "@id": f"{name}/{column}",
            "name": column,
            "description": _MEANINGS.get(column, "value of the parameter in the frame's variant"),
            "dataType": _data_type(kind),
            **({"repeated": True} if pa.types.is_list(kind) else {}),
            "source": {"fileObject": {"@id": path.name}, "extract": {"column": column}},
        }
        for column, kind in schema.items()
    ]
    return {
        "@type": "cr:RecordSet",
        "@id": name,
        "name": name,
        "description": f"Each record is {text}.",
        "field": fields,
    }


def _data_type(kind: pa.DataType) -> str:
    if pa.types.is_list(kind):
        return _data_type(kind.value_type)
    if pa.types.is_boolean(kind):
        return "sc:Boolean"
    if pa.types.is_integer(kind):
        return "sc:Integer"
    return "sc:Float" if pa.types.is_floating(kind) else "sc:Text"
