"""Changes that an update may make to the description of a subscription."""

from dataclasses import replace

import pytest

from linked_fleet_base.errors import UnprocessableContent
from linked_fleet_gateway.extensions.patch.sparql_update import apply_update, parse_update
from linked_fleet_gateway.resources.subscription import ChangeableOptions, Delivery, Depth, Kind, Record, Subscription
from linked_fleet_gateway.resources.subscription_change import changed_options, managed_option_statements
from linked_fleet_gateway.resources.subscription_resource import describe_subscription, subscription_path
from linked_fleet_rdf.graph import Graph
from linked_fleet_rdf.vocabulary import PREFIXES

_BASE = "http://example.org"
_SECRET, _OTHER = (f"whsec_{'MfKQ9r8GKYqrTwjUPD8ILPZIo2LaLa'}{each}" for each in ("Sw", "SQ"))
_CALLBACK = Subscription(
    id="840c14b0-6def-11e7-907b-a6006ad3dba0",
    owner="/baxter/right_s1",
    resource="/baxter/right_s1/rotation",
    kind=Kind.CALLBACK,
    media_type="text/turtle",
    base=_BASE,
    client="127.0.0.1",
    created_ns=1_500_000_000_000_000_000,
    interval_s=0.1,
    deadband=0.1234567891,
    callback="http://www.example.org/receiver",
    secret=_SECRET,
)
_STREAM = replace(_CALLBACK, kind=Kind.EVENT_STREAM, callback="", secret="")
_IRI = _BASE + subscription_path(_CALLBACK)
_PROLOGUE = "".join(f"PREFIX {prefix}: <{iri}> " for prefix, iri in PREFIXES.items())


def _after(update: str, subscription: Subscription = _CALLBACK) -> ChangeableOptions:
    graph = Graph()
    describe_subscription(graph, _BASE, Record(subscription, Delivery(), "run"))
    after = apply_update(graph.triples, parse_update(_PROLOGUE + update, _IRI))
    return changed_options(graph.triples, after, subscription, _BASE)


def _refused(update: str, subscription: Subscription = _CALLBACK) -> UnprocessableContent:
    with pytest.raises(UnprocessableContent) as caught:
        _after(update, subscription)
    assert caught.value.constraint
    return caught.value


def _set(predicate: str, value: str) -> str:
    return f"DELETE {{ <> {predicate} ?old }} INSERT {{ <> {predicate} {value} }} WHERE {{ <> {predicate} ?old }}"


@pytest.mark.parametrize(
    ("update", "options"),
    [
        (_set("lf:minimumInterval", "2.5"), {"interval_s": 2.5}),
        (_set("lf:deadband", "1e-3"), {"deadband": 0.001}),
        (_set("lf:depth", "lf:wholeSubtree"), {"depth": Depth.SUBTREE}),
        (_set("hybrit:mediaType", '"application/ld+json"'), {"media_type": "application/ld+json"}),
        (f'INSERT DATA {{ <> lf:secret "{_OTHER}" }}', {"secret": _OTHER}),
        ("DELETE WHERE { <> lf:minimumInterval ?i ; lf:deadband ?d }", {"interval_s": 0.0, "deadband": 0.0}),
        ("DELETE WHERE { <> hybrit:mediaType ?m }", {"media_type": ""}),
        (_set("hybrit:callbackURL", '"http://www.example.org/receiver"^^xsd:anyURI'), {}),
        ("DELETE WHERE { <> lf:secret ?unseen }", {}),
    ],
)
def test_the_options_are_changed_and_nothing_else(update: str, options: dict[str, object]) -> None:
    """Options outside the update keep their values exactly, and so does the secret, which cannot be read."""
    assert _after(update) == replace(_CALLBACK.options, **options)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("update", "named"),
    [
        (_set("hybrit:onResource", "<../velocity>"), "onResource"),
        ("DELETE WHERE { <> hybrit:onResource ?r }", "onResource"),
        (_set("hybrit:callbackURL", '"http://evil.example/"^^xsd:anyURI'), "callbackURL"),
        ('INSERT DATA { <> hybrit:callbackUrl "http://evil.example/"^^xsd:anyURI }', "callbackUrl"),
        ("INSERT DATA { <> a lf:Stream }", "type>"),
        ("DELETE DATA { <> a hybrit:WebCallback }", "type>"),
    ],
)
def test_which_subscription_it_is_cannot_be_changed(update: str, named: str) -> None:
    refusal = _refused(update)
    assert named in refusal.detail
    assert "cannot be changed" in refusal.detail


def test_a_stream_keeps_its_media_type_and_has_no_secret() -> None:
    assert "mediaType" in _refused(_set("hybrit:mediaType", '"application/ld+json"'), _STREAM).detail
    assert "lf:secret is for callbacks" in _refused(f'INSERT DATA {{ <> lf:secret "{_SECRET}" }}', _STREAM).detail
    assert _after(_set("lf:minimumInterval", "3"), _STREAM).interval_s == 3.0


@pytest.mark.parametrize(
    ("update", "said"),
    [
        (_set("lf:minimumInterval", "-1"), "lf:minimumInterval must be one number"),
        ("INSERT DATA { <> lf:minimumInterval 3 }", "lf:minimumInterval must be one number"),
        (_set("lf:depth", "lf:deep"), "lf:depth must be one of"),
        ('INSERT DATA { <> lf:secret "whsec_AAAA" }', "lf:secret"),
        (f'INSERT DATA {{ <> lf:secret "{_SECRET}" , "{_OTHER}" }}', "lf:secret must be one"),
        ("INSERT DATA { <> lf:minimumIntervall 3 }", "minimumIntervall"),
        ('INSERT DATA { <> lf:reason "mine" }', "lf:reason"),
        ("INSERT DATA { <> lf:failures 0 , 1 }", "failures"),
        ("INSERT DATA { <http://example.org/x> lf:deadband 1 }", "http://example.org/x"),
    ],
)
def test_invalid_or_unused_statements_are_refused(update: str, said: str) -> None:
    """By the shape of a posted subscription; properties managed by the gateway cannot get a second value."""
    refusal = _refused(update)
    assert said.removeprefix("lf:") in refusal.detail
    assert not any(secret in f"{refusal.detail}{refusal.report}{refusal.unused}" for secret in (_SECRET, _OTHER))


def test_managed_properties_are_not_in_the_shape_of_input() -> None:
    graph = Graph()
    describe_subscription(graph, _BASE, Record(_CALLBACK, Delivery(reason="Gone."), "run"))
    kept = {
        each.predicate.value.rpartition("#")[2].rpartition("/")[2]
        for each in managed_option_statements(graph.triples, _IRI)
    }
    assert kept == {
        "identifier", "title", "seeAlso", "blueprint", "created", "signed", "deliveryState", "lastDelivery",
        "failures", "reason",
    }  # fmt: skip
