"""Bodies of actions, settings, leases and subscriptions, passed to the parser, the guards and the planners.

Mutations change terms of Turtle rather than characters: nearly all character changes fail in the parser, most term
changes pass it. JSON-LD is generated from the result, and mutated as JSON.
"""

import json
from collections.abc import Callable, Sequence
from random import Random
from typing import Any

from pyoxigraph import NamedNode, RdfFormat, Triple, parse, serialize

from fuzzing import mutation
from fuzzing.findings import Tally, in_process
from fuzzing.good import BODIES, JOINTS, TERMS, TURTLE_PREFIXES, able_arm
from linked_fleet_agent.wire.codec import encode_state
from linked_fleet_agent.wire.messages import State
from linked_fleet_base.contributions import set_present
from linked_fleet_base.errors import FleetError, UnprocessableContent
from linked_fleet_gateway.actions.action_handlers import HANDLERS
from linked_fleet_gateway.actions.admission import validate_action_body
from linked_fleet_gateway.actions.plan import ActionRequest, DeferredPlan, Motion, robot_time
from linked_fleet_gateway.app.extensions import BUILT_IN, contributions_of
from linked_fleet_gateway.extensions.reach.can_reach import LF
from linked_fleet_gateway.extensions.reach.extension import reach
from linked_fleet_gateway.http.body import parse_body
from linked_fleet_gateway.http.invoke import MAX_TRIPLES
from linked_fleet_gateway.resources.action_offer import Offer
from linked_fleet_gateway.resources.affordance import Control, Invoke, PutSetting, PutTarget
from linked_fleet_gateway.resources.body_values import validate_body
from linked_fleet_gateway.resources.resource import Resource
from linked_fleet_gateway.resources.subscription_resource import read_request
from linked_fleet_gateway.resources.tree import Tree
from linked_fleet_rdf.graph import Graph
from linked_fleet_rdf.validation import find_root, reachable_statements
from linked_fleet_state.events import Appeared, Described, Framed
from linked_fleet_state.fleet import Fleet
from linked_fleet_state.invocations import Invocations
from shacl_findings import pyshacl_finds

BASE = "http://127.0.0.1:8000"
_HANDLERS = {**HANDLERS, LF.Reach: reach}
set_present(contributions_of(BUILT_IN))
_SYNTAXES = {"application/n-triples": RdfFormat.N_TRIPLES, "application/rdf+xml": RdfFormat.RDF_XML}
_JSON = "application/ld+json"
_COMPARED = 0.004
"""Share of action bodies compared with pySHACL, which takes a hundred times as long as everything else."""
_OWN = {
    "rotate": "/arm/pan", "rotateBy": "/arm/roll", "translate": "/arm/slide", "translateBy": "/arm/slide",
    "targetRotation": "/arm/pan", "targetTranslation": "/arm/slide",
}  # fmt: skip


def run(count: int, seed: int, first: int = 0) -> Tally:
    gate = Gate()  # no body changes it
    return in_process("bodies", count, seed, first, lambda: gate.take)


def path_of(segment: str) -> str:
    """Return the path to which a body of BODIES belongs."""
    thing = _OWN.get(segment, "/arm")
    plain = segment in ("title", "annotations", "maximumSpeedScale", "lease", "subscriptions") or "target" in segment
    if segment == "subscriptions":
        thing = "/arm/pan"
    return f"{thing}/{segment}" if plain else f"{thing}/actions/{segment}"


def body(random: Random, segment: str) -> tuple[bytes, str]:
    """Return the body, and its declared media type."""
    text, changes = BODIES[segment], random.choice((0, 1, 1, 1, 2, 2, 3, 5))
    document = TURTLE_PREFIXES + mutation.terms(random, text, TERMS, changes)
    made, media_type = _in_syntax(random, document, BASE + path_of(segment))
    return (mutation.raw(random, made) if random.random() < 0.1 else made), media_type


def _in_syntax(random: Random, document: str, base: str) -> tuple[bytes, str]:
    """Return the document mostly as Turtle; invalid Turtle stays, possibly with another declared type."""
    media_type = random.choices(("text/turtle", _JSON, *_SYNTAXES), (60, 28, 6, 6))[0]
    turtle = document.encode(errors="surrogatepass")
    if media_type == "text/turtle":
        return turtle, media_type
    try:
        triples = [quad.triple for quad in parse(turtle, format=RdfFormat.TURTLE, base_iri=base)]
        if media_type == _JSON:
            return _json(random, triples), media_type
        return serialize(triples, format=_SYNTAXES[media_type]) or b"", media_type
    except (SyntaxError, ValueError, OSError):
        return turtle, media_type


def _json(random: Random, triples: Sequence[Triple]) -> bytes:
    document: Any = json.loads(serialize(triples, format=RdfFormat.JSON_LD) or b"[]")
    if random.random() < 0.3:
        document = {"@context": random.choice(_CONTEXTS), "@graph": document}
    return mutation.dumped(mutation.tree(random, document) if random.random() < 0.6 else document)


_CONTEXTS: tuple[Any, ...] = (
    {}, [], None, "https://w3id.org/linked-fleet/context", "context", "http://127.0.0.1:9/", "http://[", {"@base": "x"},
    {"@vocab": "https://w3id.org/linked-fleet#"}, {"@import": "http://127.0.0.1:9/"}, {"@propagate": False},
    {"x": {"@id": "x"}},
    {"@version": 1.1, "value": {"@id": "https://w3id.org/linked-fleet#value", "@context": {"@context": {}}}},
    {"a": "b", "b": "a"}, {"lf": {"@id": "https://w3id.org/linked-fleet#", "@prefix": True}}, {"@language": "e\ud800"},
)  # fmt: skip


class Gate:
    """A fleet of one robot, and the code paths for bodies."""

    def __init__(self) -> None:
        self._fleet = Fleet()
        rows = (0.1,) * len(JOINTS)
        frame = State(
            incarnation=1, sequence=1, monotonic_ns=1, wall_ns=1, positions=rows, velocities=rows, efforts=rows
        )
        for event in (Appeared("arm", 1), Described(able_arm(1)), Framed("arm", encode_state(frame))):
            self._fleet.apply(event, 1)

    def take(self, random: Random) -> None:
        segment = random.choice(tuple(BODIES))
        content, media_type = body(random, segment)
        path = path_of(segment)
        try:
            triples = parse_body(content, media_type, BASE + path, BASE, MAX_TRIPLES)
            self.judge(random, segment, path, triples)
        except FleetError as error:
            assert 400 <= error.status < 500 or error.status in (503, 504), f"a body is answered with {error.status}"
            assert error.detail.strip(), "a refusal says why"

    def judge(self, random: Random, segment: str, path: str, triples: list[Triple]) -> None:
        if segment == "subscriptions":
            read_request(triples, BASE + path, BASE)
            return
        found = Tree(self._fleet, Invocations(), BASE).resolve(path)
        assert isinstance(found, Resource), f"nothing is at {path}"
        take: Callable[..., None] = _GUARDS[type(found.affords)]
        take(random, found.affords, triples, path)


def _invoke(random: Random, afforded: Invoke, triples: list[Triple], path: str) -> None:
    _plan(random, afforded.offer, triples)


def _target(random: Random, afforded: PutTarget, triples: list[Triple], path: str) -> None:
    """Read a target as gateway/linked_fleet_gateway/http/invoke.py does."""
    focus = find_root(triples, NamedNode(BASE + path))
    values = {t.object for t in triples if t.subject == focus and t.predicate == LF.value}
    if len(values) != 1:
        raise UnprocessableContent("one value is put")
    (value,) = values
    action = NamedNode(BASE + afforded.offer.path)
    about = reachable_statements(triples, value)  # type: ignore[arg-type]
    moved = [Triple(action if t.subject == value else t.subject, t.predicate, t.object) for t in about]
    _plan(random, afforded.offer, moved)


def _plan(random: Random, offer: Offer, triples: list[Triple]) -> None:
    if random.random() < _COMPARED:
        _compare(offer, triples)
    admitted = validate_action_body(offer, triples, BASE)
    plan = _HANDLERS[offer.definition.iri](
        ActionRequest(BASE, admitted, offer.robot, offer.joint, robot_time(offer.robot))
    )
    if isinstance(plan, DeferredPlan):
        plan = plan.compute() if random.random() < 0.1 else None  # a search takes milliseconds
    assert plan is None or isinstance(plan, Motion), "what takes a body moves"


def _compare(offer: Offer, triples: list[Triple]) -> None:
    """Check that exactly what pySHACL refuses is refused, besides unused terms, on which a shape says nothing."""
    focus, graph = find_root(triples, NamedNode(BASE + offer.path)), Graph()
    shape = offer.describe_input(graph, BASE)
    slowly = bool(pyshacl_finds(graph.triples, shape, reachable_statements(triples, focus), focus))
    try:
        validate_action_body(offer, triples, BASE)
        quickly = False
    except UnprocessableContent as error:
        if error.unused:
            return
        quickly = True
    assert slowly == quickly, f"pySHACL {'refuses' if slowly else 'takes'} what we do not: {triples}"


def _set(random: Random, afforded: PutSetting, triples: list[Triple], path: str) -> None:
    remembered = afforded.setting.validate(triples, BASE)
    assert len(remembered) <= 70_000, "what is remembered is bounded"


def _control(random: Random, afforded: Control, triples: list[Triple], path: str) -> None:
    found = validate_body(triples, LF.ControlLeaseInput, BASE + path)
    assert found.number(found.root, LF.leaseDuration) is not None


_GUARDS: dict[type, Callable[..., None]] = {
    Invoke: _invoke, PutTarget: _target, PutSetting: _set, Control: _control
}  # fmt: skip
