"""Constraints: comparisons that a variant must meet, in a small grammar of their own.

    p1 < 3 and (p2 >= 2 * p1 or person-1.character == 'yellow-shirt')

::

    expression = conjunction { "or" conjunction }
    conjunction = negation { "and" negation }
    negation    = "not" negation | comparison
    comparison  = sum { ("<" | "<=" | ">" | ">=" | "==" | "!=") sum }       0 <= p1 < 3 is p1 >= 0 and p1 < 3
    sum         = product { ("+" | "-") product }
    product     = factor { ("*" | "/") factor }
    factor      = "-" factor | number | 'text' | "true" | "false" | name | "(" expression ")"

A name is a parameter's name or path; since names hold dots and hyphens, the longest known name wins, and a minus
beside a name wants a space. Numbers are in the parameter's unit. Types are checked when a constraint is compiled. No
text is ever
executed as Python: the parser below builds closures.

The same grammar selects rows of results (`valerie.analysis.where`), where values may be missing. Logic then has three
values, as in SQL: a comparison with what is missing is neither true nor false, and only what is true holds.
"""

from __future__ import annotations

import math
import operator
import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, Final, NamedTuple, Protocol

from valerie.errors import InvalidInput, UnknownName
from valerie.parameters.definitions import ParameterType, Value

MAX_LENGTH: Final = 2000
MAX_DEPTH: Final = 32

_Evaluate = Callable[[Mapping[str, Any]], Any]

_TOKEN: Final = re.compile(
    r"\s*(?:"
    r"(?P<number>(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][+-]?[0-9]+)?)"
    r"|(?P<text>'[^']*'|\"[^\"]*\")"
    r"|(?P<name>[A-Za-z_][A-Za-z0-9_.\-]*)"
    r"|(?P<sign><=|>=|==|!=|[<>()+\-−*×/÷])"
    r")"
)
_WORDS: Final = frozenset({"and", "or", "not", "true", "false"})
#: What an expression may hold, for errors.
_GRAMMAR: Final = "names, numbers, 'text', < <= > >= == !=, + - * /, and, or, not, ( )"
_SAME_SIGN: Final = {"−": "-", "×": "*", "÷": "/"}
_COMPARE: Final[dict[str, Callable[[Any, Any], bool]]] = {
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
    "==": operator.eq,
    "!=": operator.ne,
}
_ARITHMETIC: Final[dict[str, Callable[[Any, Any], Any]]] = {
    "+": operator.add,
    "-": operator.sub,
    "*": operator.mul,
    "/": operator.truediv,
}


class Spoken(Protocol):
    """What an expression may speak of: a parameter's definition, or a column of results.

    Attributes:
        path: where its value stands in the mapping that is evaluated.
        default: taken where the mapping lacks it; None is a missing value.
        choices: the texts that it can be compared with; empty: any.
    """

    @property
    def name(self) -> str: ...
    @property
    def path(self) -> str: ...
    @property
    def type(self) -> ParameterType: ...
    @property
    def default(self) -> Value | None: ...
    @property
    def choices(self) -> tuple[str, ...]: ...


class _Kind(StrEnum):
    NUMBER = "a number"
    TEXT = "text"
    TRUTH = "true or false"


class _Token(NamedTuple):
    kind: str
    text: str
    place: int


class _Term(NamedTuple):
    """A part of a constraint: how to evaluate it, its kind, and where it comes from if it is a bare name or text."""

    evaluate: _Evaluate
    kind: _Kind
    definition: Spoken | None = None
    text: str | None = None


@dataclass(frozen=True, slots=True)
class Constraint:
    """A compiled constraint.

    Attributes:
        text: as it was written.
        paths: the parameters that it speaks of.
    """

    text: str
    paths: frozenset[str]
    _evaluate: _Evaluate

    def holds(self, values: Mapping[str, Any]) -> bool:
        """Whether a variant (path to value; the rest takes its defaults) meets it.

        A division by zero does not, nor does what depends on a missing value (None).
        """
        try:
            return bool(self._evaluate(values))
        except ZeroDivisionError:
            return False


def compile_constraint(
    text: str, names: Mapping[str, Spoken], *, field: str = "", word: str = "parameter"
) -> Constraint:
    """Parse and type-check a constraint.

    Args:
        text: as the grammar above.
        names: what may be spoken of, by every name that it has.
        field: where the constraint stands, for errors.
        word: what the names are called in errors.

    Raises:
        InvalidInput: it does not follow the grammar, compares different kinds, or is too long or too deeply nested.
        UnknownName: a name that is no parameter's, or text that is no choice of the parameter it is compared with.
    """
    if len(text) > MAX_LENGTH:
        raise InvalidInput("the constraint is too long", field=field, value=len(text), limit=f"{MAX_LENGTH} characters")
    parser = _Parser(text, names, field, word)
    term = parser.parse()
    return Constraint(text, frozenset(parser.paths), term.evaluate)


class _Parser:
    """Recursive descent over the grammar above; each method reads one rule and returns its term."""

    def __init__(self, text: str, names: Mapping[str, Spoken], field: str, word: str) -> None:
        self._text, self._names, self._field, self._word = text, names, field, word
        self._tokens = self._tokenize()
        self._next = 0
        self._depth = 0
        self.paths: set[str] = set()

    def parse(self) -> _Term:
        term = self._expression()
        if self._peek() != "":
            raise self._error(f"{self._peek()!r} is not expected here")
        return self._truth(term)

    def _tokenize(self) -> list[_Token]:
        tokens: list[_Token] = []
        place = 0
        while self._text[place:].strip():
            match = _TOKEN.match(self._text, place)
            if match is None or match.lastgroup is None:
                stripped = self._text[place:].lstrip()
                raise self._error(f"{stripped[0]!r} is not expected here", len(self._text) - len(stripped))
            kind, word, start = match.lastgroup, match[match.lastgroup], match.start(match.lastgroup)
            if kind == "name":
                word = self._longest_name(word)
            tokens.append(_Token("word" if word in _WORDS else kind, _SAME_SIGN.get(word, word), start))
            place = start + len(word)
        return tokens

    def _longest_name(self, run: str) -> str:
        ends = [len(run), *(match.start() for match in re.finditer(r"[.\-]", run))]
        for end in sorted(ends, reverse=True):
            if run[:end] in self._names or run[:end] in _WORDS:
                return run[:end]
        raise UnknownName(self._word, run, self._names, field=self._field, limit=_GRAMMAR)

    def _error(self, message: str, place: int | None = None) -> InvalidInput:
        if place is None:
            place = self._tokens[self._next].place if self._next < len(self._tokens) else len(self._text)
        return InvalidInput(f"{message} (character {place + 1})", field=self._field, value=self._text, limit=_GRAMMAR)

    def _peek(self) -> str:
        """The next word or sign; a number, text or name shows as itself and never equals one of these."""
        return self._tokens[self._next].text if self._next < len(self._tokens) else ""

    def _accept(self, *texts: str) -> str:
        if self._next < len(self._tokens):
            token = self._tokens[self._next]
            if token.kind in ("word", "sign") and token.text in texts:
                self._next += 1
                return token.text
        return ""

    def _deeper(self, rule: Callable[[], _Term]) -> _Term:
        self._depth += 1
        if self._depth > MAX_DEPTH:
            raise self._error(f"nested more than {MAX_DEPTH} deep")
        term = rule()
        self._depth -= 1
        return term

    def _expression(self) -> _Term:
        terms = [self._conjunction()]
        while self._accept("or"):
            terms.append(self._conjunction())
        if len(terms) == 1:
            return terms[0]
        parts = [self._truth(term).evaluate for term in terms]
        return _Term(lambda values: _any(part(values) for part in parts), _Kind.TRUTH)

    def _conjunction(self) -> _Term:
        terms = [self._negation()]
        while self._accept("and"):
            terms.append(self._negation())
        if len(terms) == 1:
            return terms[0]
        parts = [self._truth(term).evaluate for term in terms]
        return _Term(lambda values: _all(part(values) for part in parts), _Kind.TRUTH)

    def _negation(self) -> _Term:
        if not self._accept("not"):
            return self._comparison()
        negated = self._truth(self._deeper(self._negation)).evaluate
        return _Term(lambda values: _unless_missing(operator.not_, negated(values)), _Kind.TRUTH)

    def _comparison(self) -> _Term:
        left = self._sum()
        pairs: list[tuple[_Evaluate, Callable[[Any, Any], bool], _Evaluate]] = []
        while sign := self._accept(*_COMPARE):
            right = self._sum()
            self._comparable(left, sign, right)
            pairs.append((left.evaluate, _COMPARE[sign], right.evaluate))
            left = right
        if not pairs:
            return left
        if len(pairs) == 1:
            ((a, compare, b),) = pairs
            return _Term(lambda values: _unless_missing(compare, a(values), b(values)), _Kind.TRUTH)
        return _Term(
            lambda values: _all(_unless_missing(compare, a(values), b(values)) for a, compare, b in pairs), _Kind.TRUTH
        )

    def _comparable(self, left: _Term, sign: str, right: _Term) -> None:
        if left.kind is not right.kind:
            raise self._error(f"{left.kind} cannot be compared with {right.kind}")
        if left.kind is not _Kind.NUMBER and sign not in ("==", "!="):
            raise self._error(f"{left.kind} is compared with == or !=, not with {sign}")
        for name, literal in ((left, right), (right, left)):
            known = name.definition.choices if name.definition is not None else ()
            if known and literal.text is not None and literal.text not in known:
                assert name.definition is not None, "choices come from a definition"
                raise UnknownName(f"choice of {name.definition.name}", literal.text, known, field=self._field)

    def _sum(self) -> _Term:
        return self._chain(("+", "-"), self._product)

    def _product(self) -> _Term:
        return self._chain(("*", "/"), self._factor)

    def _chain(self, signs: tuple[str, ...], rule: Callable[[], _Term]) -> _Term:
        first = rule()
        rest: list[tuple[Callable[[Any, Any], Any], _Evaluate]] = []
        while sign := self._accept(*signs):
            self._number(first)
            rest.append((_ARITHMETIC[sign], self._number(rule()).evaluate))
        if not rest:
            return first
        start = first.evaluate

        def evaluate(values: Mapping[str, Value]) -> Any:
            result = start(values)
            for apply, operand in rest:
                result = _unless_missing(apply, result, operand(values))
            return result

        return _Term(evaluate, _Kind.NUMBER)

    def _factor(self) -> _Term:
        if self._accept("-"):
            negated = self._number(self._deeper(self._factor)).evaluate
            return _Term(lambda values: _unless_missing(operator.neg, negated(values)), _Kind.NUMBER)
        if self._accept("("):
            inner = self._deeper(self._expression)
            if not self._accept(")"):
                raise self._error("a closing bracket is missing")
            return inner._replace(definition=None, text=None)
        if self._next >= len(self._tokens):
            raise self._error("the constraint ends too early")
        return self._atom()

    def _atom(self) -> _Term:
        token = self._tokens[self._next]
        if token.kind == "sign" or token.text in ("and", "or", "not"):
            raise self._error(f"{token.text!r} is not expected here")
        if token.kind == "number":
            number = float(token.text)
            if not math.isfinite(number):
                raise self._error("the number is too large")
            self._next += 1
            return _Term(lambda _: number, _Kind.NUMBER)
        self._next += 1
        if token.kind == "text":
            text = token.text[1:-1]
            return _Term(lambda _: text, _Kind.TEXT, text=text)
        if token.kind == "word":
            truth = token.text == "true"
            return _Term(lambda _: truth, _Kind.TRUTH)
        definition = self._names[token.text]
        path, default = definition.path, definition.default
        self.paths.add(path)
        kind = {ParameterType.BOOL: _Kind.TRUTH, ParameterType.CATEGORICAL: _Kind.TEXT}
        return _Term(lambda values: values.get(path, default), kind.get(definition.type, _Kind.NUMBER), definition)

    def _truth(self, term: _Term) -> _Term:
        if term.kind is not _Kind.TRUTH:
            raise self._error(f"a comparison is needed here, not {term.kind}")
        return term

    def _number(self, term: _Term) -> _Term:
        if term.kind is not _Kind.NUMBER:
            raise self._error(f"a number is needed here, not {term.kind}")
        return term


def _unless_missing(apply: Callable[..., Any], *operands: Any) -> Any:
    return None if any(operand is None for operand in operands) else apply(*operands)


def _all(parts: Iterable[Any]) -> bool | None:
    """Kleene's "and": false as soon as one part is; missing if one is and none is false."""
    result: bool | None = True
    for part in parts:
        if part is None:
            result = None
        elif not part:
            return False
    return result


def _any(parts: Iterable[Any]) -> bool | None:
    """Kleene's "or": true as soon as one part is; missing if one is and none is true."""
    result: bool | None = False
    for part in parts:
        if part is None:
            result = None
        elif part:
            return True
    return result
