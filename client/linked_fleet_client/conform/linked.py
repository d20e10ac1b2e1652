"""R1.1 to R1.12: Linked Robotic Things."""

import asyncio
import re
from collections import Counter
from collections.abc import Iterator

import rdflib
from rdflib import RDF, BNode, Literal, URIRef
from rdflib.term import Node

from linked_fleet_client.conform.blueprint import Case, Conformance, validate
from linked_fleet_client.conform.rdf import DCTERMS, LDP, RDFS, TURTLE, link_targets, types
from linked_fleet_client.conform.subject import Subject
from linked_fleet_client.conform.verdict import Verdict, cant_tell, failed, inapplicable, passed, verdict_on
from linked_fleet_client.conform.walk import Page, plain

_MOST_VALIDATED = 40
_VALIDATION_S = 60.0
_UNREADABLE = "no RDF representation of a thing can be read"
_CONTAINERS = frozenset({LDP.Container, LDP.BasicContainer, LDP.DirectContainer, LDP.IndirectContainer})
_STANDARD = (str(RDFS), str(DCTERMS), str(LDP))
_KNOWN = (
    *_STANDARD, str(RDF), "http://www.w3.org/", "http://purl.org/", "http://qudt.org/", "http://xmlns.com/foaf/",
    "http://vocab.arvida.de/", "http://ros.org/", "http://schema.org/", "https://schema.org/", "http://purl.oclc.org/",
)  # fmt: skip
_COPIED = {
    **dict.fromkeys(("label", "comment", "seeAlso", "isDefinedBy", "subClassOf"), "rdfs"),
    **dict.fromkeys(("title", "identifier", "isPartOf", "hasPart", "created", "modified", "creator"), "dcterms"),
    **dict.fromkeys(("contains", "Container", "BasicContainer", "member"), "ldp"),
}


async def r1_1(subject: Subject) -> Verdict:
    """A Linked Robotic Thing is a Robotic Thing."""
    things = subject.walk.things()
    typed = sum(subject.walk.model.RoboticThing in types(page.graph, page.node) for page in things)
    return cant_tell(f"a definition, decided by R0.1 to R0.17; {typed} of {len(things)} things say hybrit:RoboticThing")


async def r1_2(subject: Subject) -> Verdict:
    """A RT server must respond with a Turtle representation of the requested Linked Robotic Thing, unless HTTP
    content-negotiation requires a different outcome.
    """
    things, declared = subject.walk.things(), subject.walk.typed_nodes()
    known = {page.url for page in things}
    problems = [page.fault for page in subject.walk if page.url not in known and _may_be_a_thing(page, declared)]
    for page in things:
        if page.fault:
            problems.append(page.fault)
        elif page.answer.media_type != TURTLE:
            problems.append(
                f"GET {page.url}: is {page.answer.media_type} without an Accept field, and Turtle only if "
                "Accept asks for it"
            )
        elif not len(page.graph):
            problems.append(f"GET {page.url}: the Turtle says nothing")
    return verdict_on(problems, f"Turtle, unasked, of {_things(subject)}")


def _may_be_a_thing(page: Page, declared: set[Node]) -> bool:
    """Return True for an unreadable page that another one calls a thing, or that is Turtle."""
    called = page.node in declared or URIRef(page.asked) in declared
    return bool(page.fault) and page.answer.successful and (called or page.answer.media_type == TURTLE)


def _things(subject: Subject) -> str:
    things = subject.walk.things()
    return f"{len(things)} things such as {things[-1].url}"


def _readable(subject: Subject) -> list[Page]:
    return [page for page in subject.walk.things() if not page.fault]


async def r1_3(subject: Subject) -> Verdict:
    """Linked Robotic Things must have at least one rdf:type set explicitly in their RDF representations."""
    readable = _readable(subject)
    if not readable:
        return cant_tell(_UNREADABLE)
    return verdict_on(
        [f"GET {page.url}: no rdf:type of {page.node}" for page in readable if not types(page.graph, page.node)],
        f"rdf:type on each of {_things(subject)}",
    )


async def r1_4(subject: Subject) -> Verdict:
    """In the absence of special knowledge of the application or domain, clients must assume that any RDF
    representation of a Linked Robotic Thing can have multiple rdf:type triples with different objects.
    """
    several = sum(len(types(page.graph, page.node)) > 1 for page in subject.walk.things())
    return inapplicable(f"is a requirement of clients, not of servers; {several} things have several types")


async def r1_5(subject: Subject) -> Verdict:
    """RDF representations of Linked Robotic Things should reuse existing vocabularies instead of creating their own
    duplicate vocabulary terms. Standard vocabularies such as RDF and RDF Schema, Dublin Core or Linked Data Platform,
    should be used whenever possible.
    """
    terms = {str(term) for page in subject.walk.things() for term in _terms(page.graph)}
    if not terms:
        return cant_tell(_UNREADABLE)
    if not any(term.startswith(_STANDARD) for term in terms):
        return failed(f"{_things(subject)}: no term of RDF Schema, Dublin Core or LDP among {len(terms)}")
    model = str(subject.walk.model)
    own = sorted(term for term in terms if not term.startswith((*_KNOWN, model)))
    copies = [f"{term} duplicates {_COPIED[_local(term)]}:{_local(term)}" for term in own if _local(term) in _COPIED]
    if own and not copies:
        spaces = Counter(term.removesuffix(_local(term)) for term in own).most_common(3)
        found = ", ".join(f"{count} of {space}" for space, count in spaces)
        return cant_tell(f"{len(terms) - len(own)} terms are reused; whether others duplicate one: {found}")
    return verdict_on(copies, f"all {len(terms)} terms are of known vocabularies")


def _terms(graph: rdflib.Graph) -> Iterator[object]:
    yield from graph.predicates()
    yield from (kind for kind in graph.objects(None, RDF.type) if isinstance(kind, URIRef))


def _local(term: str) -> str:
    return re.split(r"[#/]", term)[-1]


async def r1_6(subject: Subject) -> Verdict:
    """Clients should always assume that different Linked Robotic Things of the same type may not all have the same set
    of predicates in their RDF representations, and the set of predicates that are used in the state of any one Linked
    Robotic Thing is not limited to any pre-defined set.
    """
    sets = {frozenset(page.graph.predicates(page.node)) for page in subject.walk.things()}
    return inapplicable(f"is a requirement of clients, not of servers; things have {len(sets)} sets of predicates")


async def r1_7(subject: Subject) -> Verdict:
    """A RT server must not require clients to implement inferencing in order to recognize the subset of content
    defined by a Linked Robotic Thing's RDF representation. Other specifications built on top of this may require
    clients to implement inferencing.
    """
    problems, seen = [], 0
    for page in subject.walk.pages_in_role("subscriptions"):
        stated = types(page.graph, page.node)
        seen += LDP.Container in stated
        if stated & _CONTAINERS and LDP.Container not in stated:
            problems.append(f"GET {page.url}: only by inference an ldp:Container")
    for thing in subject.walk.things():
        problems += [f"GET {thing.url}: {problem}" for problem in _unstated(subject, thing)]
    if not problems and not seen:
        return cant_tell("no term was found whose meaning is known beforehand")
    return verdict_on(problems, f"{_things(subject)} link all that they type; {seen} containers state ldp:Container")


def _unstated(subject: Subject, thing: Page) -> Iterator[str]:
    """Yield values typed as a property or an action of a thing but not linked as one."""
    model = subject.walk.model
    for role, kind in (("property", model.Property), ("action", model.Action)):
        linked = set(thing.graph.objects(thing.node, model[role]))
        for predicate, value in thing.graph.predicate_objects(thing.node):
            if value not in linked and kind in types(thing.graph, value):
                yield f"{value} of {predicate} is a hybrit:{role} only by inference"


async def r1_8(subject: Subject) -> Verdict:
    """A Linked Robotic Thing must expose a Subscriptions container resource using a RDF triple whose subject is the
    Linked Robotic Thing's URI, whose predicate is hybrit:subscriptions and whose object is the URI for the
    Subscriptions container resource.
    """
    problems, things = [], _readable(subject)
    if not things:
        return cant_tell(_UNREADABLE)
    for thing in things:
        nodes = subject.walk.objects_in_role(thing, "subscriptions")
        urls = [plain(node) for node in nodes if isinstance(node, URIRef) and subject.web.same_origin(plain(node))]
        if not nodes:
            problems.append(f"GET {thing.url}: no hybrit:subscriptions")
        elif not urls:
            problems.append(f"GET {thing.url}: hybrit:subscriptions leads to no URI of this server, but to {nodes[0]}")
        elif fault := await _no_container(subject, urls[0]):
            problems.append(fault)
    return verdict_on(problems, f"an LDP container for each of {_things(subject)}")


async def _no_container(subject: Subject, url: str) -> str:
    page = await subject.page(url)
    if not page.answer.successful:
        return str(page.answer)
    stated = types(page.graph, page.node) | {URIRef(target) for target in link_targets(page.answer, "type")}
    return "" if stated & _CONTAINERS else f"GET {url}: is no LDP container, neither in RDF nor in Link"


async def r1_9(subject: Subject) -> Verdict:
    """A Linked Robotic Thing should expose a collection of Property resources using RDF triples whose subject is the
    Linked Robotic Thing's URI, whose predicate is hybrit:property and whose objects are the URIs for the Property
    resources.
    """
    return _collection(subject, "property")


async def r1_10(subject: Subject) -> Verdict:
    """A Linked Robotic Thing should expose a collection of Action resources using RDF triples whose subject is the
    Linked Robotic Thing's URI, whose predicate is hybrit:action and whose objects are the URIs for the Action
    resources.
    """
    return _collection(subject, "action")


def _collection(subject: Subject, role: str) -> Verdict:
    """Check a collection. A thing may lack one because it is empty, which is not visible unless all things lack it."""
    things = _readable(subject)
    if not things:
        return cant_tell(_UNREADABLE)
    having = [page for page in things if subject.walk.objects_in_role(page, role)]
    if not having:
        return failed(f"no hybrit:{role} on any of {_things(subject)}")
    pages = subject.walk.pages_in_role(role)
    problems = [
        f"GET {page.url}: hybrit:{role} is not a URI"
        for page in having
        if any(isinstance(node, BNode | Literal) for node in subject.walk.objects_in_role(page, role))
    ]
    problems += [f"{page.fault}, though a hybrit:{role}" for page in pages if page.fault]
    return verdict_on(
        problems, f"{len(having)} of {len(things)} things have hybrit:{role}; {len(pages)} of them were read"
    )


async def r1_11(subject: Subject) -> Verdict:
    """A Linked Robotic Thing may expose a Blueprint resource using an RDF triple whose subject is the Linked Robotic
    Thing's URI, whose predicate is hybrit:blueprint and whose object is the URI for the Blueprint resource.
    """
    having = [page for page in subject.walk if subject.walk.objects_in_role(page, "blueprint")]
    if not having:
        return inapplicable(f"no hybrit:blueprint on {subject.extent()}")
    problems, cases = await _cases(subject, having)
    if not cases and not problems:
        return cant_tell(f"{len(having)} blueprints are on other servers, which are not tested")
    results = await asyncio.to_thread(validate, cases, min(_VALIDATION_S, subject.web.left_s))
    told = list(zip(cases, results, strict=True))
    problems += [f"GET {case.url}: does not conform to {case.blueprint}: {_why(result)}" for case, result in told
                 if result.conforms is False]  # fmt: skip
    conforming = sum(bool(result.conforms) for result in results)
    if not conforming and not problems:
        return cant_tell(f"GET {cases[0].url}: {_why(results[0])}")
    return verdict_on(problems, f"{conforming} of {len(cases)} resources tried conform to their blueprints (SHACL)")


def _why(result: Conformance) -> str:
    return result.reason or "no reason given"


async def _cases(subject: Subject, having: list[Page]) -> tuple[list[str], list[Case]]:
    """Return problems of fetching, and the cases to validate: a bounded number spread evenly over the resources."""
    problems, cases = [], []
    for page in having[:: -(-len(having) // _MOST_VALIDATED)]:
        for node in subject.walk.objects_in_role(page, "blueprint"):
            if not subject.web.same_origin(str(node)):
                continue
            blueprint = await subject.page(plain(node))
            if blueprint.fault:
                problems.append(f"{blueprint.fault}, though a blueprint")
                continue
            data, shapes = page.turtle_graph, blueprint.turtle_graph
            cases.append(Case(data.url, str(page.node), data.body, shapes.url, shapes.body, str(node)))
    return problems, cases


async def r1_12(subject: Subject) -> Verdict:
    """A Linked Robotic Thing may provide additional meta data to precisely describe the meaning of individual building
    blocks of a model in a machine-understandable way.
    """
    things = subject.walk.things()
    spoken = [
        page for page in things for predicate in page.graph.predicates(page.node)
        if str(predicate).startswith((str(RDFS), str(DCTERMS), "http://www.w3.org/ns/prov#"))
    ]  # fmt: skip
    if not spoken:
        return inapplicable(f"no terms of RDF Schema, Dublin Core or PROV on {_things(subject)}")
    return passed(
        f"{len({page.url for page in spoken})} of {len(things)} things are described, such as {spoken[0].url}"
    )
