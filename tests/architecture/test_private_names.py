"""Tests know what is public: they import and replace no private name. (Ruff refuses private attributes: SLF001.)"""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

TESTS = Path(__file__).parents[1]
#: Functions that replace an attribute; its name is an argument.
REPLACING = {"setattr", "delattr", "object", "patch"}


def _is_private(dotted: str) -> bool:
    return any(re.fullmatch(r"_(?!_).*", part) for part in dotted.split("."))


def private_names(source: str) -> Iterator[str]:
    """Yield the private names that a module imports, replaces by name, or empties a cache of."""
    for node in ast.walk(ast.parse(source)):
        match node:
            case ast.Import(names=names):
                yield from (name.name for name in names if _is_private(name.name))
            case ast.ImportFrom(module=module, names=names):
                dotted = (f"{module or ''}.{name.name}" for name in names)
                yield from (name for name in dotted if _is_private(name))
            case ast.Call(func=ast.Attribute(attr="cache_clear") as called):
                yield ast.unparse(called)
            case ast.Call(func=ast.Attribute(attr=attribute), args=arguments) if attribute in REPLACING:
                texts = [
                    argument.value
                    for argument in arguments[:2]
                    if isinstance(argument, ast.Constant) and isinstance(argument.value, str)
                ]
                yield from (text for text in texts if _is_private(text))


@pytest.mark.parametrize(
    ("source", "name"),
    [
        ("from valerie.a import _b", "valerie.a._b"),
        ("import valerie._a", "valerie._a"),
        ("monkeypatch.setattr(module, '_b', 1)", "_b"),
        ("monkeypatch.setattr('valerie.a._b', 1)", "valerie.a._b"),
        ("with mock.patch.object(module, '_b'): pass", "_b"),
        ("module.names.cache_clear()", "module.names.cache_clear"),
    ],
)
def test_a_private_name_is_found(source: str, name: str) -> None:
    assert list(private_names(source)) == [name]


def test_no_test_knows_private_names() -> None:
    uses = {str(path.relative_to(TESTS)): list(private_names(path.read_text())) for path in TESTS.rglob("*.py")}
    assert {path: names for path, names in uses.items() if names} == {}
