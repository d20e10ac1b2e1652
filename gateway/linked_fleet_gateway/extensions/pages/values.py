"""Terms of a graph as shown on a page: numbers with units, times, states, links, nested facts."""

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, ClassVar

from pyoxigraph import BlankNode, Literal, NamedNode, Triple

from linked_fleet_base.lazy_imports import LazyModule
from linked_fleet_gateway.extensions.pages import languages, texts
from linked_fleet_gateway.extensions.pages.languages import say
from linked_fleet_rdf.turtle import Outline, Subject, Term
from linked_fleet_rdf.vocabulary import DCTERMS, LF, MATHS, NUMERIC, PREFIXES, QUDT, RDF, SOSA, VOM, XSD

if TYPE_CHECKING:
    from linked_fleet_client import quantity
else:
    quantity = LazyModule("linked_fleet_client.quantity")

_NUMERIC = frozenset(NUMERIC)
_CODE = re.compile(r"://|\?\w+.*\{|^[0-9a-f-]{16,}$|^[a-z]+/[a-z0-9.+-]+$|^[a-z]+[A-Z]\w*$|^\{\W|^\[[^ \w]|^\[\d")
_AXES = (MATHS.x, MATHS.y, MATHS.z, LF.w)
_VOCABULARIES = tuple(PREFIXES.values())
_STATES = frozenset({LF.presence, LF.state, LF.deliveryState})
_TIMES = frozenset({LF.lastSeen, LF.lastMoved, LF.lastFrame, LF.lastDelivery, SOSA.resultTime})
# The other times appear once, together with something else on the page.
_LIVE_TIMES = _TIMES - {LF.lastSeen, LF.lastMoved}


@dataclass(frozen=True)
class Address:
    """The place of a value: a subject's IRI and the predicates that lead from it; ``^`` marks a reversed step."""

    subject: str
    path: str

    def child(self, predicate: NamedNode) -> "Address":
        return Address(self.subject, f"{self.path} {predicate.value}")


@dataclass(frozen=True)
class Number:
    """A number with its unit.

    ``value``: the original text, empty if unknown. ``name``: the unit as in data; ``unit``: the unit as people write
    it.
    """

    text: str
    value: str
    at: Address | None = None
    unit: str = ""
    name: str = ""
    converted: str = ""
    kind: ClassVar[str] = "number"


@dataclass(frozen=True)
class Time:
    text: str
    datetime: str
    at: Address | None = None
    kind: ClassVar[str] = "time"


@dataclass(frozen=True)
class State:
    name: str
    at: Address | None = None
    kind: ClassVar[str] = "state"

    @property
    def label(self) -> str:
        """The state in words, in the language of the page."""
        return languages.translated(self.name)


@dataclass(frozen=True)
class Text:
    text: str
    language: str = ""
    kind: ClassVar[str] = "text"

    @property
    def is_code(self) -> bool:
        """True for text meant for programs: IRIs, URI templates, digests, queries, JSON."""
        return _CODE.search(self.text) is not None


@dataclass(frozen=True)
class Link:
    """A link. ``href`` is empty for an IRI that a browser cannot follow; ``help`` is the comment on a term."""

    text: str
    href: str
    iri: str
    help: str = ""
    kind: ClassVar[str] = "link"


@dataclass(frozen=True)
class Vector:
    parts: Sequence[tuple[str, Number]]
    unit: str
    kind: ClassVar[str] = "vector"


@dataclass(frozen=True)
class Items:
    values: Sequence["Value"]
    kind: ClassVar[str] = "items"


@dataclass(frozen=True)
class Row:
    """One predicate with its values."""

    label: Link
    values: Sequence["Value"]


@dataclass(frozen=True)
class NestedFacts:
    rows: Sequence[Row]
    types: Sequence[Link] = field(default=())
    kind: ClassVar[str] = "nest"


Value = Number | Time | State | Text | Link | Vector | Items | NestedFacts


class Facts:
    """The triples of a resource, and how their terms are shown.

    ``root``: the fleet's IRI, with its slash. ``query``: that of the request, without ``as``.
    """

    def __init__(self, triples: Sequence[Triple], root: str, query: str = "") -> None:
        self.triples = triples
        self.query = query
        self.outline = Outline(triples)
        self.of = self.outline.properties
        self.root = root

    def all(self, subject: Term, *predicates: NamedNode) -> list[Term]:
        """Return the terms reached from a subject by following the predicates in turn."""
        found: list[Term] = [subject]
        for predicate in predicates:
            found = [each for term in found if isinstance(term, Subject) for each in self._said(term, predicate)]
        return found

    def _said(self, subject: Subject, predicate: NamedNode) -> list[Term]:
        return self.of.get(subject, {}).get(predicate, [])

    def nodes(self, subject: Term, *predicates: NamedNode) -> list[NamedNode]:
        """Return the IRIs that are reached likewise."""
        return [each for each in self.all(subject, *predicates) if isinstance(each, NamedNode)]

    def one(self, subject: Term, *predicates: NamedNode) -> Term | None:
        """Return the first term reached, or None."""
        return next(iter(self.all(subject, *predicates)), None)

    def text(self, subject: Term, predicate: NamedNode) -> str:
        found = self.one(subject, predicate)
        return texts.clean(found.value) if isinstance(found, Literal) else ""

    def spoken(self, subject: Term, predicate: NamedNode) -> str:
        """Return the text in the language of the page; else in English, without a language, or in any other."""
        found = {each.language: each.value for each in self.all(subject, predicate) if isinstance(each, Literal)}
        wanted = (languages.language(), languages.ENGLISH, None, *found)
        return texts.clean(next((found[each] for each in wanted if each in found), ""))

    def iri_of(self, subject: Term, predicate: NamedNode) -> str:
        """Return the first IRI reached; empty if there is none."""
        found = self.one(subject, predicate)
        return found.value if isinstance(found, NamedNode) else ""

    def is_a(self, subject: Term, *types: NamedNode) -> bool:
        return not set(types).isdisjoint(self.all(subject, RDF.type))

    # -- values -----------------------------------------------------------------------------------------------------

    def rows(self, subject: Subject, at: Address | None = None, without: Iterable[NamedNode] = ()) -> list[Row]:
        """Return all facts about ``subject`` except its types and ``without``; ``at``: the address of a blank node."""
        hidden = {RDF.type, *without}
        return [
            Row(self.term(predicate), self.values(subject, predicate, at))
            for predicate in self.of.get(subject, {})
            if predicate not in hidden
        ]

    def first_value(self, subject: Subject, predicate: NamedNode) -> Value | None:
        """Return the first value as shown; None if there is none."""
        return next(iter(self.values(subject, predicate)), None)

    def values(self, subject: Subject, predicate: NamedNode, at: Address | None = None) -> list[Value]:
        found = self._said(subject, predicate)
        if len(found) != 1:
            return [self.value(each, predicate, None) for each in found]
        return [self.value(found[0], predicate, self.address(subject, predicate, at))]

    @staticmethod
    def address(subject: Subject, predicate: NamedNode, at: Address | None = None) -> Address | None:
        if isinstance(subject, NamedNode):
            return Address(subject.value, predicate.value)
        return at and at.child(predicate)

    def value(self, term: Term, predicate: NamedNode, at: Address | None) -> Value:
        """Return a term as shown; ``at`` is None for one of several values, which has no address in the graph."""
        if isinstance(term, Literal):
            return self._literal(term, predicate, at)
        if (items := self.outline.list_items(term)) is not None:
            return Items([self.value(each, predicate, None) for each in items])
        if isinstance(term, BlankNode):
            return self._node(term, at)
        if predicate in _STATES:
            return State(texts.local_name(term.value), at)
        if term == LF.unknown:
            return Time(say("unknown"), "", at) if predicate in _TIMES else Number(say("unknown"), "", at)
        return self.link(term)

    def _literal(self, literal: Literal, predicate: NamedNode, at: Address | None) -> Value:
        if literal.datatype in _NUMERIC:
            return self.number(literal, at)
        if literal.datatype == XSD.dateTime:
            text = texts.clean(literal.value)
            return Time(texts.time_text(text), text, at if predicate in _LIVE_TIMES else None)
        return Text(texts.sentence(texts.clean(literal.value)), literal.language or "")

    def _node(self, node: BlankNode, at: Address | None) -> Value:
        if not self.outline.is_nested(node):
            return Link(say("node {label}", label=self.outline.label(node)), f"#{self.outline.label(node)}", "")
        said = self.of.get(node, {})
        others = said.keys() - {RDF.type, VOM.unit, QUDT.unit}
        if others == {VOM.numericalValue} and len(said[VOM.numericalValue]) == 1:
            return self.scalar(node, at)
        if others in ({*_AXES[:3]}, {*_AXES}) and all(len(said[axis]) == 1 for axis in others):
            return self._vector(node, at)
        return NestedFacts(self.rows(node, at), self.types(node))

    def scalar(self, node: Term, at: Address | None, predicate: NamedNode = VOM.numericalValue) -> Number:
        """Return a node that has a number and a unit."""
        value = self.one(node, predicate) or LF.unknown
        return self.number(value, at and at.child(predicate), self.unit_of(node))

    def unit_of(self, node: Term) -> str:
        """Return the IRI of the unit of a node, QUDT's if it has one; empty without any."""
        unit = self.one(node, QUDT.unit) or self.one(node, VOM.unit)
        return unit.value if isinstance(unit, NamedNode) else ""

    def _vector(self, node: BlankNode, at: Address | None) -> Vector:
        said, unit = self.of[node], self.unit_of(node)
        parts = [
            (texts.local_name(axis.value), self.number(said[axis][0], at and at.child(axis)))
            for axis in _AXES
            if axis in said
        ]
        return Vector(parts, texts.unit(unit) if unit else "")

    def number(self, term: Term, at: Address | None, unit: str = "") -> Number:
        """Return a number; ``unit``: its IRI, or empty."""
        shown, name = (texts.unit(unit), quantity.unit_label(unit)) if unit else ("", "")
        if not isinstance(term, Literal):
            return Number(say("unknown"), "", at, shown, name)
        value = _float(term.value)
        if value is None:
            return Number(texts.clean(term.value), texts.clean(term.value), at, shown, name)
        return Number(texts.number(value, name), term.value, at, shown, name, texts.converted(value, name))

    # -- names and links --------------------------------------------------------------------------------------------

    def types(self, subject: Term) -> list[Link]:
        return [self.term(each) for each in self.all(subject, RDF.type) if isinstance(each, NamedNode)]

    def term(self, iri: NamedNode) -> Link:
        """Return a link for a term; terms of this project's vocabulary link to the page that describes them."""
        href = f"{self.root}vocabulary#{iri.value.removeprefix(LF.iri)}" if iri.value.startswith(LF.iri) else iri.value
        return Link(
            texts.term_in_words(iri.value),
            href if _is_web(href) else "",
            iri.value,
            texts.help_of(iri.value),
        )

    def placed_link(self, iri: NamedNode) -> Link:
        """Return a link whose text also names the robot, if it is to something of one: "right_s1 of baxter"."""
        link = self.link(iri)
        of_robot = iri.value.startswith(self.root) and texts.is_of_robot(iri.value, self.root)
        return replace(link, text=texts.thing(iri.value, self.root)) if of_robot else link

    def place_link(self, iri: NamedNode) -> Link:
        """Return a link whose text is the place of its target in the fleet, such as the name of a robot."""
        return Link(texts.place(iri.value, self.root), iri.value, iri.value)

    def link(self, iri: NamedNode) -> Link:
        """Return a link with the title of its target, if the triples contain it."""
        title = texts.readable_title(self.text(iri, DCTERMS.title), self.root) if iri in self.of else ""
        if iri.value.startswith(self.root):
            return Link(title or texts.place(iri.value, self.root), iri.value, iri.value)
        if title:
            return Link(title, iri.value if _is_web(iri.value) else "", iri.value)
        if iri.value.startswith(_VOCABULARIES):
            return self.term(iri)
        return Link(texts.foreign_iri_text(iri.value), iri.value if _is_web(iri.value) else "", iri.value)


def _is_web(iri: str) -> bool:
    return iri.lower().startswith(("http://", "https://"))


def _float(text: str) -> float | None:
    try:
        value = float(text)
    except ValueError:
        return None
    return value if abs(value) < float("inf") else None
