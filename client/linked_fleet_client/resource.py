"""Base class of resources: an IRI, a description, and names."""

from __future__ import annotations

from collections.abc import Sequence

from rdflib.term import Literal, Node, URIRef

from linked_fleet_client.naming import shown_name
from linked_fleet_client.vocabulary import DCTERMS, HYBRIT, RDF, RDFS, is_web, local_name
from linked_fleet_client.web import Document, Web

_TITLES = (DCTERMS.title, RDFS.label)
_LINKS = frozenset({HYBRIT.property, HYBRIT.action, DCTERMS.hasPart, DCTERMS.isPartOf, RDFS.seeAlso})


class Resource:
    """``owner`` is where it was found, ``listing`` the description in which; None for what was asked for by IRI."""

    def __init__(self, web: Web, iri: str, owner: Resource | None = None, listing: Document | None = None) -> None:
        self.web, self.iri = web, URIRef(iri)
        self.owner, self._listing = owner, listing
        self._document: Document | None = None

    def read(self) -> Document:
        """Its present description, revalidated by ETag."""
        self._document = self.web.get(self.iri)
        return self._document

    def learn(self) -> Document:
        """Its description as it was last read; read now if it never was."""
        return self._document or self.read()

    def introduce(self) -> None:
        """Have it read its description if nobody has said a name of it so far."""
        if not self._said(DCTERMS.identifier, *_TITLES) and not self._link():
            self.learn()

    @property
    def known(self) -> bool:
        """True if its own description has been read."""
        return self._document is not None

    @property
    def node(self) -> URIRef:
        """The subject of its description: its IRI, unless a redirect led to another."""
        return self.learn().iri(self.iri)

    @property
    def title(self) -> str:
        """Its title in the description, or the name that it goes by."""
        titles = self._said(*_TITLES)
        if not titles and not self.known:
            self.read()
            titles = self._said(*_TITLES)
        return titles[0] if titles else self.name

    @property
    def types(self) -> set[Node]:
        """All its types, as stated: from where it is listed if they are stated there."""
        listed = set(self._listing.graph.objects(self.iri, RDF.type)) if self._listing else set()
        return listed or set(self.learn().graph.objects(self.node, RDF.type))

    @property
    def name(self) -> str:
        """The name to show, from what is known without asking."""
        return shown_name(self._said(DCTERMS.identifier), self._said(*_TITLES), local_name(self.iri), self._link())

    @property
    def names(self) -> Sequence[str]:
        """All that it answers to, by what is known without asking."""
        said = [*self._said(DCTERMS.identifier), self._link(), local_name(self.iri), *self._said(*_TITLES)]
        return [name for name in dict.fromkeys(said) if name]

    def linked(self, *predicates: URIRef) -> list[URIRef]:
        """Return what it links by these predicates, on the Web; as last read."""
        graph = self.learn().graph
        found = [each for predicate in predicates for each in graph.objects(self.node, predicate)]
        return [URIRef(str(each)) for each in dict.fromkeys(found) if is_web(each)]

    def _said(self, *predicates: URIRef) -> list[str]:
        found: list[Node] = []
        for document in (self._document, self._listing):
            if document is not None:
                node = document.iri(self.iri) if document is self._document else self.iri
                found += [
                    each
                    for predicate in predicates
                    for each in sorted(document.graph.objects(node, predicate), key=str)
                ]
        return list(dict.fromkeys(str(each) for each in found if isinstance(each, Literal)))

    def _link(self) -> str:
        """The predicate by which the owner links it, where that says more than what kind of thing it is."""
        if self.owner is None or self._listing is None:
            return ""
        graph = self._listing.graph
        subject = self._listing.iri(self.owner.iri)
        types = set(graph.objects(self.iri, RDF.type))
        if not (self.iri in graph.objects(subject, HYBRIT.property) or HYBRIT.Property in types):
            return ""
        predicates = sorted(str(each) for each in graph.predicates(subject, self.iri) if each not in _LINKS)
        return local_name(predicates[0]) if predicates else ""

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {self.iri}>"
