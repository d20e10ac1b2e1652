"""The view of the vocabulary: an index of its terms by kind, each with its label and comment."""

from collections.abc import Sequence
from dataclasses import dataclass

from pyoxigraph import NamedNode

from linked_fleet_gateway.extensions.pages import languages, texts
from linked_fleet_gateway.extensions.pages.languages import say
from linked_fleet_gateway.extensions.pages.values import Facts, Link
from linked_fleet_gateway.extensions.pages.views import LF, Part
from linked_fleet_rdf.vocabulary import DCTERMS, OWL, PREFIXES, RDF, RDFS, SH

_PLAIN = frozenset({RDFS.Class, RDF.Property, SH.NodeShape, SH.PropertyShape})


@dataclass(frozen=True)
class TermRow:
    """A term. ``name``: as in data; ``kinds``: its classes and superclasses."""

    anchor: str
    name: str
    label: str
    comment: str
    kinds: Sequence[Link]


@dataclass(frozen=True)
class VocabularySection:
    mark: str
    title: str
    terms: Sequence[TermRow]


def vocabulary(facts: Facts, iri: NamedNode) -> Part:
    found: dict[str, list[TermRow]] = {"classes": [], "properties": [], "shapes": [], "values": []}
    for subject in facts.of:
        if isinstance(subject, NamedNode) and subject != iri and not facts.is_a(subject, OWL.Ontology):
            found[_section(facts, subject)].append(_row(facts, subject))
    titles = {
        "classes": say("Classes"),
        "properties": say("Properties"),
        "values": say("Values and states"),
        "shapes": say("Shapes"),
    }
    sections = [VocabularySection(mark, titles[mark], _sorted(found[mark])) for mark in titles if found[mark]]
    title = languages.known(facts.text(iri, DCTERMS.title))
    return Part({"sections": sections}, frozenset(), set(facts.of) - {iri}, title)


def _section(facts: Facts, term: NamedNode) -> str:
    if facts.is_a(term, RDFS.Class):
        return "classes"
    if facts.is_a(term, RDF.Property):
        return "properties"
    return "shapes" if facts.is_a(term, SH.NodeShape, SH.PropertyShape) else "values"


def _row(facts: Facts, term: NamedNode) -> TermRow:
    parents = facts.nodes(term, RDFS.subClassOf)
    kinds = [
        *parents,
        *(each for each in facts.nodes(term, RDF.type) if each not in _PLAIN),
    ]
    return TermRow(
        term.value.removeprefix(LF.iri) if term.value.startswith(LF.iri) else "",
        _prefixed(term),
        facts.spoken(term, RDFS.label) or texts.term_in_words(term.value),
        texts.sentence(facts.spoken(term, RDFS.comment)),
        [facts.term(each) for each in kinds],
    )


def _prefixed(term: NamedNode) -> str:
    for prefix, iri in PREFIXES.items():
        if term.value.startswith(iri):
            return f"{prefix}:{term.value.removeprefix(iri)}"
    return term.value


def _sorted(terms: Sequence[TermRow]) -> list[TermRow]:
    return sorted(terms, key=lambda each: each.name.lower())
