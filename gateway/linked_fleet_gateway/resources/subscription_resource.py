"""Subscriptions as resources, and the request for one (paper 5.3, figure 4; R1.8)."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from decimal import Decimal
from functools import cache

from pyoxigraph import Literal, NamedNode, Triple

from linked_fleet_base.errors import UnprocessableContent
from linked_fleet_gateway.resources.affordance import ChangeSubscription, ResumeSubscription, Subscribe
from linked_fleet_gateway.resources.resource import CONTAINER, Resource, blueprint_of
from linked_fleet_gateway.resources.subscription import DeliveryState, Depth, Kind, Record, Subscription
from linked_fleet_rdf.graph import Graph, Node, integer, number, timestamp
from linked_fleet_rdf.shapes import SUBSCRIPTIONS, load_turtle
from linked_fleet_rdf.validation import (
    Terms,
    check_lexical_forms,
    check_root,
    find_root,
    refuse_statements,
    unused_statements,
)
from linked_fleet_rdf.vocabulary import DCTERMS, HTTP, HYBRIT, LDP, LF, METHODS, PREFIXES, RDF, RDFS, XSD
from linked_fleet_shacl import (
    CompiledGraph,
    CompiledShape,
    Data,
    Violation,
    compile_graph,
    compile_shape,
    report,
)
from linked_fleet_webhooks.signature import decode_secret

_TYPES = {
    Kind.CALLBACK: (HYBRIT.WebCallback,),
    Kind.WEBSOCKET: (LF.WebSocketStream, LF.Stream),
    Kind.EVENT_STREAM: (LF.EventStream, LF.Stream),
    Kind.STREAM: (LF.Stream,),
}
_DEPTHS = {Depth.THIS: LF.thisAlone, Depth.PROPERTIES: LF.withProperties, Depth.SUBTREE: LF.wholeSubtree}
_STATES = {
    DeliveryState.ACTIVE: LF.active,
    DeliveryState.WAITING: LF.waiting,
    DeliveryState.AWAITING_CONSENT: LF.awaitingConsent,
    DeliveryState.FAILING: LF.failing,
    DeliveryState.SUSPENDED: LF.suspended,
}
MAX_DESCRIBED = 100
"""Subscriptions that a container describes; others are only listed. Each description takes half a millisecond."""
CALLBACKS = (HYBRIT.callbackURL, HYBRIT.callbackUrl)
_READ = (*CALLBACKS, HYBRIT.onResource, HYBRIT.mediaType, LF.depth, LF.minimumInterval, LF.deadband, LF.secret)
_SHOWN = (
    LF.signed,
    LF.deliveryState,
    LF.lastDelivery,
    LF.lastStatus,
    LF.failures,
    LF.reason,
    HYBRIT.action,
    HYBRIT.blueprint,
    DCTERMS.identifier,
    DCTERMS.title,
    DCTERMS.created,
    RDFS.seeAlso,
)
"""Server-managed predicates of a subscription, which a body may contain and which are ignored (LDP 4.2.4.1)."""
_OF_CONTAINER = (RDF.type, LDP.contains, LDP.constrainedBy, DCTERMS.title, RDFS.seeAlso, LF.vocabulary)
_READ_TYPES = {HYBRIT.Subscription, *(each for types in _TYPES.values() for each in types)}


@dataclass(frozen=True)
class SubscriptionRequest:
    """A posted subscription; ``resource`` is an IRI of this fleet, "" stands for an omitted value."""

    resource: str
    callback: str = ""
    media_type: str = ""
    depth: Depth = Depth.PROPERTIES
    interval_s: float = 0.0
    deadband: float = 0.0
    secret: str = ""


# -- descriptions ---------------------------------------------------------------------------------------------------


def container_path(owner: str) -> str:
    return f"{owner.rstrip('/')}/subscriptions"


def subscription_path(subscription: Subscription) -> str:
    return f"{container_path(subscription.owner)}/{subscription.id}"


def resume_path(subscription: Subscription) -> str:
    return f"{subscription_path(subscription)}/actions/resume"


def is_resumable(record: Record) -> bool:
    """Return True for a callback that waits for a repetition or for consent, or is suspended."""
    waits = (DeliveryState.FAILING, DeliveryState.SUSPENDED, DeliveryState.AWAITING_CONSENT)
    return not record.subscription.kind.is_stream and record.delivery.state in waits


def describe_subscription(graph: Graph, base: str, record: Record) -> None:
    """Describe a subscription: Figure 4, its options, and its state, without the secret."""
    subscription, delivery = record.subscription, record.delivery
    iri = NamedNode(base + subscription_path(subscription))
    graph.a(iri, HYBRIT.Subscription, *_TYPES[subscription.kind])
    graph.add(iri, HYBRIT.onResource, NamedNode(base + subscription.resource))
    if subscription.callback:
        graph.add(iri, HYBRIT.callbackURL, Literal(subscription.callback, datatype=XSD.anyURI))
    graph.add(iri, HYBRIT.mediaType, Literal(subscription.media_type))
    graph.add(iri, DCTERMS.identifier, Literal(subscription.id))
    graph.add(iri, DCTERMS.title, Literal(f"Subscription to {subscription.resource}"))
    graph.add(iri, RDFS.seeAlso, NamedNode(base + container_path(subscription.owner)))
    graph.add(iri, HYBRIT.blueprint, LF.SubscriptionResourceShape, NamedNode(iri.value + "/blueprint"))
    graph.add(iri, DCTERMS.created, timestamp(subscription.created_ns))
    graph.add(iri, LF.depth, _DEPTHS[subscription.depth])
    graph.add(iri, LF.minimumInterval, _decimal(subscription.interval_s))
    graph.add(iri, LF.deadband, number(subscription.deadband))
    graph.add(iri, LF.signed, Literal(bool(subscription.secret)))
    graph.add(iri, LF.deliveryState, _STATES[delivery.state])
    graph.add(iri, LF.lastDelivery, LF.unknown if delivery.last_ns is None else timestamp(delivery.last_ns))
    if delivery.last_status is not None:
        graph.add(iri, LF.lastStatus, integer(delivery.last_status))
    graph.add(iri, LF.failures, integer(delivery.failures))
    if delivery.reason:
        graph.add(iri, LF.reason, Literal(delivery.reason))
    if is_resumable(record):
        graph.add(iri, HYBRIT.action, NamedNode(base + resume_path(subscription)))


def describe_resume(graph: Graph, base: str, record: Record) -> None:
    """Describe the action that retries a callback at once; it takes no input."""
    iri = NamedNode(base + resume_path(record.subscription))
    graph.a(iri, HYBRIT.Action)
    graph.add(iri, DCTERMS.title, Literal(f"Resume subscription {record.subscription.id}"))
    comment = "Takes no body. Asks the receiver for its consent if that is missing, and delivers what waits."
    graph.add(iri, RDFS.comment, Literal(comment))
    graph.add(iri, RDFS.seeAlso, NamedNode(base + subscription_path(record.subscription)))
    request = graph.blank(HTTP.Request)
    graph.add(iri, HYBRIT.binding, request)
    graph.add(request, HTTP.mthd, METHODS.POST)
    graph.add(request, HTTP.requestURI, iri)


def describe_subscriptions(graph: Graph, base: str, owner: str, records: Iterable[Record]) -> None:
    """Describe the LDP container of the thing at ``owner`` (R1.8); its first members are described as in Figure 4."""
    iri, records = NamedNode(base + container_path(owner)), list(records)
    graph.a(iri, LDP.BasicContainer, LDP.Container)
    graph.add(iri, DCTERMS.title, Literal(f"Subscriptions of {owner}"))
    graph.add(iri, RDFS.seeAlso, NamedNode(base + owner))
    # The shape's IRI need not lead to this gateway, so its document is linked as well.
    graph.add(iri, LDP.constrainedBy, LF.SubscriptionShape)
    graph.add(iri, LF.vocabulary, NamedNode(f"{base}/vocabulary"))
    graph.add(iri, LDP.contains, *(NamedNode(base + subscription_path(each.subscription)) for each in records))
    for record in records[:MAX_DESCRIBED]:
        describe_subscription(graph, base, record)


def describe_request_shape(graph: Graph) -> None:
    """Add the shapes that validate posted subscriptions to the vocabulary document."""
    for triples in load_turtle(SUBSCRIPTIONS).values():
        for triple in triples:
            graph.add(triple.subject, triple.predicate, triple.object)  # type: ignore[arg-type]


def describe_version(graph: Graph, iri: NamedNode, version: str, event_id: str, previous: str | None = None) -> None:
    """Add the versions of a message to a representation, by which clients see that values were conflated, and its id,
    from which they resume.
    """
    graph.add(iri, LF.version, Literal(version))
    graph.add(iri, LF.eventId, Literal(event_id))
    if previous is not None:
        graph.add(iri, LF.previousVersion, Literal(previous))


def _decimal(value: float) -> Literal:
    text = f"{Decimal(repr(value + 0.0)):f}"
    return Literal(text if "." in text else text + ".0", datatype=XSD.decimal)


# -- requests -------------------------------------------------------------------------------------------------------


def read_request(body: Sequence[Triple], container_iri: str, base: str) -> SubscriptionRequest:
    """Parse a posted subscription. Raises UnprocessableContent, with the report, if the shape refuses it."""
    focus = _focus(body, NamedNode(container_iri))
    about = _about(body, focus)
    check_lexical_forms(about, container_iri)
    if violations := _violations(about, focus):
        raise _refusal(violations, container_iri)
    refuse_statements(_left(body, focus, NamedNode(container_iri)), container_iri)
    stated = {HYBRIT.callbackURL if t.predicate in CALLBACKS else t.predicate: _text(t) for t in about}
    resource, secret = stated[HYBRIT.onResource], stated.get(LF.secret, "")
    if not resource.startswith(base + "/"):
        raise UnprocessableContent(
            f"{resource[:200]!r} is no resource of this fleet; here their IRIs begin with {base}/.",
            constraint=container_iri,
        )
    _check_secret(secret, container_iri)
    depths = {iri.value: depth for depth, iri in _DEPTHS.items()}
    return SubscriptionRequest(
        resource,
        stated.get(HYBRIT.callbackURL, "").strip(),  # xsd:anyURI collapses white space
        stated.get(HYBRIT.mediaType, ""),
        depths[stated.get(LF.depth, LF.withProperties.value)],
        float(stated.get(LF.minimumInterval, 0)) + 0.0,
        float(stated.get(LF.deadband, 0)) + 0.0,
        secret,
    )


def _focus(body: Sequence[Triple], container: NamedNode) -> Node:
    """Return the only hybrit:Subscription, so that Figure 4 can be posted unchanged; else the root of the body."""
    typed = list(dict.fromkeys(t.subject for t in body if t.predicate == RDF.type and t.object == HYBRIT.Subscription))
    if len(typed) == 1:
        return check_root(typed[0], container, creates_member=True)  # type: ignore[arg-type]
    if len(typed) > 1 and container not in typed:
        raise UnprocessableContent(
            f"The body describes {len(typed)} subscriptions; post one at a time.", constraint=container.value
        )
    return find_root(body, container, creates_member=True)


def _left(body: Sequence[Triple], focus: Node, container: NamedNode) -> list[Triple]:
    """Return unused triples except those about the container, so that Figure 4 can be posted unchanged."""
    left = unused_statements(body, focus, _terms())
    return [t for t in left if t.subject != container or t.subject == focus or t.predicate not in _OF_CONTAINER]


@cache
def _terms() -> Terms:
    """Return the terms of the shape and of descriptions, so that a description can be posted to create another one."""
    return Terms.from_shapes(load_turtle(SUBSCRIPTIONS), LF.SubscriptionShape).with_terms(*_SHOWN, types=_READ_TYPES)


def _about(body: Sequence[Triple], focus: Node) -> list[Triple]:
    """Return the triples that the shapes validate."""
    about = [t for t in body if t.subject == focus]
    types = [t for t in about if t.predicate == RDF.type and t.object in _READ_TYPES]
    return list(dict.fromkeys(types + [t for t in about if t.predicate in _READ]))


def _text(triple: Triple) -> str:
    assert not isinstance(triple.object, Triple)  # the parser takes no triple terms
    return triple.object.value


def _violations(about: Sequence[Triple], focus: Node) -> list[Violation]:
    """Validate with the shape of a subscription, whatever type is stated, and with others by their targets.

    The report does not contain a secret.
    """
    data, (subscription, others) = Data(about), validators()
    found = dict.fromkeys([*subscription.check(data, focus), *others.check(data)])
    return [each._replace(value=None) if each.path == LF.secret else each for each in found]


@cache
def validators() -> tuple[CompiledShape, CompiledGraph]:
    shapes = load_turtle(SUBSCRIPTIONS)
    return compile_shape(shapes, LF.SubscriptionShape, PREFIXES), compile_graph(shapes, PREFIXES)


def _refusal(violations: Sequence[Violation], container_iri: str) -> UnprocessableContent:
    """Return the error, with the message of every violated constraint."""
    messages = sorted({each.message for each in violations})
    detail = "The body does not conform to the shape of a subscription: " + "; ".join(messages)
    about = report(violations, validators()[0].triples)
    return UnprocessableContent(detail + ".", report=about, constraint=container_iri)


def _check_secret(secret: str, container_iri: str) -> None:
    """Check that the secret can be decoded and has a valid length, which a pattern cannot express."""
    try:
        if secret:
            decode_secret(secret)
    except ValueError as error:
        raise UnprocessableContent(f"lf:secret: {error}", constraint=container_iri) from None


def resolve_subscription(thing: Resource, rest: list[str], records: Sequence[Record], base: str) -> Resource | None:
    """Return the container of ``thing``, a subscription in it, or its action; ``records`` are the visible ones."""
    if not rest:
        return Resource(
            container_path(thing.path),
            f"Subscriptions of {thing.title}",
            lambda graph: describe_subscriptions(graph, base, thing.path, records),
            CONTAINER,
            own_paths=tuple(subscription_path(each.subscription) for each in records),
            affords=Subscribe(thing.path),
        )
    record = next((each for each in records if each.subscription.id == rest[0]), None)
    if record is None:
        return None
    path, resume = subscription_path(record.subscription), resume_path(record.subscription)
    title = f"Subscription {record.subscription.id}"
    if rest[1:] == ["actions", "resume"] and is_resumable(record):
        return Resource(
            resume,
            f"Resume {title}",
            lambda graph: describe_resume(graph, base, record),
            (),
            affords=ResumeSubscription(record),
        )
    whole = Resource(
        path,
        title,
        lambda graph: describe_subscription(graph, base, record),
        own_paths=(path + "/blueprint", *((resume,) if is_resumable(record) else ())),
        affords=ChangeSubscription(record),
    )
    if rest[1:] == ["blueprint"]:
        # It ends with the subscription, which the live fleet does not know.
        return blueprint_of(whole, base, (LF.SubscriptionResourceShape,)).replace(publishes_changes=False)
    return None if rest[1:] else whole
