"""Turtle files of shapes/ and of extensions: vocabulary, blueprints and kinds of actions, each loaded once."""

from collections.abc import Callable, Iterable, Mapping
from functools import cache, lru_cache
from importlib import resources
from pathlib import Path

from pyoxigraph import BlankNode, Literal, NamedNode, RdfFormat, Triple
from pyoxigraph import parse as parse_rdf

from linked_fleet_base.contributions import present
from linked_fleet_rdf.graph import Graph, Node
from linked_fleet_rdf.vocabulary import DCTERMS, LF, RDFS, SH

Complete = Callable[[Graph, Node, NamedNode], None]


VOCABULARY, BLUEPRINTS, SUBSCRIPTIONS, ACTIONS = "vocabulary.ttl", "blueprints.ttl", "subscriptions.ttl", "actions"
"""Files of ``linked_fleet_shapes``, and its folder of kinds of actions."""


def added_files(name: str) -> tuple[Path, ...]:
    """Return the files that extensions add to shapes/NAME."""
    return present().files.get(name, ())


def load_turtle(name: str) -> dict[Node, list[Triple]]:
    """Return the triples by subject of the file shapes/NAME, or of all files in that folder, and of the added ones.

    They are parsed as one document, in the order of the files. Blank node labels are unique to the name.
    """
    return _load(name, added_files(name))


@lru_cache(maxsize=64)
def _load(name: str, added: tuple[Path, ...]) -> dict[Node, list[Triple]]:
    found = resources.files("linked_fleet_shapes") / name
    if name.endswith(".ttl"):
        files = [found, *added]
    else:
        own = [each for each in found.iterdir() if each.name.endswith(".ttl")]
        files = sorted([*own, *added], key=lambda each: each.name)
    return _read("\n".join(each.read_text(encoding="utf-8") for each in files), name.removesuffix(".ttl"))


@cache
def load_turtle_file(file: Path) -> dict[Node, list[Triple]]:
    """Return the triples of one Turtle file by subject."""
    return _read(file.read_text(encoding="utf-8"), file.stem)


def _read(text: str, prefix: str) -> dict[Node, list[Triple]]:
    """Parse with ``prefix`` before all blank node labels, so that files can be merged into one document."""
    labels: dict[str, BlankNode] = {}

    def rename(term: object) -> object:
        return (
            labels.setdefault(term.value, BlankNode(f"{prefix}{len(labels)}")) if isinstance(term, BlankNode) else term
        )

    found: dict[Node, list[Triple]] = {}
    for quad in parse_rdf(text, format=RdfFormat.TURTLE):
        triple = Triple(*map(rename, quad.triple))  # type: ignore[arg-type]
        found.setdefault(triple.subject, []).append(triple)  # type: ignore[arg-type]
    return found


def copy_shape(graph: Graph, shapes: Mapping[Node, list[Triple]], start: Node, complete: Complete) -> BlankNode:
    """Copy a shape as nested blank nodes; ``complete`` adds the constraints that each node's ``lf:completedBy``
    names.
    """
    node = graph.blank()
    completions: list[NamedNode] = []
    for triple in shapes[start]:
        value = triple.object
        if triple.predicate == LF.completedBy:
            assert isinstance(value, NamedNode)
            completions.append(value)
        elif isinstance(value, NamedNode | BlankNode) and value in shapes:
            graph.add(node, triple.predicate, copy_shape(graph, shapes, value, complete))
        else:
            graph.add(node, triple.predicate, value)  # type: ignore[arg-type]
    for completion in completions:
        complete(graph, node, completion)
    return node


def add_closure(graph: Graph, start: NamedNode, file: Path | None = None) -> None:
    """Add ``start`` and everything in the file that it refers to, so that the shape is complete.

    Without a file, the shapes are the blueprints.
    """
    by_subject = load_turtle(BLUEPRINTS) if file is None else load_turtle_file(file)
    pending: list[Node] = [start]
    done: set[Node] = set()
    while pending:
        node = pending.pop(0)
        if node in done:
            continue
        done.add(node)
        triples = by_subject.get(node, [])
        for triple in triples:
            graph.add(node, triple.predicate, triple.object)  # type: ignore[arg-type]
        # Blank nodes first, so that a shape is written in one place, before the shapes that it refers to.
        objects: list[Node] = [
            t.object for t in triples if isinstance(t.object, NamedNode | BlankNode) and t.object in by_subject
        ]
        pending = (
            [o for o in objects if isinstance(o, BlankNode)]
            + pending
            + [o for o in objects if not isinstance(o, BlankNode)]
        )


def describe_blueprint(graph: Graph, iri: NamedNode, owner: NamedNode, shapes: Iterable[NamedNode]) -> None:
    """Add a blueprint (paper 5.1, R1.11): the SHACL shape that ``owner`` conforms to, as one document.

    The first shape is that of ``owner`` and has it as target node: with a target class alone, a graph without ``owner``
    would conform. The other shapes describe the bodies that can be sent to it.
    """
    shapes = list(shapes)
    graph.a(iri, LF.Blueprint)
    graph.add(iri, DCTERMS.title, Literal(f"Blueprint of {owner.value}"))
    graph.add(iri, RDFS.seeAlso, owner)
    graph.add(iri, LF.shape, *shapes)
    graph.add(shapes[0], SH.targetNode, owner)
    for shape in shapes:
        add_closure(graph, shape)
