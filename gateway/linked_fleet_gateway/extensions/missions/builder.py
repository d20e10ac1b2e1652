"""The resource ``/missions/builder``: the page on which people build missions. Ids of missions are UUIDs."""

from dataclasses import replace

from linked_fleet_gateway.api import DCTERMS, RDFS, FleetBranch, Found, Graph, Literal, RequestView, Resource
from linked_fleet_gateway.extensions.missions.terms import LF

SEGMENT = "builder"
_TITLE = "Mission builder"


def with_builder(missions: FleetBranch) -> FleetBranch:
    """Return the branch of missions with the builder below it."""

    def resolve(view: RequestView, rest: list[str]) -> Found:
        return _builder(view, f"/{missions.segment}") if rest == [SEGMENT] else missions.resolve(view, rest)

    return replace(missions, resolve=resolve)


def _builder(view: RequestView, missions: str) -> Resource:
    path = f"{missions}/{SEGMENT}"

    def describe(graph: Graph) -> None:
        iri = view.iri(path)
        graph.a(iri, LF.MissionBuilder)
        graph.add(iri, DCTERMS.title, Literal(_TITLE))
        graph.add(iri, RDFS.seeAlso, view.iri(missions))

    return Resource(path, _TITLE, describe, publishes_changes=False)
