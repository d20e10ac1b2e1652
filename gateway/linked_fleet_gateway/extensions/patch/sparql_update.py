"""SPARQL updates of one small graph (SPARQL 1.1 Update, 3.1).

Supported are ``INSERT DATA``, ``DELETE DATA``, ``DELETE WHERE`` and ``DELETE … INSERT … WHERE`` with triple patterns
only. Updates run on the event loop, so every step counts towards a limit.
"""

import secrets
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

from pyoxigraph import BlankNode, Literal, NamedNode, Triple

from linked_fleet_base.errors import BadRequest, PayloadTooLarge, UnprocessableContent
from linked_fleet_rdf.parsing import ParseError, parse
from linked_fleet_rdf.sparql_tokens import Token, syntax_error, tokenize

MAX_STEPS = 5_000
"""Most comparisons of a pattern with a triple and triples built from templates."""
MAX_TRIPLES = 1_000
MAX_OPERATIONS = 16
MAX_PROLOGUE = 4_096
"""Most characters of prefixes, which are parsed again with each block."""
_WORDS = ("a", "true", "false")  # keywords shared with Turtle
_DIRECTIVES = ("@prefix", "@base", "@version")


@dataclass(frozen=True)
class Variable:
    """A variable, or a blank node of a pattern, which matches anything too."""

    name: str


Term = NamedNode | BlankNode | Literal | Variable
Pattern = tuple[Term, Term, Term]
Row = Mapping[Term, Term]


@dataclass(frozen=True)
class Operation:
    """For each solution of ``where`` in the graph: remove ``delete``, then add ``insert``."""

    delete: Sequence[Pattern] = ()
    insert: Sequence[Pattern] = ()
    where: Sequence[Pattern] = ()


def read_patch(content: bytes, iri: str) -> Callable[[Sequence[Triple]], list[Triple]]:
    """Return the update in a body of PATCH. Raises BadRequest, PayloadTooLarge."""
    try:
        operations = parse_update(content.decode("utf-8-sig"), iri)
    except UnicodeDecodeError as error:
        raise BadRequest("The update is not UTF-8.") from error
    return partial(apply_update, operations=operations)


def parse_update(text: str, base: str) -> list[Operation]:
    """Return the operations in order.

    Raises BadRequest for unsupported updates, PayloadTooLarge. ``base``: for relative IRIs.
    """
    return _Reader(text, base).operations()


def apply_update(triples: Sequence[Triple], operations: Iterable[Operation]) -> list[Triple]:
    """Return the graph after the operations, in stable order.

    Raises UnprocessableContent if that takes too many steps.
    """
    graph = dict.fromkeys(triples)
    budget = _Budget()
    for operation in operations:
        rows = _rows(operation.where, graph, budget)
        gone = [triple for row in rows for triple in _made(operation.delete, row, budget)]
        come = [triple for row in rows for triple in _made(operation.insert, row, budget)]
        for triple in gone:
            graph.pop(triple, None)
        graph |= dict.fromkeys(come)
        if len(graph) > max(MAX_TRIPLES, len(triples)):
            raise UnprocessableContent(f"The update makes more than {MAX_TRIPLES} statements.")
    return list(graph)


class _Budget:
    def __init__(self) -> None:
        self._left = MAX_STEPS

    def spend(self, steps: int) -> None:
        self._left -= steps
        if self._left < 0:
            raise UnprocessableContent(f"The update takes more than {MAX_STEPS} steps; name what it is about.")


def _rows(patterns: Sequence[Pattern], graph: Mapping[Triple, None], budget: _Budget) -> list[Row]:
    if not patterns:
        return [{}]
    budget.spend(len(graph))
    facts: list[Pattern] = [tuple(triple) for triple in graph]
    by_predicate: dict[Term, list[Pattern]] = {}
    for fact in facts:
        by_predicate.setdefault(fact[1], []).append(fact)
    rows: list[Row] = [{}]
    for pattern in patterns:
        predicate = pattern[1]
        candidates = facts if isinstance(predicate, Variable) else by_predicate.get(predicate, ())
        budget.spend(len(rows) * len(candidates))
        rows = [found for row in rows for fact in candidates if (found := _match(pattern, fact, row)) is not None]
    return rows


def _match(pattern: Pattern, fact: Pattern, row: Row) -> Row | None:
    found = dict(row)
    for asked, term in zip(pattern, fact, strict=True):
        if (found.setdefault(asked, term) if isinstance(asked, Variable) else asked) != term:
            return None
    return found


def _made(template: Sequence[Pattern], row: Row, budget: _Budget) -> list[Triple]:
    """Return the triples of a template, with fresh blank nodes."""
    budget.spend(len(template))
    fresh: dict[Term, BlankNode] = {}
    return [Triple(*(_term(each, row, fresh) for each in pattern)) for pattern in template if _is_triple(pattern, row)]  # type: ignore[arg-type]


def _term(term: Term, row: Row, fresh: dict[Term, BlankNode]) -> Term:
    if isinstance(term, BlankNode):
        return fresh.setdefault(term, BlankNode())
    return row[term] if isinstance(term, Variable) else term


def _is_triple(pattern: Pattern, row: Row) -> bool:
    subject, predicate, _ = (row.get(term, term) for term in pattern)
    if isinstance(subject, Literal) or not isinstance(predicate, NamedNode):
        raise UnprocessableContent(
            "The update would make a statement about a text, or with a predicate that is no IRI."
        )
    return True


class _Reader:
    """A one-pass parser. The triples of a block are parsed as Turtle, with placeholder IRIs for variables."""

    def __init__(self, text: str, base: str) -> None:
        self._text, self._base = text, base
        self._tokens = tokenize(text)
        self._at = 0
        self._prologue: list[str] = []
        self._marker = f"urn:variable:{secrets.token_hex(8)}:"

    def operations(self) -> list[Operation]:
        found: list[Operation] = []
        while True:
            self._read_prologue()
            if self._peek() is None:
                break
            if len(found) == MAX_OPERATIONS:
                raise PayloadTooLarge(f"The update has more than {MAX_OPERATIONS} operations.")
            found.append(self._operation())
            if self._peek() is not None and self._next("; between operations").text != ";":
                raise self._refused("; stands between operations", self._at - 1)
        if not found:
            raise BadRequest("The update has no operation, such as INSERT DATA { … }.")
        return found

    def _read_prologue(self) -> None:
        while (token := self._peek()) is not None and token.word in ("PREFIX", "BASE"):
            words = [self._next("a prefix or an IRI").text for _ in range(3 if token.word == "PREFIX" else 2)]
            self._prologue.append(" ".join(words))
            if sum(map(len, self._prologue)) > MAX_PROLOGUE:
                raise PayloadTooLarge(f"The prefixes of the update have more than {MAX_PROLOGUE} characters.")

    def _operation(self) -> Operation:
        kind = self._next("INSERT or DELETE")
        if kind.word not in ("INSERT", "DELETE"):
            raise self._refused(f"{kind.text[:50]} is not taken here; INSERT and DELETE are", self._at - 1)
        if self._took("DATA"):
            block = self._block(data=True)
            return Operation(insert=block) if kind.word == "INSERT" else Operation(delete=self._ground(block))
        if kind.word == "DELETE" and self._took("WHERE"):
            where = self._block()
            return Operation(delete=self._ground(where), where=where)
        delete = self._ground(self._block()) if kind.word == "DELETE" else ()
        insert = self._block() if kind.word == "INSERT" or self._took("INSERT") else ()
        if not self._took("WHERE"):
            raise self._refused("WHERE { … } follows, with triples alone", self._at)
        where = self._block()
        known = {term for pattern in where for term in pattern}
        for term in (term for pattern in (*delete, *insert) for term in pattern):
            if isinstance(term, Variable) and term not in known:
                raise BadRequest(f"?{term.name[:50]} is not in WHERE.")
        anything = [tuple(Variable(f"_:{t.value}") if isinstance(t, BlankNode) else t for t in each) for each in where]
        return Operation(delete, insert, anything)  # type: ignore[arg-type]

    def _ground(self, block: Sequence[Pattern]) -> Sequence[Pattern]:
        if any(isinstance(term, BlankNode) for pattern in block for term in pattern):
            raise BadRequest("A blank node names nothing that could be deleted: find it by a variable in WHERE.")
        return block

    def _block(self, *, data: bool = False) -> list[Pattern]:
        start = self._next("{")
        if start.text != "{":
            raise self._refused("{ begins a block of triples", self._at - 1)
        parts, end = [], start.start + 1
        while (token := self._next("}")).text != "}":
            self._check(token, data)
            parts.append(self._text[end : token.start])
            parts.append(f"<{self._marker}{token.text[1:]}>" if token.kind == "variable" else token.text)
            end = token.start + len(token.text)
        last = self._tokens[self._at - 2].text
        return self._triples("".join(parts) + ("" if last in (".", "{") else " ."))

    def _check(self, token: Token, data: bool) -> None:
        if token.kind == "variable" and data:
            raise self._refused("DATA has no variables", self._at - 1)
        if token.text == "{":
            raise self._refused("A block is of triples alone", self._at - 1)
        if (token.kind == "word" and token.text not in _WORDS) or token.text.lower() in _DIRECTIVES:
            raise self._refused(f"{token.text[:50]} is not taken here: a block is of triples alone", self._at - 1)

    def _triples(self, block: str) -> list[Pattern]:
        document = "\n".join([*self._prologue, block])
        try:
            triples = parse(document.encode(), "text/turtle", self._base, max_triples=MAX_TRIPLES)
        except ParseError as error:
            raise BadRequest(f"The triples of a block cannot be read: {error.message[:300]}") from error
        return [tuple(self._variable(term) for term in triple) for triple in triples]  # type: ignore[misc]

    def _variable(self, term: Term) -> Term:
        if isinstance(term, Literal) and term.datatype.value.startswith(self._marker):
            raise BadRequest("A variable is no datatype.")
        named = isinstance(term, NamedNode) and term.value.startswith(self._marker)
        return Variable(term.value.removeprefix(self._marker)) if named else term  # type: ignore[union-attr]

    def _peek(self) -> Token | None:
        return self._tokens[self._at] if self._at < len(self._tokens) else None

    def _next(self, expected: str) -> Token:
        token = self._peek()
        if token is None:
            raise BadRequest(f"The update ends where {expected} was expected.")
        self._at += 1
        return token

    def _took(self, word: str) -> bool:
        token = self._peek()
        taken = token is not None and token.word == word
        self._at += taken
        return taken

    def _refused(self, detail: str, at: int) -> BadRequest:
        if at >= len(self._tokens):
            return BadRequest(f"{detail}.")
        return syntax_error(f"{detail}.", self._text, self._tokens[at])
