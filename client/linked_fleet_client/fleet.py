"""The way in: one URL, and everything else by links."""

from collections.abc import Mapping
from types import TracebackType

from rdflib.term import URIRef

from linked_fleet_client.action import Action
from linked_fleet_client.invocation import Invocation
from linked_fleet_client.thing import Property, Thing
from linked_fleet_client.vocabulary import HYBRIT, LF, PROV, RDF
from linked_fleet_client.web import Bearer, Web


class Fleet(Thing):
    """The thing at ``url``, which need not be a fleet, and the connections to its server.

    ``timeout_s`` bounds each connecting and each silence of the server. ``headers`` go with every request, wherever
    links lead: nothing secret belongs in them unless all that the fleet links may know it. ``token`` says who one is;
    it goes to the server of ``url`` and to no other.
    """

    def __init__(
        self, url: str, timeout_s: float = 10.0, headers: Mapping[str, str] | None = None, token: str = ""
    ) -> None:
        super().__init__(Web(timeout_s, headers or {}, Bearer(token, url) if token else None), url)

    def __enter__(self) -> "Fleet":
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close()

    def close(self) -> None:
        self.web.close()

    def get(self, iri: str) -> Thing | Property | Action | Invocation:
        """Return the object at an IRI, by the types that it states; a thing if it states none that is known."""
        document = self.web.get(iri)
        types = set(document.graph.objects(document.iri(iri), RDF.type))
        if HYBRIT.Action in types:
            return Action(self.web, iri, self)
        if types & {LF.Invocation, PROV.Activity}:
            return Invocation(self.web, iri, Action)
        return (Property if HYBRIT.Property in types else Thing)(self.web, URIRef(iri), self)
