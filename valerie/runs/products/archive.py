"""The archive of a run: what its rows in the artifact store are, so that no other files are taken for them."""

from __future__ import annotations

from collections.abc import Mapping

from valerie.document import Document


class ArchivedTable(Document):
    """A Parquet file with the rows of one table.

    Attributes:
        rows: their number.
        bytes: size of the file.
        sha256: of the file, hex.
    """

    rows: int
    bytes: int
    sha256: str


class Archive(Document):
    """The rows of an archived run, which the database no longer has.

    Attributes:
        at: Unix seconds when it was written; marks may differ between two archives of equal rows.
        revision: of the database's tables then.
        tables: name of a table to its file; ``objects`` lists the stored products.
        stored_bytes: size of the products that only this run of its owner and project needed.
        cpu_seconds: CPU time of these products, made in the period of the quotas.
    """

    at: float
    revision: str
    tables: Mapping[str, ArchivedTable]
    stored_bytes: float
    cpu_seconds: float
