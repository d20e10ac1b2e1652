"""Validation of a body against the shape of an action by pySHACL, with violations as sentences."""

from collections.abc import Iterable, Iterator

from rdflib import Graph
from rdflib.term import BNode, Literal, Node, URIRef

from linked_fleet_client.errors import BadAnswer, InvalidInput
from linked_fleet_client.graphs import copy_in_memory
from linked_fleet_client.quantity import unit_label
from linked_fleet_client.vocabulary import RDF, SH, local_name

FOCUS = URIRef("urn:linked-fleet:body")
_TARGETS = (SH.targetNode, SH.targetClass, SH.targetObjectsOf, SH.targetSubjectsOf, SH.target)
# A fetched shape may not run queries or programs here; the server checks those constraints.
_PROGRAMS = (SH.sparql, SH.js, SH.rule)


def validate(body: Graph, shapes: Graph, shape: Node) -> None:
    """Raise InvalidInput with a message for each violation of ``shape`` by the root of ``body``."""
    data = _focused(body)
    messages = list(_messages(data, shapes, _report(data, shapes, shape), 0))
    if messages:
        raise InvalidInput(list(dict.fromkeys(messages)))


def root(body: Graph) -> Node:
    """Return the only subject that is not an object. Raises InvalidInput if there are none or several."""
    objects = set(body.objects())
    roots = [subject for subject in set(body.subjects()) if subject not in objects]
    if len(roots) != 1:
        raise InvalidInput([f"the body has {len(roots)} roots; exactly one subject must not be an object"])
    return roots[0]


def _focused(body: Graph) -> Graph:
    """Return a copy whose root is an IRI that can be a target node. An empty body gets a root too."""
    top = root(body) if len(body) else FOCUS
    return copy_in_memory(
        (FOCUS if subject == top else subject, predicate, value) for subject, predicate, value in body
    )


def _report(data: Graph, shapes: Graph, shape: Node) -> Graph | None:
    """Return the validation report; None if the data conforms."""
    import pyshacl  # slow to import

    targeted = copy_in_memory(triple for triple in shapes if triple[1] not in _TARGETS and triple[1] not in _PROGRAMS)
    targeted.add((shape, RDF.type, SH.NodeShape))
    targeted.add((shape, SH.targetNode, FOCUS))
    try:
        conforms, report, _ = pyshacl.validate(data, shacl_graph=targeted, inference="none", advanced=False)
    except Exception as error:  # a shape from the network can cause many kinds of errors
        raise BadAnswer(f"the shape of the action cannot be validated against: {error}") from error
    if conforms:
        return None
    if not isinstance(report, Graph):
        raise BadAnswer(f"the shape of the action cannot be validated against: {report}")
    return report


def _messages(data: Graph, shapes: Graph, report: Graph | None, depth: int) -> Iterator[str]:
    for result in report.objects(None, SH.result) if report is not None else ():
        assert report is not None
        focus, component = report.value(result, SH.focusNode), report.value(result, SH.sourceConstraintComponent)
        branches = list(_branches(shapes, report.value(result, SH.sourceShape), component))
        chosen = [branch for branch in branches if _chosen(data, shapes, branch, focus)]
        if focus == FOCUS and len(chosen) == 1 and depth == 0:
            yield from _messages(data, shapes, _report(data, shapes, chosen[0]), 1)
            continue
        path, value = report.value(result, SH.resultPath), report.value(result, SH.value)
        yield _said(shapes, report.value(result, SH.sourceShape), component, path, value)


def _branches(shapes: Graph, source: Node | None, component: Node | None) -> Iterator[Node]:
    """Yield the branches of a violated sh:or or sh:xone."""
    predicate = {SH.OrConstraintComponent: SH["or"], SH.XoneConstraintComponent: SH.xone}.get(component)  # type: ignore[call-overload]
    if predicate is not None and source is not None:
        for head in shapes.objects(source, predicate):
            yield from shapes.items(head)


def _chosen(data: Graph, shapes: Graph, branch: Node, focus: Node | None) -> bool:
    """Return True if the data has made the choices of a branch, such as its unit."""
    made = False
    for each in shapes.objects(branch, SH.property):
        allowed = set(_allowed(shapes, each))
        if allowed:
            present = set(data.objects(focus, shapes.value(each, SH.path)))
            if not present & allowed:
                return False
            made = True
    return made


def _allowed(shapes: Graph, shape: Node) -> Iterable[Node]:
    yield from shapes.objects(shape, SH.hasValue)
    for head in shapes.objects(shape, SH["in"]):
        yield from shapes.items(head)


def _said(shapes: Graph, source: Node | None, component: Node | None, path: Node | None, value: Node | None) -> str:
    alike = shapes.subjects(SH.path, path) if path is not None else ()
    name = next((found for each in (source, *alike) if (found := shapes.value(each, SH.name)) is not None), None)
    where = f"{name or local_name(str(path))}: " if path is not None else ""
    given = f"{_word(value)} " if value is not None and not isinstance(value, BNode) else ""
    for term, words in _WORDS.items():
        if component == SH[f"{term[0].upper()}{term[1:]}ConstraintComponent"]:
            bound = shapes.value(source, SH[term]) if source is not None else None
            allowed = ", ".join(dict.fromkeys(map(_word, _allowed(shapes, source)))) if source is not None else ""
            return where + words.format(given=given, bound=_word(bound) if bound is not None else "", allowed=allowed)
    return f"{where}{given}breaks {local_name(str(component)).removesuffix('ConstraintComponent')}"


_WORDS = {
    "minCount": "is missing, or there are fewer than {bound}",
    "maxCount": "there are more than {bound}",
    "minInclusive": "{given}is less than {bound}",
    "maxInclusive": "{given}is more than {bound}",
    "minExclusive": "{given}is not more than {bound}",
    "maxExclusive": "{given}is not less than {bound}",
    "in": "{given}is none of {allowed}",
    "hasValue": "must be {allowed}",
    "datatype": "{given}is no {bound}",
    "pattern": "{given}does not match {bound}",
    "or": "{given}meets none of the alternatives",
    "xone": "{given}does not meet exactly one of the alternatives",
    "node": "{given}does not have the parts that it needs",
    "class": "{given}is not of type {bound}",
    "nodeKind": "{given}is not of kind {bound}",
}


def _word(term: Node) -> str:
    if isinstance(term, Literal):
        return str(term)
    return unit_label(str(term)) or local_name(str(term))
