"""The fields of a spec that make its run a child of another."""

from __future__ import annotations

import re
from typing import Final

from valerie.runs.document.run_spec import RunSpec
from valerie.runs.values import Scalar

#: Most characters of a run's name in that of its child.
_LONGEST: Final = 180


def descent(spec: RunSpec, run_id: str, *, change: str = "refined") -> dict[str, Scalar]:
    """Return the fields that tell a child's spec from the run's: another name, the parent and the iteration.

    Args:
        spec: of the run.
        run_id: of the run.
        change: word for what was done to the spec; the child's name ends with it.
    """
    base, iteration = re.sub(rf" {change}( \d+)?$", "", spec.name), spec.iteration + 1
    name = f"{base[:_LONGEST]} {change}" + (f" {iteration}" if iteration > 1 else "")
    return {"name": name, "parent_run": run_id, "iteration": iteration}
