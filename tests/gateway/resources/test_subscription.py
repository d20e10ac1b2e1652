"""Subscriptions as Linked Data: Figure 4, and the bodies that a container accepts."""

import dataclasses
from decimal import Decimal
from pathlib import Path

import pyshacl
import pytest
import rdflib
from hypothesis import given, settings
from hypothesis import strategies as st
from pyoxigraph import Literal, NamedNode, Triple
from rdflib.compare import isomorphic

from all_terms import LF
from linked_fleet_base.errors import UnprocessableContent
from linked_fleet_gateway.resources.subscription import Delivery, DeliveryState, Depth, Kind, Record, Subscription
from linked_fleet_gateway.resources.subscription_resource import (
    SubscriptionRequest,
    describe_request_shape,
    describe_resume,
    describe_subscription,
    describe_subscriptions,
    describe_version,
    read_request,
    subscription_path,
)
from linked_fleet_rdf.graph import Graph
from linked_fleet_rdf.serialise import parse
from linked_fleet_rdf.shapes import load_turtle
from linked_fleet_rdf.turtle import write_turtle
from linked_fleet_rdf.vocabulary import HTTP, HYBRIT, LDP, METHODS, PREFIXES, RDF
from properties import examples

_BASE = "http://example.org"
_CONTAINER = f"{_BASE}/baxter/right_s1/subscriptions"
_ROTATION = f"{_BASE}/baxter/right_s1/rotation"
_SECRET = "whsec_MfKQ9r8GKYqrTwjUPD8ILPZIo2LaLaSw"
_ID = "840c14b0-6def-11e7-907b-a6006ad3dba0"
_GOLDEN = (Path(__file__).parents[2] / "golden" / "figure_4.ttl").read_text()
_PREFIXES = "".join(f"@prefix {prefix}: <{iri}> .\n" for prefix, iri in PREFIXES.items())
_FIGURE_4 = Subscription(
    id=_ID,
    owner="/baxter/right_s1",
    resource="/baxter/right_s1/rotation",
    kind=Kind.CALLBACK,
    media_type="text/turtle",
    base=_BASE,
    client="127.0.0.1",
    created_ns=1_500_000_000_000_000_000,
    callback="http://www.example.org/receiver",
)


def _record(state: DeliveryState = DeliveryState.ACTIVE, **changes: object) -> Record:
    return Record(dataclasses.replace(_FIGURE_4, **changes), Delivery(state), "holder")  # type: ignore[arg-type]


def _request(turtle: str, base: str = _BASE) -> SubscriptionRequest:
    return read_request(parse((_PREFIXES + turtle).encode(), "text/turtle", _CONTAINER), _CONTAINER, base)


def _ask(more: str = "", callback: str = 'hybrit:callbackURL "http://www.example.org/receiver"') -> SubscriptionRequest:
    return _request(f"<> a hybrit:Subscription ; hybrit:onResource <rotation> ; {callback} ; {more} .")


def _refusal(turtle: str) -> UnprocessableContent:
    with pytest.raises(UnprocessableContent) as caught:
        _request(turtle)
    assert caught.value.constraint == _CONTAINER
    return caught.value


def _described(record: Record) -> tuple[NamedNode, Graph]:
    graph = Graph()
    describe_subscription(graph, _BASE, record)
    return NamedNode(_BASE + subscription_path(record.subscription)), graph


def _rdflib(graph: Graph) -> rdflib.Graph:
    return rdflib.Graph().parse(data=write_turtle(graph.triples, PREFIXES, ""), format="turtle")


def _shapes() -> rdflib.Graph:
    graph = Graph()
    describe_request_shape(graph)
    return _rdflib(graph)


# -- descriptions ---------------------------------------------------------------------------------------------------


def test_figure_4() -> None:
    """Every triple of the figure, and no other value for one of its predicates."""
    graph = Graph()
    describe_subscriptions(graph, _BASE, "/baxter/right_s1", [_record()])
    golden = rdflib.Graph().parse(data=_GOLDEN, format="turtle")
    part = rdflib.Graph()
    part += [t for t in _rdflib(graph) if (None, t[1], None) in golden]
    assert isomorphic(part, golden)


def test_figure_4_conforms_to_the_shape_that_is_served() -> None:
    """As a whole document, with pySHACL alone; without the observed resource it does not."""
    golden = rdflib.Graph().parse(data=_GOLDEN, format="turtle")
    assert pyshacl.validate(golden, shacl_graph=_shapes(), inference="none")[0]
    golden.remove((None, rdflib.URIRef(HYBRIT.onResource.value), None))
    assert not pyshacl.validate(golden, shacl_graph=_shapes(), inference="none")[0]


@pytest.mark.parametrize(
    ("kind", "types"),
    [
        (Kind.WEBSOCKET, {LF.WebSocketStream, LF.Stream}),
        (Kind.EVENT_STREAM, {LF.EventStream, LF.Stream}),
        (Kind.STREAM, {LF.Stream}),
    ],
)
def test_a_stream_has_no_callback(kind: Kind, types: set[NamedNode]) -> None:
    iri, graph = _described(_record(kind=kind, callback=""))
    assert {t.object for t in graph.triples if t.predicate == RDF.type} == {HYBRIT.Subscription, *types}
    assert HYBRIT.callbackURL not in {t.predicate for t in graph.triples}
    assert {t.subject for t in graph.triples} == {iri}


def test_the_delivery_state_is_described() -> None:
    """Delivery state with its reason; before the first delivery its time is unknown, and there is no status."""
    iri, graph = _described(_record(DeliveryState.AWAITING_CONSENT))
    assert Triple(iri, LF.lastDelivery, LF.unknown) in graph.triples
    assert not {LF.lastStatus, LF.reason} & {t.predicate for t in graph.triples}
    delivery = Delivery(DeliveryState.SUSPENDED, 1_500_000_001_000_000_000, 503, 12, "The receiver answers 503.")
    iri, graph = _described(Record(_FIGURE_4, delivery, ""))
    text = write_turtle(graph.triples, PREFIXES, iri.value)
    for part in (
        "lf:deliveryState lf:suspended",
        'lf:lastDelivery "2017-07-14T02:40:01.000Z"^^xsd:dateTime',
        "lf:lastStatus 503",
        "lf:failures 12",
        'lf:reason "The receiver answers 503."',
    ):
        assert part in text


def test_the_secret_is_never_shown() -> None:
    """Neither in the description, which only says that deliveries are signed, nor in the report of a refusal."""
    iri, graph = _described(_record(secret=_SECRET))
    assert "whsec" not in write_turtle(graph.triples, PREFIXES, "")
    assert Triple(iri, LF.signed, Literal(True)) in graph.triples
    error = _refusal(f'<> a hybrit:Subscription ; hybrit:onResource <x> ; lf:secret "{_SECRET}", "{_SECRET}!" .')
    assert "MfKQ9r8" not in f"{error}{error.report}"


@pytest.mark.parametrize("state", DeliveryState)
@pytest.mark.parametrize("kind", Kind)
def test_resumable_callbacks_link_their_action(state: DeliveryState, kind: Kind) -> None:
    """Only callbacks, while something delays them; the linked action accepts a POST without a body."""
    record = _record(state, kind=kind)
    iri, graph = _described(record)
    actions = [t.object for t in graph.triples if t.predicate == HYBRIT.action]
    stuck = state in (DeliveryState.SUSPENDED, DeliveryState.FAILING, DeliveryState.AWAITING_CONSENT)
    assert actions == ([NamedNode(iri.value + "/actions/resume")] if stuck and kind is Kind.CALLBACK else [])
    described = Graph()
    describe_resume(described, _BASE, record)
    said = {t.predicate: t.object for t in described.triples if t.predicate != RDF.type}
    assert (said[HTTP.mthd], said[HTTP.requestURI].value) == (METHODS.POST, iri.value + "/actions/resume")
    assert HYBRIT.consumes not in said


def test_the_container_leads_to_the_shape_of_its_members() -> None:
    """ldp:constrainedBy names a shape, which is in the document linked by lf:vocabulary."""
    graph = Graph()
    describe_subscriptions(graph, _BASE, "/", [])
    iri = NamedNode(_BASE + "/subscriptions")
    assert Triple(iri, LDP.constrainedBy, LF.SubscriptionShape) in graph.triples
    assert Triple(iri, LF.vocabulary, NamedNode(_BASE + "/vocabulary")) in graph.triples
    assert LF.SubscriptionShape in load_turtle("subscriptions.ttl")


def test_every_term_of_ours_is_described() -> None:
    """R1.5: in the vocabulary, or as a shape."""
    described = {*load_turtle("vocabulary.ttl"), *load_turtle("blueprints.ttl"), *load_turtle("subscriptions.ttl")}
    assert not set(LF.terms.values()) - described


def test_versions_of_a_message() -> None:
    iri, graph = NamedNode(_ROTATION), Graph()
    describe_version(graph, iri, "1-42", "1-42~tag")
    describe_version(graph, iri, "1-43", "1-43~tag", "1-42")
    assert [t.object.value for t in graph.triples if t.predicate == LF.version] == ["1-42", "1-43"]
    assert [t.object.value for t in graph.triples if t.predicate == LF.previousVersion] == ["1-42"]
    assert [t.object.value for t in graph.triples if t.predicate == LF.eventId] == ["1-42~tag", "1-43~tag"]


# -- requests -------------------------------------------------------------------------------------------------------


def test_a_minimal_request() -> None:
    """Options left open stay open: a stream of the resource and its properties."""
    assert _request(f"<> a hybrit:Subscription ; hybrit:onResource <{_ROTATION}> .") == SubscriptionRequest(_ROTATION)


def test_every_option() -> None:
    found = _request(
        f"""[] a hybrit:Subscription, hybrit:WebCallback ; hybrit:onResource <{_ROTATION}> ;
        hybrit:callbackUrl <https://www.example.org/receiver> ; hybrit:mediaType "application/ld+json" ;
        lf:depth lf:wholeSubtree ; lf:minimumInterval 0.5 ; lf:deadband "1e-3"^^xsd:float ; lf:secret "{_SECRET}" ."""
    )
    callback = "https://www.example.org/receiver"
    assert found == SubscriptionRequest(_ROTATION, callback, "application/ld+json", Depth.SUBTREE, 0.5, 1e-3, _SECRET)


def test_json_ld() -> None:
    """Its numbers are integers and doubles."""
    text = """{"@id": "", "@type": "https://hybr-it-projekt.de/ns/hybr-it#Subscription",
        "https://hybr-it-projekt.de/ns/hybr-it#onResource": {"@id": "rotation"},
        "https://w3id.org/linked-fleet#minimumInterval": 2, "https://w3id.org/linked-fleet#deadband": 0.25}"""
    found = read_request(parse(text.encode(), "application/ld+json", _CONTAINER), _CONTAINER, _BASE)
    assert found == SubscriptionRequest(_ROTATION, interval_s=2.0, deadband=0.25)


def test_figure_4_can_be_posted() -> None:
    """Including its container, with either spelling of callbackURL and any of the three kinds of node."""
    figure = _request(_GOLDEN)
    assert figure == SubscriptionRequest(_ROTATION, "http://www.example.org/receiver", "text/turtle")
    for callback in ('callbackUrl "{}"', 'callbackURL "{}"', 'callbackURL "{}"^^xsd:anyURI', "callbackUrl <{}>"):
        found = _ask(callback="hybrit:" + callback.format(figure.callback))
        assert found.callback == figure.callback


@pytest.mark.parametrize("kind", Kind)
def test_a_description_can_be_posted(kind: Kind) -> None:
    """A client copies the description of a subscription to create another one; read-only parts are ignored."""
    options = {"depth": Depth.THIS, "interval_s": 1e-7, "deadband": 1e-300, "media_type": "application/n-triples"}
    callback = _FIGURE_4.callback if kind is Kind.CALLBACK else ""
    record = _record(DeliveryState.SUSPENDED, kind=kind, callback=callback, **options)
    graph = Graph()
    describe_subscriptions(graph, _BASE, "/baxter/right_s1", [record])
    found = read_request(graph.triples, _CONTAINER, _BASE)
    assert found == SubscriptionRequest(resource=_ROTATION, callback=callback, **options)  # type: ignore[arg-type]


@settings(max_examples=examples(30))
@given(st.floats(0, 86400), st.floats(0, allow_infinity=False))
def test_numbers_come_back_as_they_are(interval: float, deadband: float) -> None:
    """From a description as from a request."""
    _, graph = _described(_record(interval_s=interval, deadband=deadband))
    found = read_request(graph.triples, _CONTAINER, _BASE)
    assert (found.interval_s, found.deadband) == (interval, deadband)
    found = _ask(f"lf:minimumInterval {Decimal(interval):f} ; lf:deadband {deadband!r}")
    assert (found.interval_s, found.deadband) == (interval, deadband)


@pytest.mark.parametrize(
    ("more", "message"),
    [
        ("lf:minimumIntervall 5", "Nothing here uses what the body says by"),
        ('hybrit:callbackUri "http://a.example/"', "<https://hybr-it-projekt.de/ns/hybr-it#callbackUri>"),
        ("a lf:WebsocketStream", "<https://w3id.org/linked-fleet#WebsocketStream>"),
        ("lf:minimumInterval -1", "lf:minimumInterval must be one number of seconds from 0 to 86400"),
        ("lf:minimumInterval 86400.5", "lf:minimumInterval must be one number of seconds from 0 to 86400"),
        ('lf:minimumInterval "5"', "lf:minimumInterval must be one number"),
        ("lf:minimumInterval 1, 2", "lf:minimumInterval must be one number"),
        ("lf:minimumInterval <a>", "lf:minimumInterval must be one number"),
        ('lf:minimumInterval "NaN"^^xsd:float', "'NaN' is no finite number"),
        ('lf:deadband "INF"^^xsd:double', "'INF' is no finite number"),
        ('lf:deadband "1_0"^^xsd:integer', "'1_0' is no finite number"),
        ("lf:deadband -0.1", "lf:deadband must be one number that is not negative"),
        ("lf:deadband [ ]", "lf:deadband must be one number that is not negative"),
        ("lf:depth lf:deep", "lf:depth must be one of lf:thisAlone, lf:withProperties and lf:wholeSubtree"),
        ('lf:depth "this"', "lf:depth must be one of"),
        ("lf:depth lf:thisAlone, lf:wholeSubtree", "lf:depth must be one of"),
        ('hybrit:mediaType "text/turtle", "application/ld+json"', "hybrit:mediaType must be one string"),
        ('hybrit:mediaType "text/turtle"@en', "hybrit:mediaType must be one string"),
        ("hybrit:mediaType <text/turtle>", "hybrit:mediaType must be one string"),
        ("hybrit:onResource <other>", "hybrit:onResource must be one IRI"),
        ('hybrit:callbackUrl "http://other.example/"', "hybrit:callbackURL must be one absolute http or https URL"),
        ("a lf:EventStream", "an lf:Stream has no hybrit:callbackURL"),
        ('lf:secret "secret"', "lf:secret must be one string: whsec_ and Base64"),
        (f'lf:secret "{_SECRET}"@en', "lf:secret must be one string"),
        ('lf:secret "whsec_A"', "The secret is not in base64"),
        (f'lf:secret "{_SECRET}\\n"', "The secret is not in base64"),
        ('lf:secret "whsec_AAAA"', "The secret has 3 bytes"),
    ],
)
def test_bad_options(more: str, message: str) -> None:
    """Each is named in words."""
    with pytest.raises(UnprocessableContent) as caught:
        _ask(more)
    assert message in caught.value.detail
    assert "urn:linked-fleet" not in f"{caught.value.detail}{caught.value.report}"


@pytest.mark.parametrize(
    "callback",
    ['"receiver"', '"ftp://a.example/"', "<urn:x>", "[ ]", "5", '"http://a.example/ b"', '""', '"http://a.example"@en'],
)
def test_bad_callbacks(callback: str) -> None:
    with pytest.raises(UnprocessableContent, match="must be one absolute http or https URL"):
        _ask(callback=f"hybrit:callbackURL {callback}")


@pytest.mark.parametrize(
    ("turtle", "message"),
    [
        ("", "The body has no triples"),
        ("<a> hybrit:onResource <r> . <b> hybrit:onResource <r> .", "2 subjects that nobody refers to"),
        ("<a> a hybrit:Subscription . <b> a hybrit:Subscription .", "The body describes 2 subscriptions"),
        ("<> hybrit:onResource <r> .", "its rdf:type must be hybrit:Subscription"),
        ("<> a hybrit:Subscription .", "hybrit:onResource must be one IRI"),
        ('<> a hybrit:Subscription ; hybrit:onResource "r" .', "hybrit:onResource must be one IRI"),
        ("<> a hybrit:Subscription ; hybrit:onResource [ ] .", "hybrit:onResource must be one IRI"),
        ("<> a hybrit:Subscription ; hybrit:onResource <http://example.org.evil/> .", "is no resource of this fleet"),
        ("<> a hybrit:Subscription, hybrit:WebCallback ; hybrit:onResource <r> .", "needs a hybrit:callbackURL"),
        (
            f'<> a hybrit:Subscription ; hybrit:onResource <r> ; lf:secret "{_SECRET}" .',
            "an lf:secret is for callbacks",
        ),
    ],
)
def test_bad_bodies(turtle: str, message: str) -> None:
    assert message in _refusal(turtle).detail


def test_the_report_is_about_the_container() -> None:
    """The SHACL report names each failure once, about the IRI to which the body was posted."""
    error = _refusal("<> a hybrit:Subscription ; hybrit:mediaType 5 .")
    assert error.report is not None
    focus = {value for _, predicate, value in error.report if predicate.value.endswith("#focusNode")}
    assert focus == {NamedNode(_CONTAINER)}
    assert error.detail.count("hybrit:mediaType must") == error.detail.count("hybrit:onResource must") == 1


@pytest.mark.parametrize(
    "more",
    [
        '; <http://example.org/priority> "high" .',
        "; lf:depht lf:thisAlone .",
        "; a <http://example.org/Alarm> .",
        '; <http://www.w3.org/2000/01/rdf-schema#comment> "mine" .',
        ". <other> lf:minimumInterval 5 .",
        "; lf:deadband [ lf:deadband 1 ] .",
    ],
)
def test_unused_statements_about_a_subscription_are_refused(more: str) -> None:
    """Foreign or misspelt terms and statements about other resources get 422, and no subscription is created."""
    _refusal(f"<> a hybrit:Subscription ; hybrit:onResource <{_ROTATION}> {more}")


def test_a_refusal_names_what_is_not_used() -> None:
    """Each statement, up to twenty; of a long text only the beginning, because it may be a secret."""
    many = ", ".join(str(each) for each in range(30))
    error = _refusal(f"<> a hybrit:Subscription ; hybrit:onResource <{_ROTATION}> ; <http://example.org/p> {many} .")
    assert (len(error.unused), error.members["unused"]) == (20, error.unused)
    assert error.unused[0].startswith(f"<{_CONTAINER}> <http://example.org/p> ")
    (named,) = _refusal(f'<> a hybrit:Subscription ; hybrit:onResource <r> ; lf:secrett "{_SECRET}" .').unused
    assert "lf:secrett".removeprefix("lf:") in named and _SECRET[8:] not in named


def test_the_rest_of_the_body_costs_nothing() -> None:
    """Of ten thousand values the report names a few, and of triples about others none."""
    values = ", ".join(map(str, range(10_000)))
    others = " ".join(f"<s{i}> lf:deadband 'x' ." for i in range(10_000))
    body = f"<> a hybrit:Subscription ; hybrit:onResource <{_ROTATION}> ; lf:depth {values} . {others}"
    triples = parse((_PREFIXES + body).encode(), "text/turtle", _CONTAINER, max_triples=30_000)
    with pytest.raises(UnprocessableContent) as caught:
        read_request(triples, _CONTAINER, _BASE)
    assert caught.value.report is not None and len(caught.value.report) < 250
