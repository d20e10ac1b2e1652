"""What the gateway itself has at the root: vocabulary, JSON-LD context, and the scripts and styles of its pages."""

import json

from gateway.face.assets import assets
from gateway.graph.build import Graph
from gateway.graph.resource import Resource
from gateway.graph.shapes import load
from gateway.graph.subscription import describe_request_shape
from gateway.graph.vocab import LDP, PREFIXES


def vocabulary() -> Resource:
    return Resource("/vocabulary", "Vocabulary", _vocabulary)


def context() -> Resource:
    content = json.dumps({"@context": PREFIXES}, indent=1).encode()
    document = {"application/ld+json": lambda: content}
    return Resource("/context", "JSON-LD context", None, (LDP.Resource,), documents=document)


def asset(rest: list[str]) -> Resource | None:
    """A script or style of the pages."""
    found = assets().files.get("/".join(rest))
    if found is None:
        return None
    media_type, content = found
    path = "/assets/" + "/".join(rest)
    return Resource(path, rest[-1], None, (LDP.Resource,), documents={media_type: lambda: content}, immutable=True)


def _vocabulary(graph: Graph) -> None:
    for name in ("vocabulary.ttl", "rules.ttl"):
        for triples in load(name).values():
            for triple in triples:
                graph.add(triple.subject, triple.predicate, triple.object)  # type: ignore[arg-type]
    describe_request_shape(graph)
