"""The fleet: one URL, from which everything else is found by links."""

from __future__ import annotations

from collections.abc import Mapping
from types import TracebackType

from rdflib.term import URIRef

from linked_fleet_client.action import Action
from linked_fleet_client.errors import Unsupported
from linked_fleet_client.invocation import Invocation
from linked_fleet_client.mission import Missions
from linked_fleet_client.retry import PATIENCE_S
from linked_fleet_client.thing import Collection, Observable, Property, Thing, kind_of
from linked_fleet_client.vocabulary import HYBRIT, LF, PROV, RDF
from linked_fleet_client.web import Bearer, Web

__all__ = ["Collection", "Fleet", "Observable", "Property", "Thing", "kind_of"]


class Fleet(Thing):
    """The thing at ``url``, usually a fleet, and the connections to its server.

    ``timeout_s`` bounds each connection attempt and each period without data. ``headers`` are sent with every request,
    also to other servers that links lead to, so they must not hold secrets. ``token`` is the bearer token of the
    caller; it is sent to the server of ``url`` only. ``patience_s`` bounds how long a request is sent again to a busy
    server (``retry.py``).
    """

    def __init__(
        self,
        url: str,
        timeout_s: float = 10.0,
        headers: Mapping[str, str] | None = None,
        token: str = "",
        patience_s: float = PATIENCE_S,
    ) -> None:
        super().__init__(Web(timeout_s, headers or {}, Bearer(token, url) if token else None, patience_s), url)

    def __enter__(self) -> Fleet:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close()

    def close(self) -> None:
        self.web.close()

    @property
    def missions(self) -> Missions:
        """Its missions. Raises Unsupported if it links none."""
        document = self.read()
        for iri in self.linked_iris(LF.missions):
            return Missions(self.web, iri, self, document)
        raise Unsupported(f"{self.iri} links no missions")

    def get(self, iri: str) -> Thing | Property | Action | Invocation:
        """Return the object at an IRI according to its types; a Thing if none of them is known."""
        document = self.web.get(iri)
        types = set(document.graph.objects(document.iri(iri), RDF.type))
        if HYBRIT.Action in types:
            return Action(self.web, iri, self)
        if types & {LF.Invocation, PROV.Activity}:
            return Invocation(self.web, iri, Action)
        return (Property if HYBRIT.Property in types else Thing)(self.web, URIRef(iri), self)
