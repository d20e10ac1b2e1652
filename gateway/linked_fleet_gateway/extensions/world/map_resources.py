"""The map of the floor at ``/world/map``: its description, and its image, settings and picture as files. Pure."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import ClassVar

from pyoxigraph import Literal, NamedNode

from linked_fleet_gateway.api import Found, Graph, RequestView, Resource, Right, Source, blueprint_of, integer
from linked_fleet_gateway.extensions.world.floor_map import ID, FloorMap, Maps, MapSettings
from linked_fleet_gateway.extensions.world.map_yaml import write_yaml
from linked_fleet_gateway.extensions.world.placement import LF, WORLD, describe_pose
from linked_fleet_gateway.extensions.world.relocalise import flat_pose
from linked_fleet_gateway.serving import Rendition
from linked_fleet_rdf.graph import METRE, UNITLESS, timestamp
from linked_fleet_rdf.vocabulary import DCTERMS, HYBRIT, LDP, PROV, RDFS

MAP = f"{WORLD}/map"
FORM, PGM, YAML, PNG = "multipart/form-data", "image/x-portable-graymap", "application/yaml", "image/png"
PGM_FILE, YAML_FILE, PNG_FILE = "map.pgm", "map.yaml", "map.png"
NONE_YET, UNREADABLE = "No map of the floor", "A map of the floor that cannot be read"
_NO_RDF = (LDP.Resource, LDP.NonRDFSource)


@dataclass(frozen=True)
class PutMap:
    """Replace the map of the floor by the files of a form, or remove it.

    There is no POST: a page of another site could send a form by POST, and by no other method.
    """

    methods: ClassVar[tuple[str, ...]] = ("PUT", "DELETE")
    body_types: ClassVar[tuple[str, ...]] = (FORM,)
    reads: ClassVar[bool] = False
    needs: ClassVar[tuple[Right, ...]] = (Right.ADMIN,)


@dataclass(frozen=True)
class MapImage:
    """The image of a map, which takes long to be unpacked."""

    map: FloorMap


def resolve_map(view: RequestView, rest: list[str], maps: Maps, readable: Callable[[], bool]) -> Found:
    """Return the resource at ``rest``, the segments below ``/world/map``; not ``readable``: its record is damaged."""
    whole = _map(view, maps, lambda: NONE_YET if readable() else UNREADABLE)
    if not rest:
        return whole
    if rest == ["blueprint"]:
        return blueprint_of(whole, view.base, (LF.OccupancyMapShape,))
    found = maps.get(ID)
    return None if found is None or len(rest) != 1 else _file(rest[0], found)


def _map(view: RequestView, maps: Maps, without: Callable[[], str]) -> Resource:
    found = maps.get(ID)
    files = () if found is None else (PGM_FILE, YAML_FILE, PNG_FILE)
    return Resource(
        MAP,
        without() if found is None else found.title,
        lambda graph: describe_map(graph, view.base, maps.get(ID), without()),
        source=Source(lambda: facts(maps.get(ID)) or (without(),)),
        own_paths=tuple(f"{MAP}/{each}" for each in ("blueprint", *files)),
        affords=PutMap(),
    )


def _file(name: str, found: FloorMap) -> Resource | None:
    path, title = f"{MAP}/{name}", f"{name} of {found.title}"
    if name == PGM_FILE:
        return Resource(path, title, None, _NO_RDF, remote=MapImage(found), publishes_changes=False)
    if name == YAML_FILE:
        yaml = partial(write_yaml, found.settings, PGM_FILE)
        return Resource(
            path, title, None, _NO_RDF, documents={YAML: Rendition(yaml, YAML_FILE)}, publishes_changes=False
        )
    if name == PNG_FILE:
        picture = Rendition(lambda: found.picture, PNG_FILE)
        return Resource(path, title, None, _NO_RDF, documents={PNG: picture}, publishes_changes=False)
    return None


def facts(found: FloorMap | None) -> tuple[object, ...]:
    """Return what determines the version of a map: all but the content that its digest stands for."""
    if found is None:
        return ()
    return found.title, found.settings, found.height_m, found.sha256, found.created_ns, found.client


def describe_map(graph: Graph, base: str, found: FloorMap | None, without: str = NONE_YET) -> None:
    """Describe the map; ``without`` is its title if there is none."""
    iri = NamedNode(base + MAP)
    graph.a(iri, LF.OccupancyMap)
    graph.add(iri, DCTERMS.title, Literal(without if found is None else found.title))
    graph.add(iri, RDFS.seeAlso, NamedNode(base + WORLD))
    graph.add(iri, HYBRIT.blueprint, LF.OccupancyMapShape, NamedNode(iri.value + "/blueprint"))
    graph.add(iri, LF.inFrame, NamedNode(base + WORLD))
    graph.scalar(iri, LF.resolution, None if found is None else found.settings.resolution, METRE)
    describe_pose(graph, iri, None if found is None else flat_pose(*found.settings.origin))
    if found is not None:
        _describe_content(graph, iri, found)
        _describe_origin(graph, iri, found)


def _describe_content(graph: Graph, iri: NamedNode, found: FloorMap) -> None:
    settings: MapSettings = found.settings
    graph.vector(iri, LF.size, (*found.size_m, found.height_m), METRE)
    for predicate, number in (
        (LF.columns, found.columns), (LF.rows, found.rows), (LF.occupiedCells, found.occupied),
        (LF.freeCells, found.free), (LF.unknownCells, found.unknown), (LF.obstacleBoxes, found.box_count),
    ):  # fmt: skip
        graph.add(iri, predicate, integer(number))
    graph.scalar(iri, LF.occupiedThreshold, settings.occupied_thresh, UNITLESS)
    graph.scalar(iri, LF.freeThreshold, settings.free_thresh, UNITLESS)
    graph.add(iri, LF.mapMode, Literal(settings.mode))
    graph.add(iri, LF.mapImage, NamedNode(f"{iri.value}/{PGM_FILE}"))
    graph.add(iri, LF.mapSettings, NamedNode(f"{iri.value}/{YAML_FILE}"))
    graph.add(iri, LF.mapPicture, NamedNode(f"{iri.value}/{PNG_FILE}"))
    graph.add(iri, LF.sha256, Literal(found.sha256))


def _describe_origin(graph: Graph, iri: NamedNode, found: FloorMap) -> None:
    """Describe by whom it was uploaded, and when."""
    graph.add(iri, DCTERMS.created, timestamp(found.created_ns))
    client = graph.blank(PROV.Agent)
    graph.add(iri, PROV.wasAssociatedWith, client)
    graph.add(client, DCTERMS.title, Literal(found.client))
