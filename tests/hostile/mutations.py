"""Damage to specs, drawn from a seed."""

from __future__ import annotations

import copy
import random
from collections.abc import Callable, Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any, Final

import yaml

#: Values that fit nowhere, or almost.
ODD: Final[tuple[Any, ...]] = (
    None, True, "", " ", "x", "5 m", "-3 deg", "1e400", "nan", -1, 0, 0.5, 1e-300, 1e308, 10**30, -(10**30), float("nan"),
    float("inf"), [], {}, [[]], [None] * 3, {"": ""}, {"homogeneous": {"from": 0, "to": 1, "step": 1e-12}},
    {"homogeneous": {"from": 0, "to": 1e9, "step": 1}}, {"choice": []}, {"choice": list(range(2000))}, "../../etc/passwd",
    "\u202e", "a\u0000b", "é" * 300, "y" * 100_000, "*anchor", "${HOME}", "=cmd()", "2026-11-26", "!!python/object:os.system",
)  # fmt: skip
#: Texts that are no YAML, or YAML of a hostile kind.
BOMBS: Final = (
    "a: &a [x,x,x,x,x,x,x,x,x]\n" + "".join(f"{b}: &{b} [{','.join([f'*{a}'] * 9)}]\n" for a, b in pairwise("abcdefghi")),
    "[" * 5000, "{a: " * 3000, "- " * 20_000, "a: 1\na: 2\n", "\t", "\ufeff", "%YAML 9.9\n---\n", "? [a, b]\n: c\n", "<<: *x\n",
    "!!python/object/apply:os.system ['true']\n", "name: !!binary aGk=\n", "9" * 50_000,
    "- &a *a\n", "&a {b: *a}\n", "\x00", "---\n---\n",
)  # fmt: skip


def specs(folder: Path) -> list[dict[str, Any]]:
    """Read the specs of a folder."""
    documents = [yaml.safe_load(path.read_text()) for path in sorted(folder.glob("*.yaml"))]
    return [document for document in documents if "goal" not in document]


def hostile_text(whole: list[dict[str, Any]], seed: int) -> bytes:
    """Return a damaged spec as YAML."""
    rng = random.Random(seed)
    if rng.random() < 0.02:
        text = rng.choice(BOMBS)
        return (yaml.safe_dump(rng.choice(whole)) + text if rng.random() < 0.5 else text).encode()
    document = copy.deepcopy(rng.choice(whole))
    try:
        for _ in range(rng.choice((1, 1, 1, 2, 3, 6))):
            rng.choice(MUTATIONS)(document, rng, whole)
        text = yaml.safe_dump(document, allow_unicode=True)
    except RecursionError:  # too deep to be written here
        return rng.choice(BOMBS).encode()
    if rng.random() < 0.1:
        at = rng.randrange(len(text))
        text = (
            text[:at]
            + rng.choice((":", "-", "\n", "  ", "{", "]", "&a ", "*a", "#", "\x07", "\U0001f600"))
            + text[at + rng.randrange(3) :]
        )
    return text.encode("utf-8", "surrogatepass")


def _places(node: Any) -> Iterator[tuple[Any, Any]]:
    """Iterate over all (container, key) of a document."""
    items = list(node.items()) if isinstance(node, dict) else list(enumerate(node)) if isinstance(node, list) else []
    for key, value in items:
        yield node, key
        yield from _places(value)


def _replace(document: Any, rng: random.Random, _: Any) -> None:
    node, key = _any(document, rng)
    node[key] = rng.choice(ODD)


def _scale(document: Any, rng: random.Random, _: Any) -> None:
    numbers = [
        (node, key) for node, key in _places(document) if isinstance(node[key], int | float) and node[key] is not True
    ]
    if numbers:
        node, key = rng.choice(numbers)
        node[key] *= rng.choice((-1, 0, 10, 1e-3, 1e3, 1e-9, 1e9, 1e200))


def _remove(document: Any, rng: random.Random, _: Any) -> None:
    node, key = _any(document, rng)
    del node[key]


def _add(document: Any, rng: random.Random, _: Any) -> None:
    node, key = _any(document, rng)
    if isinstance(node, dict):
        node[rng.choice((f"{key}s", "unknown", "", "é", str(key).upper(), 5))] = rng.choice(ODD)
    else:
        node.extend([node[key]] * rng.choice((1, 3, 400)))


def _exchange(document: Any, rng: random.Random, _: Any) -> None:
    (node, key), (other, place) = _any(document, rng), _any(document, rng)
    node[key], other[place] = copy.deepcopy(other[place]), copy.deepcopy(node[key])


def _graft(document: Any, rng: random.Random, whole: list[dict[str, Any]]) -> None:
    node, key = _any(document, rng)
    source, place = rng.choice(list(_places(rng.choice(whole))))
    node[key] = copy.deepcopy(source[place])


def _nest(document: Any, rng: random.Random, _: Any) -> None:
    node, key = _any(document, rng)
    for _step in range(rng.choice((1, 2, 40, 150))):
        node[key] = [node[key]] if rng.random() < 0.5 else {"a": node[key]}


def _any(document: Any, rng: random.Random) -> tuple[Any, Any]:
    places = list(_places(document))
    if not places:
        document["name"] = "x"
        places = [(document, "name")]
    return rng.choice(places)


MUTATIONS: Final[tuple[Callable[[Any, random.Random, list[dict[str, Any]]], None], ...]] = (
    _replace, _replace, _scale, _scale, _remove, _add, _exchange, _graft, _nest,
)  # fmt: skip
