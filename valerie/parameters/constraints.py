"""Constraints: comparisons that a variant must satisfy, in a small grammar.

    p1 < 3 and (p2 >= 2 * p1 or person-1.character == 'yellow-shirt')

`_GRAMMAR` is the whole language; ``0 <= p1 < 3`` means ``0 <= p1 and p1 < 3``. A name is a parameter's name or path.
Names contain dots and hyphens, so the longest known name matches, and a minus next to a name needs a space. Numbers are in the
parameter's unit; ``50 %`` is 0.5. Types are checked when a constraint is compiled. No text is ever executed as Python: the parse
tree becomes closures.

The same grammar selects rows of results (`valerie.runs.resolving.where`), where values may be missing. Logic then has three
values, as in SQL: a comparison with a missing value is neither true nor false, and only a true expression holds. A quotient by
zero is a missing value; ``pacc is undefined`` tests for one. `Constraint.sql` is the equivalent SQL.
"""

from __future__ import annotations

import math
import operator
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from functools import lru_cache
from itertools import pairwise
from typing import Any, Final, NamedTuple, Protocol, cast

from lark import Lark, Token, Tree, UnexpectedCharacters, UnexpectedToken, v_args
from lark.exceptions import VisitError
from lark.tree import Meta
from lark.visitors import Transformer_NonRecursive

from valerie.errors import InvalidInput, UnknownName
from valerie.parameters.definitions import ParameterType, Value

MAX_LENGTH: Final = 2000
MAX_DEPTH: Final = 32

_Values = Mapping[str, Value | None]
_Evaluate = Callable[[_Values], Any]

_GRAMMAR: Final = r"""
start: disjunction
?disjunction: conjunction (_OR conjunction)*
?conjunction: negation (_AND negation)*
?negation: _NOT negation -> negated
    | comparison
?comparison: total (COMPARE total)*
    | total _IS _UNDEFINED -> undefined
?total: product ((PLUS | MINUS) product)*
?product: factor (PRODUCT factor)*
?factor: MINUS factor -> minus
    | NUMBER -> number
    | TEXT -> text
    | _TRUE -> true
    | _FALSE -> false
    | NAME -> name
    | "(" disjunction ")" -> brackets

COMPARE: "<=" | ">=" | "==" | "!=" | "<" | ">"
PLUS: "+"
MINUS: "-" | "−"
PRODUCT: "*" | "/" | "×" | "÷"
NUMBER: /([0-9]+(\.[0-9]*)?|\.[0-9]+)([eE][+-]?[0-9]+)?(\s*%)?/
TEXT: /'[^']*'|"[^"]*"/
_OR.2: /or(?![A-Za-z0-9_])/
_AND.2: /and(?![A-Za-z0-9_])/
_NOT.2: /not(?![A-Za-z0-9_])/
_TRUE.2: /true(?![A-Za-z0-9_])/
_FALSE.2: /false(?![A-Za-z0-9_])/
_IS.2: /is(?![A-Za-z0-9_])/
_UNDEFINED.2: /undefined(?![A-Za-z0-9_])/
%ignore /\s+/
"""
_NAME: Final = re.compile(r"[A-Za-z_][A-Za-z0-9_.\-]*")
_WORDS: Final = frozenset({"and", "or", "not", "true", "false", "is", "undefined"})
#: The language in one line, for errors.
_ALLOWED: Final = "names, numbers, 'text', < <= > >= == !=, is undefined, + - * /, and, or, not, ( )"
_COMPARE: Final[dict[str, Callable[[Any, Any], bool]]] = {
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
    "==": operator.eq,
    "!=": operator.ne,
}


def _quotient(a: float, b: float) -> float | None:
    return a / b if b else None


_ARITHMETIC: Final[dict[str, Callable[[Any, Any], Any]]] = {
    "+": operator.add,
    "-": operator.sub,
    "−": operator.sub,
    "*": operator.mul,
    "×": operator.mul,
    "/": _quotient,
    "÷": _quotient,
}
#: Operators with another notation in SQL.
_SQL: Final = {"==": "=", "!=": "<>", "−": "-", "×": "*", "÷": "/"}


class Operand(Protocol):
    """A name in an expression: a parameter's definition, or a column of results.

    Attributes:
        path: key of its value in the mapping to evaluate.
        default: value if the mapping has no such key; None is a missing value.
        choices: texts that it can be compared with; empty for any text.
        share: True if its values lie in 0…1 and people read them in per cent.
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
    @property
    def share(self) -> bool: ...


class _Kind(StrEnum):
    NUMBER = "a number"
    TEXT = "text"
    TRUTH = "true or false"


class Sql(NamedTuple):
    """A condition in SQL, in which a path is the quoted name of a column.

    Attributes:
        text: the condition, with a question mark for each value.
        values: values to bind, in order. Texts of a request are never part of ``text``.
    """

    text: str
    values: tuple[float | str, ...] = ()


class _Term(NamedTuple):
    """A part of a constraint: its closure, SQL, kind and depth, and its origin if it is a bare name, text or number."""

    evaluate: _Evaluate
    sql: Sql
    kind: _Kind
    definition: Operand | None = None
    text: str | None = None
    number: float | None = None
    depth: int = 0


@dataclass(frozen=True, slots=True)
class Constraint:
    """A compiled constraint.

    Attributes:
        text: its source.
        paths: paths of the parameters in it.
        sql: the equivalent condition on a table whose columns are the paths.
    """

    text: str
    paths: frozenset[str]
    sql: Sql
    _evaluate: _Evaluate

    def holds(self, values: Mapping[str, Value | None]) -> bool:
        """Return True if a variant satisfies the constraint.

        A comparison that depends on a missing value, or on a quotient by zero, does not satisfy it.

        Args:
            values: path to value; absent paths take their defaults.
        """
        return bool(self._evaluate(values))


def compile_constraint(
    text: str, names: Mapping[str, Operand], *, field: str = "", word: str = "parameter"
) -> Constraint:
    """Parse and type-check a constraint.

    Args:
        text: the constraint in the grammar above.
        names: operands by each of their names.
        field: field of the constraint, for errors.
        word: noun for the names in errors.

    Raises:
        InvalidInput: the text breaks the grammar, compares different kinds, or is too long or too deeply nested.
        UnknownName: no operand has this name, or its operand has no such choice.
    """
    if len(text) > MAX_LENGTH:
        raise InvalidInput("the constraint is too long", field=field, value=len(text), limit=f"{MAX_LENGTH} characters")
    compiler = _Compiler(text, names, field, word)
    try:
        term = compiler.transform(_parse(text, names, field, word))
    except VisitError as error:
        raise error.orig_exc from None
    return Constraint(text, frozenset(compiler.paths), term.sql, term.evaluate)


@lru_cache(maxsize=16)
def _parser(names: frozenset[str]) -> Lark:
    """Build the parser for a set of names. Its lexer takes the longest name that matches."""
    longest_first = sorted((re.escape(name) for name in names - _WORDS if name), key=len, reverse=True)
    alternatives = "|".join(longest_first) or "(?!)"
    return Lark(_GRAMMAR + f"NAME.3: /(?:{alternatives})(?![A-Za-z0-9_])/\n", parser="lalr", propagate_positions=True)


@v_args(meta=True, inline=True)
class _Compiler(Transformer_NonRecursive[Token, _Term]):
    """Turn a parse tree into closures, and check the kinds of its parts."""

    def __init__(self, text: str, names: Mapping[str, Operand], field: str, word: str) -> None:
        super().__init__()
        self._text, self._names, self._field, self._word = text, names, field, word
        self.paths: set[str] = set()

    def start(self, meta: Meta, term: _Term) -> _Term:
        return self._truth(meta, term)

    def disjunction(self, meta: Meta, *terms: _Term) -> _Term:
        parts = [self._truth(meta, term).evaluate for term in terms]
        return self._term(
            meta, lambda values: _any(part(values) for part in parts), _joined("OR", terms), _Kind.TRUTH, terms
        )

    def conjunction(self, meta: Meta, *terms: _Term) -> _Term:
        parts = [self._truth(meta, term).evaluate for term in terms]
        return self._term(
            meta, lambda values: _all(part(values) for part in parts), _joined("AND", terms), _Kind.TRUTH, terms
        )

    def negated(self, meta: Meta, term: _Term) -> _Term:
        negated = self._truth(meta, term).evaluate
        return self._term(
            meta, lambda values: _unless_missing(operator.not_, negated(values)), _spliced("(NOT ", term, ")"),
            _Kind.TRUTH, [term],
        )  # fmt: skip

    def undefined(self, meta: Meta, term: _Term) -> _Term:
        evaluate = term.evaluate
        return self._term(
            meta, lambda values: evaluate(values) is None, _spliced("(", term, " IS NULL)"), _Kind.TRUTH, [term]
        )

    def comparison(self, meta: Meta, first: _Term, *rest: Token | _Term) -> _Term:
        signs, terms = rest[::2], [first, *cast("tuple[_Term, ...]", rest[1::2])]
        pairs, compared = [], []
        for (left, right), sign in zip(pairwise(terms), signs, strict=True):
            self._comparable(meta, left, str(sign), right)
            pairs.append((left.evaluate, _COMPARE[str(sign)], right.evaluate))
            compared.append(_spliced("(", left, f" {_SQL.get(str(sign), sign)} ", right, ")"))
        return self._term(
            meta,
            lambda values: _all(_unless_missing(compare, a(values), b(values)) for a, compare, b in pairs),
            _joined("AND", compared),
            _Kind.TRUTH,
            terms,
        )

    def total(self, meta: Meta, first: _Term, *rest: Token | _Term) -> _Term:
        terms = cast("tuple[_Term, ...]", rest[1::2])
        start = self._number(meta, first).evaluate
        steps, sql = [], first.sql
        for sign, term in zip(rest[::2], terms, strict=True):
            steps.append((_ARITHMETIC[str(sign)], self._number(meta, term).evaluate))
            sql = _spliced("(", sql, f" {_SQL.get(str(sign), sign)} ", term, ")")

        def evaluate(values: _Values) -> Any:
            result = start(values)
            for apply, operand in steps:
                result = _unless_missing(apply, result, operand(values))
            return result

        return self._term(meta, evaluate, sql, _Kind.NUMBER, [first, *terms])

    product = total

    def minus(self, meta: Meta, _sign: Token, term: _Term) -> _Term:
        negated = self._number(meta, term).evaluate
        return self._term(
            meta, lambda values: _unless_missing(operator.neg, negated(values)), _spliced("(- ", term, ")"),
            _Kind.NUMBER, [term],
        )  # fmt: skip

    def brackets(self, meta: Meta, term: _Term) -> _Term:
        return self._term(meta, term.evaluate, term.sql, term.kind, [term])

    def number(self, meta: Meta, token: Token) -> _Term:
        digits, per_cent, _ = str(token).partition("%")
        number = float(digits) / 100 if per_cent else float(digits)
        if not math.isfinite(number):
            raise self._error("the number is too large", meta)
        return _Term(lambda _: number, Sql("?::DOUBLE", (number,)), _Kind.NUMBER, number=number)

    def text(self, _meta: Meta, token: Token) -> _Term:
        text = str(token)[1:-1]
        return _Term(lambda _: text, Sql("?::VARCHAR", (text,)), _Kind.TEXT, text=text)

    def true(self, _meta: Meta) -> _Term:
        return _Term(lambda _: True, Sql("TRUE"), _Kind.TRUTH)

    def false(self, _meta: Meta) -> _Term:
        return _Term(lambda _: False, Sql("FALSE"), _Kind.TRUTH)

    def name(self, _meta: Meta, token: Token) -> _Term:
        definition = self._names[str(token)]
        path, default = definition.path, definition.default
        self.paths.add(path)
        kind = {ParameterType.BOOL: _Kind.TRUTH, ParameterType.CATEGORICAL: _Kind.TEXT}
        return _Term(
            lambda values: values.get(path, default), Sql(quoted(path)), kind.get(definition.type, _Kind.NUMBER),
            definition,
        )  # fmt: skip

    def _term(self, meta: Meta, evaluate: _Evaluate, sql: Sql, kind: _Kind, parts: Sequence[_Term]) -> _Term:
        depth = 1 + max(part.depth for part in parts)
        if depth > MAX_DEPTH:
            raise self._error(f"nested more than {MAX_DEPTH} deep", meta)
        return _Term(evaluate, sql, kind, depth=depth)

    def _comparable(self, meta: Meta, left: _Term, sign: str, right: _Term) -> None:
        if left.kind is not right.kind:
            raise self._error(f"{left.kind} cannot be compared with {right.kind}", meta)
        if left.kind is not _Kind.NUMBER and sign not in ("==", "!="):
            raise self._error(f"{left.kind} is compared with == or !=, not with {sign}", meta)
        for name, literal in ((left, right), (right, left)):
            choices = name.definition.choices if name.definition is not None else ()
            if choices and literal.text is not None and literal.text not in choices:
                assert name.definition is not None, "choices come from a definition"
                raise UnknownName(f"choice of {name.definition.name}", literal.text, choices, field=self._field)
            number = literal.number or 0.0
            if name.definition is not None and name.definition.share and number > 1.0:
                raise InvalidInput(
                    f"{name.definition.name} is a share in 0…1", field=self._field, value=f"{number:g}",
                    limit=f"1; {number:g} % is another way to write {number / 100:g}",
                )  # fmt: skip

    def _truth(self, meta: Meta, term: _Term) -> _Term:
        if term.kind is not _Kind.TRUTH:
            raise self._error(f"a comparison is needed here, not {term.kind}", meta)
        return term

    def _number(self, meta: Meta, term: _Term) -> _Term:
        if term.kind is not _Kind.NUMBER:
            raise self._error(f"a number is needed here, not {term.kind}", meta)
        return term

    def _error(self, message: str, meta: Meta) -> InvalidInput:
        return _refused(message, self._text, meta.start_pos, self._field)


def _parse(text: str, names: Mapping[str, Operand], field: str, word: str) -> Tree[Token]:
    try:
        return _parser(frozenset(names)).parse(text)
    except UnexpectedCharacters as problem:
        place = problem.pos_in_stream or 0
        if name := _NAME.match(text, place):
            if any(name[0] in operand.choices for operand in names.values()):
                raise _refused(f"text is quoted: '{name[0]}'", text, place, field) from None
            raise UnknownName(word, name[0], names, field=field, limit=_ALLOWED) from None
        raise _refused(f"{text[place]!r} is not expected here", text, place, field) from None
    except UnexpectedToken as problem:
        if problem.token.type != "$END":
            raise _refused(
                f"{str(problem.token)!r} is not expected here", text, problem.pos_in_stream or 0, field
            ) from None
        message = "a closing bracket is missing" if "RPAR" in problem.accepts else "the constraint ends too early"
        raise _refused(message, text, len(text), field) from None


def _refused(message: str, text: str, place: int, field: str) -> InvalidInput:
    return InvalidInput(f"{message} (character {place + 1})", field=field, value=text, limit=_ALLOWED)


def quoted(name: str) -> str:
    """Return the name of a column, quoted for SQL."""
    return '"' + name.replace('"', '""') + '"'


def _spliced(*parts: str | Sql | _Term) -> Sql:
    """Return the concatenation of texts and the SQL of terms."""
    pieces = [Sql(part) if isinstance(part, str) else part.sql if isinstance(part, _Term) else part for part in parts]
    return Sql("".join(piece.text for piece in pieces), tuple(value for piece in pieces for value in piece.values))


def _joined(word: str, parts: Sequence[_Term | Sql]) -> Sql:
    first, *others = parts
    return _spliced("(", first, *(piece for part in others for piece in (f" {word} ", part)), ")")


def _unless_missing(apply: Callable[..., Any], *operands: Any) -> Any:
    return None if None in operands else apply(*operands)


def _all(parts: Iterable[Any]) -> bool | None:
    """Return Kleene's "and": false if any part is false, else None if any is missing."""
    result: bool | None = True
    for part in parts:
        if part is None:
            result = None
        elif not part:
            return False
    return result


def _any(parts: Iterable[Any]) -> bool | None:
    """Return Kleene's "or": true if any part is true, else None if any is missing."""
    result: bool | None = False
    for part in parts:
        if part is None:
            result = None
        elif part:
            return True
    return result
