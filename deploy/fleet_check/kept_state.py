"""State of a fleet that a backup keeps: made through the front, and read before and after."""

from collections.abc import Mapping
from dataclasses import dataclass
from hashlib import sha256

from checks import ANGLE, Fleet, status_at, wait_for
from front import TURTLE, Front
from rdflib import Graph, URIRef
from rdflib.compare import to_canonical_graph

LF = "https://w3id.org/linked-fleet#"
LDP_CONTAINS = URIRef("http://www.w3.org/ns/ldp#contains")
_ROBOT, _LEASE, _JOINT = "go2/", "go2/lease", "baxter/right_s1/actions/rotate"
_PREFIXES = """@prefix lf: <https://w3id.org/linked-fleet#> . @prefix dcterms: <http://purl.org/dc/terms/> .
@prefix maths: <http://vocab.arvida.de/2015/06/maths/vocab#> . @prefix unit: <http://qudt.org/vocab/unit/> .
@prefix vom: <http://vocab.arvida.de/2015/06/vom/vocab#> .
"""
_PLACE = "lf:position [ maths:x 9 ; maths:y 9 ; maths:z 1 ; vom:unit unit:M ]"
SETTINGS: Mapping[str, str] = {
    _ROBOT + "title": '<> lf:value "Guard" .',
    _ROBOT + "annotations": '<.> dcterms:description "Guards the door."@en .',
    _ROBOT + "maximumSpeedScale": "<> lf:value [ vom:numericalValue 0.5 ] .",
    _ROBOT + "placement": f"<> {_PLACE} .",
    _LEASE: '<> lf:holder "Ada" ; lf:leaseDuration 3000 .',
}
"""Bodies of PUT requests, by path."""
ADDED: Mapping[str, str] = {
    "world/objects": f"""<> a lf:KeepOutZone ; dcterms:title "door" ; {_PLACE} ;
        lf:geometry [ a lf:Sphere ; lf:radius [ vom:numericalValue 0.1 ; vom:unit unit:M ] ] .""",
    "rules": f"""<> a lf:Rule ; dcterms:title "never" ; lf:invokes </actions/stopAll> ;
        lf:condition "SELECT ?r WHERE {{ ?r <{LF}presence> <{LF}absent> }}" .""",
}
"""Bodies of POST requests, by the path of their container."""
_SLOWLY = (
    _PREFIXES
    + """<> vom:numericalValue 0.5 ; vom:unit unit:RAD ;
    lf:speed [ vom:numericalValue 0.05 ; vom:unit unit:RAD-PER-SEC ] ."""
)
_OF_SUBSCRIPTION = ("onResource", "callbackURL", "minimumInterval", "created")
"""The predicates that stay while messages are delivered."""
_OF_LEASE = ("identifier", "holder", "leaseDuration", "state")
"""Without its end, because the time of a lease stands still while no gateway runs."""
_OF_RULE = ("title", "condition", "invokes", "enabled", "created", "state")
State = dict[str, frozenset[str]]


@dataclass(frozen=True)
class Made:
    """The state that was made: IRIs by name, sessions as cookies, and entries of the audit."""

    iris: Mapping[str, str]
    session: str
    ended_session: str
    audit: frozenset[str]


def make(fleet: Fleet) -> Made:
    """Make some of everything, except the callback of ``fleet.subscription``, which exists."""
    front = fleet.front
    for path, body in SETTINGS.items():
        _ask(front, "PUT", path, body)
    iris = {path: front.root + path for path in SETTINGS}
    iris |= {path: _ask(front, "POST", path, body) for path, body in ADDED.items()}
    iris["repeated"] = _repeat(front)
    iris["recording"] = _recorded(fleet)
    session, ended = _log_in(front), _log_in(front)
    said = front.request(front.root + "logout", "POST", Cookie=ended, Origin=front.root.rstrip("/"))
    assert said.status == 303, f"the logout answered {said.status}"
    wait_for(lambda: all(_login_status(front, ended) == 401 for _ in range(8)), "the logout at each gateway")
    return Made(iris, session, ended, _audit(front))


def rule_is_active(fleet: Fleet, made: Made) -> bool:
    rule = URIRef(made.iris["rules"])
    return (rule, URIRef(LF + "state"), URIRef(LF + "active")) in fleet.front.graph(rule)


def read(fleet: Fleet, made: Made) -> State:
    """Return what clients see of it, in a form that can be compared."""
    front, iris = fleet.front, made.iris
    whole = [name for name in (*SETTINGS, "world/objects") if name != _LEASE]
    kept: State = {name: _canonical(front.graph(iris[name])) for name in whole}
    kept["lease"] = _some(front.graph(iris[_LEASE]), _OF_LEASE)
    kept["rule"] = _some(front.graph(iris["rules"]), _OF_RULE)
    kept["subscription"] = _some(front.graph(fleet.subscription), _OF_SUBSCRIPTION)
    kept["invocation"] = _canonical(front.graph(fleet.invocation))
    kept["invocation of an idempotency key"] = _one(_repeat(front))
    recording = front.request(iris["recording"], Accept="application/vnd.mcap")
    kept["recording"] = _one(recording.status, sha256(recording.body).hexdigest())
    kept["session"] = _one(_login_status(front, made.session))
    kept["session that was logged out"] = _one(_login_status(front, made.ended_session))
    kept["audit"] = made.audit & _audit(front)
    return kept


def differences(before: State, after: State) -> str:
    """Return what was lost and what is new, by name; empty if nothing has changed."""
    changed = (name for name in before if before[name] != after[name])
    return "; ".join(
        f"{name}: lost {sorted(before[name] - after[name])}, new {sorted(after[name] - before[name])}"
        for name in changed
    )


def _ask(front: Front, method: str, path: str, body: str) -> str:
    """Return the IRI of what was made, if anything."""
    said = front.request(front.root + path, method, _PREFIXES + body, Content_Type=TURTLE)
    assert 200 <= said.status < 300, f"{method} {path} answered {said.status}: {said.body[:300]!r}"
    return said.fields.get("location", "")


def _repeat(front: Front) -> str:
    """Move a joint unless a request with this key has done so; return the invocation."""
    said = front.request(
        front.root + _JOINT, "PUT", ANGLE % 5, timeout_s=40,
        Content_Type=TURTLE, Idempotency_Key='"once"', Prefer="wait=30",
    )  # fmt: skip
    assert said.status in (200, 201, 202, 204), f"rotate answered {said.status}: {said.body[:300]!r}"
    return said.fields["location"]


def _recorded(fleet: Fleet) -> str:
    """Stop a motion; return the IRI of the recording, which each gateway has written."""
    front = fleet.front
    moving = front.request(front.root + _JOINT, "PUT", _SLOWLY, Content_Type=TURTLE)
    assert moving.status == 204, f"rotate answered {moving.status}: {moving.body[:300]!r}"
    stopped = front.request(front.root + "baxter/actions/stop", "POST")
    assert stopped.status == 204, f"stop answered {stopped.status}"
    iri = f"{front.root}baxter/recordings/{stopped.fields['location'].rpartition('/')[2]}"
    gateways = fleet.stack.containers("gateway")
    wait_for(lambda: all(status_at(fleet, each, iri) == "200" for each in gateways), f"{iri} at each gateway")
    return iri


def _log_in(front: Front) -> str:
    """Return the cookie of a new session."""
    said = front.request(
        front.root + "login", "POST", f"token={front.token}",
        Content_Type="application/x-www-form-urlencoded", Origin=front.root.rstrip("/"),
    )  # fmt: skip
    assert said.status == 303, f"the login answered {said.status}"
    return said.fields["set-cookie"].partition(";")[0]


def _login_status(front: Front, session: str) -> int:
    return front.request(front.root, Cookie=session, Accept=TURTLE).status


def _audit(front: Front) -> frozenset[str]:
    return frozenset(map(str, front.graph(front.root + "audit").objects(None, LDP_CONTAINS)))


def _one(*values: object) -> frozenset[str]:
    return frozenset([" ".join(map(str, values))])


def _canonical(graph: Graph) -> frozenset[str]:
    return frozenset(to_canonical_graph(graph).serialize(format="nt").splitlines())


def _some(graph: Graph, names: tuple[str, ...]) -> frozenset[str]:
    """Return the statements about resources whose predicates end with one of these names."""
    return frozenset(f"{s} {p} {o}" for s, p, o in graph if isinstance(s, URIRef) and str(p).endswith(names))
