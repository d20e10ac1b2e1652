"""The part of a container that a client prefers (LDP 7.2): the container itself, its members, or both."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial

from pyoxigraph import NamedNode

from linked_fleet_gateway.http.fields import field
from linked_fleet_gateway.http.prefer import parse_prefer
from linked_fleet_gateway.http.request import Request
from linked_fleet_gateway.rdf.graph import Graph
from linked_fleet_gateway.rdf.vocabulary import LDP
from linked_fleet_gateway.resources.action_body import own_part
from linked_fleet_gateway.resources.resource import CONTAINER, Resource, complete

_MINIMAL, _CONTAINMENT = LDP.PreferMinimalContainer.value, LDP.PreferContainment.value
# A basic container has no membership triples other than containment, so omitting them changes nothing.
_PARTS = frozenset({_MINIMAL, _CONTAINMENT, LDP.PreferMembership.value})


_AT_ONCE = 256
"""Triples that are looked at in one step."""


@dataclass(frozen=True)
class Part:
    """The shown triples: those about the container itself, and ``ldp:contains`` with descriptions of members."""

    minimal: bool
    containment: bool


def preferred_part(request: Request, resource: Resource) -> Part | None:
    """Return the preferred part; None for all, without a known preference or with a contradictory one."""
    if resource.interaction != CONTAINER or request.method not in ("GET", "HEAD"):
        return None
    prefer = parse_prefer(field(request, "prefer"))
    include, omit = prefer.include & _PARTS, prefer.omit & _PARTS
    if prefer.return_ != "representation" or not (include or omit) or include & omit:
        return None
    wants = _CONTAINMENT in include or _MINIMAL not in include
    part = Part(_MINIMAL not in omit, wants and _CONTAINMENT not in omit)
    return part if part.minimal or part.containment else None


def shown_part(resource: Resource, part: Part, base: str) -> Resource:
    """Return the container with this part of its description, which has an entity tag of its own."""
    assert resource.describe is not None
    steps = partial(_steps, resource, part, NamedNode(base + resource.path))
    return replace(resource, describe=lambda graph: complete(steps(graph)), steps=steps)


def _steps(resource: Resource, part: Part, iri: NamedNode, graph: Graph) -> Iterator[None]:
    assert resource.describe is not None
    whole = Graph()
    if resource.steps is None:
        resource.describe(whole)
    else:
        yield from resource.steps(whole)
    about = set(own_part(whole.triples, iri))
    for number, triple in enumerate(whole.triples):
        if number % _AT_ONCE == 0:
            yield
        minimal = triple in about and (triple.subject != iri or triple.predicate != LDP.contains)
        if part.minimal if minimal else part.containment:
            graph.add(triple.subject, triple.predicate, triple.object)  # type: ignore[arg-type]
