"""Turtle files of shapes/: vocabulary and blueprints, loaded once from their package."""

from collections.abc import Callable, Iterable, Mapping
from functools import cache
from importlib import resources
from importlib.resources.abc import Traversable
from pathlib import Path

from pyoxigraph import BlankNode, Literal, NamedNode, RdfFormat, Triple
from pyoxigraph import parse as parse_rdf

from linked_fleet_gateway.rdf.graph import Graph, Node
from linked_fleet_gateway.rdf.vocabulary import DCTERMS, LF, RDFS, SH

Complete = Callable[[Graph, Node, NamedNode], None]


@cache
def load(name: str) -> dict[Node, list[Triple]]:
    """Return the triples of shapes/NAME by subject, in file order. Blank node labels are unique to the file."""
    return _read((resources.files("linked_fleet_shapes") / name).read_text(encoding="utf-8"), name.removesuffix(".ttl"))


_added: dict[str, tuple[Path, ...]] = {}


def add_to_folder(name: str, files: Iterable[Path]) -> bool:
    """Make ``load_folder`` read these Turtle files too in this process, in place of files added earlier.

    Return True if the set of files has changed.
    """
    before, _added[name] = _added.get(name, ()), tuple(files)
    if _added[name] == before:
        return False
    load_folder.cache_clear()
    return True


def added_to_folder(name: str) -> tuple[Path, ...]:
    """Return the added files."""
    return _added.get(name, ())


@cache
def load_folder(name: str) -> dict[Node, list[Triple]]:
    """Return the triples of all files in the folder shapes/NAME and of the added ones, parsed as one document."""
    own = [each for each in (resources.files("linked_fleet_shapes") / name).iterdir() if each.name.endswith(".ttl")]
    files: list[Traversable] = [*own, *added_to_folder(name)]
    text = "\n".join(each.read_text(encoding="utf-8") for each in sorted(files, key=lambda each: each.name))
    return _read(text, name)


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


def copy(graph: Graph, shapes: Mapping[Node, list[Triple]], start: Node, complete: Complete) -> BlankNode:
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
            graph.add(node, triple.predicate, copy(graph, shapes, value, complete))
        else:
            graph.add(node, triple.predicate, value)  # type: ignore[arg-type]
    for completion in completions:
        complete(graph, node, completion)
    return node


def closure(graph: Graph, start: NamedNode, name: str = "blueprints.ttl") -> None:
    """Add ``start`` and everything in the file that it refers to, so that the shape is complete."""
    by_subject = load(name)
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


def blueprint(graph: Graph, iri: NamedNode, owner: NamedNode, shapes: Iterable[NamedNode]) -> None:
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
        closure(graph, shape)
