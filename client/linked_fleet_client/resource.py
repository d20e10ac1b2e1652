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
    """A resource.

    ``owner`` is where it was found, in the description ``listing``; both are None if requested by IRI.
    """

    def __init__(self, web: Web, iri: str, owner: Resource | None = None, listing: Document | None = None) -> None:
        self.web, self.iri = web, URIRef(iri)
        self.owner, self._listing = owner, listing
        self._document: Document | None = None

    def read(self) -> Document:
        """Return its present description, revalidated by ETag."""
        self._document = self.web.get(self.iri)
        return self._document

    def learn(self) -> Document:
        """Return its last read description; read it if there is none."""
        return self._document or self.read()

    def introduce(self) -> None:
        """Read its description if no name is known so far."""
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
        """Its title in the description, or its name."""
        titles = self._said(*_TITLES)
        if not titles and not self.known:
            self.read()
            titles = self._said(*_TITLES)
        return titles[0] if titles else self.name

    @property
    def types(self) -> set[Node]:
        """All its stated types, from the document that lists it if that states any."""
        listed = set(self._listing.graph.objects(self.iri, RDF.type)) if self._listing else set()
        return listed or set(self.learn().graph.objects(self.node, RDF.type))

    @property
    def name(self) -> str:
        """The name to show, from what is known without a request."""
        return shown_name(self._said(DCTERMS.identifier), self._said(*_TITLES), local_name(self.iri), self._link())

    @property
    def names(self) -> Sequence[str]:
        """All its names that are known without a request."""
        said = [*self._said(DCTERMS.identifier), self._link(), local_name(self.iri), *self._said(*_TITLES)]
        return [name for name in dict.fromkeys(said) if name]

    def linked(self, *predicates: URIRef) -> list[URIRef]:
        """Return the HTTP IRIs that these predicates link, from the last read description."""
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
        """Return the local name of the predicate by which the owner links it, if that is a specific one."""
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
