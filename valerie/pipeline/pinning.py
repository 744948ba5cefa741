"""Which numeric classes make a run's pixels: chosen once, from what living workers offer, and kept for all its products."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

from valerie.plugins import ENGINE_HINTS
from valerie.runs.documents import engine_name

#: The name under which render workers offer the truth pass, beside their engines.
TRUTH: Final = "truth"


def choose_pins(
    spec: Mapping[str, Any], offers: Sequence[Mapping[str, Any]]
) -> tuple[dict[str, Any], None] | tuple[None, str]:
    """Pins for a run, or why there are none yet.

    Args:
        spec: the run's spec as a document (``renderer``, ``functions``).
        offers: {"stage", "name", "numeric_class", "route", "revision" | "digest"} of the living workers.

    Returns:
        ({"engine": offer, "truth": offer, "functions": {name: offer}}, None), or (None, reason in words). Where several
        numeric classes are offered, the one of the longest-serving worker is taken (``offers`` is in that order).
    """
    name = engine_name(spec["renderer"])
    engine = _first(offers, "render", name)
    truth = _first(offers, "render", TRUTH)
    functions = {name: _first(offers, "infer", name) for name in spec["functions"]}
    missing = []
    if engine is None:
        hint = ENGINE_HINTS.get(name)
        missing.append(f"a render worker with the engine {name!r}" + (f" ({hint})" if hint else ""))
    if truth is None:
        missing.append("a render worker with the truth pass")
    missing += [f"an inference worker with the function {name!r}" for name, offer in functions.items() if offer is None]
    if missing:
        return None, "waiting for " + ", ".join(missing) + " (start one with: valerie worker)"
    return {"engine": engine, "truth": truth, "functions": functions}, None


def _first(offers: Sequence[Mapping[str, Any]], stage: str, name: str) -> dict[str, Any] | None:
    return next((dict(offer) for offer in offers if offer["stage"] == stage and offer["name"] == name), None)
