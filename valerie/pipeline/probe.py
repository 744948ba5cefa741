"""``python -m valerie.pipeline.probe render|infer NAME …``: what of it runs on this machine, as one line of JSON.

In a process of its own: a driver may crash, and the worker's supervising process never loads GL or torch.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Sequence
from dataclasses import asdict
from typing import Any, Final

from valerie import plugins
from valerie.errors import ValerieError
from valerie.pipeline.pinning import TRUTH
from valerie.settings import load_settings
from valerie.testing.blank import NAME as BLANK


def probe_engine(name: str) -> list[dict[str, Any]]:
    """Offers of one engine and of the truth pass beside it."""
    renderer = plugins.create_renderer(name)
    try:
        offers = [{"name": name, "numeric_class": renderer.numeric_class, "revision": renderer.revision}]
    finally:
        renderer.close()
    truth = plugins.create_truth_pass(BLANK if name == BLANK else "")
    offers.append({"name": TRUTH, "numeric_class": truth.numeric_class, "revision": truth.revision})
    return offers


def probe_function(name: str) -> list[dict[str, Any]]:
    """Offer of one function under test."""
    function = plugins.create_function(name, threads=load_settings().inference_threads)
    try:
        card = function.card
        return [
            {
                "name": name,
                "digest": card.digest,
                "revision": function.revision,
                "numeric_class": function.numeric_class,
                "card": asdict(card),
            }
        ]
    finally:
        function.close()


_PROBES: Final[dict[str, Callable[[str], list[dict[str, Any]]]]] = {"render": probe_engine, "infer": probe_function}


def main(arguments: Sequence[str]) -> int:
    """Print the offers of all names that work; complaints go to standard error, and only all failing is a failure."""
    stage, *names = arguments
    offers: list[dict[str, Any]] = []
    for name in names:
        try:
            offers += _PROBES[stage](name)
        except ValerieError as error:
            print(f"{name}: {error}", file=sys.stderr)  # noqa: T201
    print(json.dumps(offers))  # noqa: T201
    return 0 if offers else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
