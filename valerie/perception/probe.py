"""``python -m valerie.perception.probe [NAME …]``: which functions run here and as what, as one line of JSON.

In a process of its own, so that the worker's supervising process never loads torch.
"""

from __future__ import annotations

import json
import sys
from dataclasses import asdict

from valerie.errors import ValerieError
from valerie.perception.catalog import function_names, load_function


def main(names: list[str]) -> int:
    """Print the offers; complaints go to standard error."""
    offers = []
    for name in names or function_names():
        try:
            function = load_function(name)
        except ValerieError as error:
            print(f"{name}: {error}", file=sys.stderr)  # noqa: T201
            continue
        card = function.card
        offers.append(
            {"name": name, "digest": card.digest, "numeric_class": function.numeric_class, "card": asdict(card)}
        )
        function.close()
    if not offers:
        print("no function under test could be loaded", file=sys.stderr)  # noqa: T201
        return 1
    print(json.dumps(offers))  # noqa: T201
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
