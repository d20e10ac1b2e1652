"""The resource ``/missions/builder``: the page on which people build missions. Ids of missions are UUIDs."""

from dataclasses import replace

from linked_fleet_gateway.api import (
    DCTERMS,
    RDFS,
    FleetBranch,
    Found,
    Graph,
    Literal,
    RequestView,
    Resource,
    blueprint_of,
)
from linked_fleet_gateway.extensions.missions.terms import LF
from linked_fleet_rdf.vocabulary import HYBRIT

SEGMENT = "builder"
_BLUEPRINT = "blueprint"
_TITLE = "Mission builder"


def with_builder(missions: FleetBranch) -> FleetBranch:
    """Return the branch of missions with the builder below it."""

    def resolve(view: RequestView, rest: list[str]) -> Found:
        if rest[:1] != [SEGMENT]:
            return missions.resolve(view, rest)
        found = _builder(view, f"/{missions.segment}")
        if rest[1:] == [_BLUEPRINT]:
            return blueprint_of(found, view.base, (LF.MissionBuilderShape,))
        return None if rest[1:] else found

    return replace(missions, resolve=resolve)


def _builder(view: RequestView, missions: str) -> Resource:
    path = f"{missions}/{SEGMENT}"
    blueprint = f"{path}/{_BLUEPRINT}"

    def describe(graph: Graph) -> None:
        iri = view.iri(path)
        graph.a(iri, LF.MissionBuilder)
        graph.add(iri, DCTERMS.title, Literal(_TITLE))
        graph.add(iri, RDFS.seeAlso, view.iri(missions))
        graph.add(iri, HYBRIT.blueprint, LF.MissionBuilderShape, view.iri(blueprint))

    return Resource(path, _TITLE, describe, own_paths=(blueprint,), publishes_changes=False)
