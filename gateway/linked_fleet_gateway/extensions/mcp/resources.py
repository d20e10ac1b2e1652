"""The resource ``/mcp``: its description, and the messages that it accepts."""

from dataclasses import dataclass
from typing import ClassVar

from pyoxigraph import Literal

from linked_fleet_gateway.identity.rights import Right
from linked_fleet_gateway.rdf.graph import Graph
from linked_fleet_gateway.rdf.serialise import JSON
from linked_fleet_gateway.rdf.vocabulary import DCTERMS, RDFS
from linked_fleet_gateway.resources.branches import FleetBranch, Found, RequestView
from linked_fleet_gateway.resources.resource import Redirect, Resource

PATH, _TITLE = "/mcp", "Model Context Protocol"


@dataclass(frozen=True)
class PostMessage:
    """Send a message, or end a session. ``view`` is that of the caller.

    It changes nothing itself: each operation in a message is a separate request with its own rights and audit entry.
    """

    view: RequestView
    methods: ClassVar[tuple[str, ...]] = ("POST", "DELETE")
    body_types: ClassVar[tuple[str, ...]] = (JSON,)
    needs: ClassVar[tuple[Right, ...]] = (Right.READ, Right.STOP)
    reads: ClassVar[bool] = True


def _resolve(view: RequestView, rest: list[str]) -> Found:
    if rest:
        return Redirect(PATH) if rest == [""] else None

    def describe(graph: Graph) -> None:
        graph.add(view.iri(PATH), DCTERMS.title, Literal(_TITLE))
        graph.add(view.iri(PATH), RDFS.comment, Literal("Clients of the protocol connect here, by streamable HTTP."))
        graph.add(view.iri(PATH), RDFS.seeAlso, view.iri("/"))

    return Resource(PATH, _TITLE, describe, affords=PostMessage(view), remote=PostMessage(view), followed=False)


BRANCH = FleetBranch(PATH[1:], None, _resolve)
