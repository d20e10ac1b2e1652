"""Kinds of actions, read once from one Turtle file each in shapes/linked_fleet_shapes/actions."""

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from pyoxigraph import Literal, NamedNode

from linked_fleet_gateway.rdf.shapes import ACTIONS, add, load
from linked_fleet_gateway.rdf.vocabulary import DCTERMS, HTTP, HYBRIT, LF, RDF, RDFS


@dataclass(frozen=True)
class Definition:
    """A kind of action.

    ``offered_by`` are classes of things, ``offered_if`` conditions on the robot, ``capability`` is required of the
    agent.
    """

    iri: NamedNode
    segment: str
    title: str
    comment: str
    offered_by: frozenset[NamedNode]
    offered_if: tuple[NamedNode, ...]
    capability: str
    methods: tuple[NamedNode, ...]
    consumes: NamedNode | None
    produces: NamedNode


def add_kinds(files: Iterable[Path]) -> None:
    """Add the kinds of actions in these Turtle files to this process, in place of files added earlier."""
    if add(ACTIONS, files):
        definitions.cache_clear()


@cache
def definitions() -> tuple[Definition, ...]:
    """Return all kinds, in the order of their files."""
    shapes = load(ACTIONS)
    kinds = [node for node, triples in shapes.items() if any(t.object == LF.ActionKind for t in triples)]
    return tuple(_read(kind) for kind in kinds if isinstance(kind, NamedNode))


def _read(kind: NamedNode) -> Definition:
    said: dict[NamedNode, list[NamedNode | Literal]] = {}
    for triple in load(ACTIONS)[kind]:
        said.setdefault(triple.predicate, []).append(triple.object)  # type: ignore[arg-type]

    def text(predicate: NamedNode) -> str:
        return said[predicate][0].value if predicate in said else ""

    def named(predicate: NamedNode) -> tuple[NamedNode, ...]:
        return tuple(each for each in said.get(predicate, ()) if isinstance(each, NamedNode))

    assert RDF.type in said
    return Definition(
        iri=kind,
        segment=text(LF.segment),
        title=text(DCTERMS.title),
        comment=text(RDFS.comment),
        offered_by=frozenset(named(LF.offeredBy)),
        offered_if=named(LF.offeredIf),
        capability=text(LF.capability),
        methods=named(HTTP.mthd),
        consumes=next(iter(named(HYBRIT.consumes)), None),
        produces=named(HYBRIT.produces)[0],
    )
