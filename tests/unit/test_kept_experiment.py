"""docs/experiment: the comparison of engines and the page's ledger follow from the kept rows."""

from __future__ import annotations

import json
import re
from collections import Counter
from pathlib import Path
from typing import Any

import pytest

from tools.paper import CLAIMS, KEPT, ROOT, compare_kept
from valerie.analysis.claims.ledger import ClaimOutcome, write_ledger
from valerie.analysis.comparison.beside import Beside
from valerie.analysis.findings.search import find_findings
from valerie.analysis.rows.table import EvaluationTable
from valerie.cli.claims import read_claims
from valerie.errors import InvalidInput


def rounded(text: str) -> Any:
    """Read JSON with numbers of ten digits. The last ones depend on the processor, through linear algebra."""
    return json.loads(text, parse_float=lambda number: f"{float(number):.10g}")


def test_the_kept_comparison_of_engines_follows_from_the_kept_rows() -> None:
    kept = (KEPT / "paper-cycles.json").read_text("utf-8")
    assert rounded(json.dumps(compare_kept().to_json())) == rounded(kept)


@pytest.mark.parametrize(
    ("name", "heading", "sites"), [("paper-streets", "Ten streets", 10), ("paper-part", "One street at full size", 1)]
)
def test_the_page_counts_claims_and_findings_as_the_kept_rows_do(name: str, heading: str, sites: int) -> None:
    page = " ".join((ROOT / "docs" / "experiment.md").read_text("utf-8").split()).partition(f"### {heading}")[2]
    table = EvaluationTable.from_parquet(KEPT / f"{name}.parquet")
    assert len({design.site for design in table.designs.values()}) == sites
    outcomes = Counter(entry.outcome for entry in write_ledger(read_claims(Path(CLAIMS)), table))
    written = re.search(
        r"(\d+) claims reproduced, (\d+) not, (\d+) undecided, (\d+) not testable; (\d+) are slips", page
    )
    assert written is not None
    order = "REPRODUCED", "NOT_REPRODUCED", "UNDECIDED", "NOT_TESTABLE", "SLIP"
    assert [int(count) for count in written.groups()] == [outcomes[ClaimOutcome[name]] for name in order]
    confirmed = re.search(r"\*\*Findings\*\*: (\d+) are confirmed", page)
    assert confirmed is not None
    assert int(confirmed.group(1)) == len(find_findings(table, seed=0).items)


def test_a_comparison_is_read_back_from_its_file() -> None:
    text = (KEPT / "paper-cycles.json").read_text("utf-8")
    assert json.loads(json.dumps(Beside.from_json(text).to_json())) == json.loads(text)


@pytest.mark.parametrize("text", ["", "[]", '{"here": 1}'])
def test_another_file_is_no_comparison(text: str) -> None:
    with pytest.raises(InvalidInput, match="beside: not a comparison of two runs"):
        Beside.from_json(text)
