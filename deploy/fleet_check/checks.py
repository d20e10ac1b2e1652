"""Checks of the running fleet from outside, as a user sees it. Their docstrings are printed."""

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from http.client import HTTPException
from typing import TypeVar

from front import Front, read_deliveries
from rdflib import URIRef
from reads import RepeatedReads, describe_violation
from stack import Stack, StackError

HYBRIT, LF = "https://hybr-it-projekt.de/ns/hybr-it#", "https://w3id.org/linked-fleet#"
HAS_PART = "http://purl.org/dc/terms/hasPart"
LDP_CONTAINS = "http://www.w3.org/ns/ldp#contains"
ROBOTS = ("baxter", "go2", "panda", "pmb2", "tiago", "ur5")
SWAYING = "ur5/shoulder_pan_joint/rotation"
_MOVING = "baxter/right_s1/rotation"
_NUMBER = "http://vocab.arvida.de/2015/06/vom/vocab#numericalValue"
_PATIENCE_S = 120.0
_POLL_S = 0.25
_LOAD_S = 6.0
ANGLE = """@prefix maths: <http://vocab.arvida.de/2015/06/maths/vocab#> .
@prefix vom: <http://vocab.arvida.de/2015/06/vom/vocab#> .
[] a maths:Scalar ; vom:numericalValue %s ; vom:unit maths:Degree ."""
T = TypeVar("T")


@dataclass
class Fleet:
    """The fleet under test, with data for later checks: the IRIs of a subscription and of an invocation."""

    stack: Stack
    front: Front
    receiver_port: int
    subscription: str = ""
    invocation: str = ""


def wait_for(probe: Callable[[], T], what: str) -> T:
    """Return the first true value of ``probe``; AssertionError naming ``what`` after two minutes."""
    deadline, last = time.monotonic() + _PATIENCE_S, "the condition is false"
    while time.monotonic() < deadline:
        try:
            if value := probe():
                return value
        except (AssertionError, OSError, HTTPException, StackError) as error:
            last = str(error)
        time.sleep(_POLL_S)
    raise AssertionError(f"{what}: {last}")


def fleet_over_https(fleet: Fleet) -> None:
    """six robots are online, over https with the fleet's own certificate authority"""
    wait_for(lambda: online(fleet) >= set(ROBOTS), "six robots online")


def links(fleet: Fleet) -> None:
    """links lead from the root to a robot, a joint, its value and its page"""
    front = fleet.front
    robot = front.follow_link(front.root, LDP_CONTAINS, "/baxter/")
    joint = front.follow_link(robot, HAS_PART, "/right_s1")
    rotation = front.follow_link(joint, HYBRIT + "property", "/rotation")
    assert b"numericalValue" in front.request(rotation, Accept="text/turtle").body, f"{rotation} has no value"
    page = front.request(joint, Accept="text/html")
    assert page.status == 200 and b"<html" in page.body, f"the page of {joint} answered {page.status}"


def http2(fleet: Fleet) -> None:
    """HTTP/2 is used if a client offers it"""
    assert fleet.front.http_version() == "2 200", f"curl says {fleet.front.http_version()}"


def http3(fleet: Fleet) -> None:
    """HTTP/3 is advertised, and QUIC responds on the port"""
    announced = fleet.front.request(fleet.front.root).fields.get("alt-svc", "nothing")
    assert f'h3=":{fleet.front.port}"' in announced, f"Alt-Svc has {announced}"
    assert fleet.front.supports_quic(), "no QUIC packet came back"


def private_endpoints(fleet: Fleet) -> None:
    """health and metrics are not public"""
    for path in ("health/ready", "metrics"):
        assert fleet.front.request(fleet.front.root + path).status == 404, path


def event_stream(fleet: Fleet) -> None:
    """a value is followed as an event stream"""
    with fleet.front.open_event_stream(fleet.front.root + SWAYING) as stream:
        seen = [next(stream) for _ in range(3)]
    assert len(set(seen)) == 3, "the value does not change"


def websocket(fleet: Fleet) -> None:
    """a value is followed on a WebSocket"""
    with fleet.front.open_websocket(fleet.front.root + SWAYING) as socket:
        seen = [socket.recv(timeout=20) for _ in range(3)]
    assert len(set(seen)) == 3, "the value does not change"


def callback(fleet: Fleet) -> None:
    """a value is followed by callbacks"""
    answer = fleet.front.request(
        f"{fleet.front.root}{SWAYING}?interval=0.5",
        Connection="Upgrade", Upgrade="callback", Callback="http://receiver:9000/",
    )  # fmt: skip
    assert answer.status == 201, f"subscribing answered {answer.status}: {answer.body[:300]!r}"
    fleet.subscription = answer.fields["location"]
    more_callbacks(fleet)


def motion(fleet: Fleet) -> None:
    """a robot moves, and reports the end of the motion"""
    measured = []
    for degrees in (10, 20):
        fleet.invocation = _rotate(fleet, degrees)
        values = fleet.front.graph(fleet.front.root + _MOVING).objects(None, URIRef(_NUMBER))
        measured.append(math.degrees(float(next(iter(values)))))
    assert abs(measured[0] - 10) < 1 and abs(measured[1] - 20) < 1, f"it is at {measured} and not at 10 and 20 degrees"


def shared_state(fleet: Fleet) -> None:
    """both gateways know the invocation and the subscription"""
    gateways = fleet.stack.containers("gateway")
    assert len(gateways) == 2, f"{len(gateways)} gateways run"
    for gateway in gateways:
        for iri in (fleet.invocation, fleet.subscription):
            said = status_at(fleet, gateway, iri)
            assert said == "200", f"gateway {gateway[:12]} answers {said} to {iri}"


def gateway_loss(fleet: Fleet) -> None:
    """a gateway is killed: reads are answered except one in progress, callbacks continue, robots move"""
    victim = fleet.stack.containers("gateway")[0]
    reads = RepeatedReads(lambda: fleet.front.request(fleet.front.root + SWAYING).status)
    fleet.stack.kill(victim)
    try:
        time.sleep(_LOAD_S)
        wrong = describe_violation(reads.stop())
        assert not wrong, wrong
        more_callbacks(fleet)
        _rotate(fleet, 10)
    finally:
        fleet.stack.start(victim)
    wait_for(lambda: ready(fleet) == 2, "both gateways ready")


def router_restart(fleet: Fleet) -> None:
    """the router restarts: robots come back, and move"""
    fleet.stack.restart("router")
    wait_for(lambda: online(fleet) >= set(ROBOTS) and ready(fleet) == 2, "six robots online")
    wait_for(lambda: _rotate(fleet, 20), "a motion that succeeds")


def redis_restart(fleet: Fleet) -> None:
    """Redis restarts: subscription and invocation still exist, callbacks continue"""
    fleet.stack.restart("redis")
    for iri in (fleet.subscription, fleet.invocation):
        wait_for(lambda iri=iri: fleet.front.graph(iri), f"{iri} is there")  # type: ignore[misc]
    wait_for(lambda: more_callbacks(fleet), "callbacks")


def agent_outage(fleet: Fleet) -> None:
    """an agent is stopped: its robot is offline and readable, and online again after a start"""
    container = fleet.stack.containers("panda")[0]
    fleet.stack.stop(container)
    try:
        wait_for(lambda: "panda" not in online(fleet), "panda offline")
        assert len(fleet.front.graph(fleet.front.root + "panda/")), "panda is not readable"
        assert set(ROBOTS) - {"panda"} <= online(fleet), "other robots are offline too"
    finally:
        fleet.stack.start(container)
    wait_for(lambda: "panda" in online(fleet), "panda online")


def scaling(fleet: Fleet) -> None:
    """one more gateway and two more robots, named after their containers, by --scale"""
    fleet.stack.scale("gateway", 3)
    wait_for(lambda: ready(fleet) == 3, "three gateways ready")
    fleet.stack.scale("arm", 2)
    wait_for(lambda: len(online(fleet) - set(ROBOTS)) == 2, "two more robots online")


CHECKS = (fleet_over_https, links, http2, http3, private_endpoints, event_stream, websocket, callback, motion,
          shared_state, gateway_loss, router_restart, redis_restart, agent_outage, scaling)  # fmt: skip

# Runs in a gateway's container: prints the status of a GET of an IRI at that gateway, with a token unless it is empty.
_ASK = """
import http.client, sys, urllib.parse
url, token = urllib.parse.urlsplit(sys.argv[1]), sys.argv[2]
c = http.client.HTTPConnection("127.0.0.1", 8000, timeout=10)
c.request("GET", url.path, headers={"Host": url.netloc, **({"Authorization": "Bearer " + token} if token else {})})
print(c.getresponse().status)
"""


def status_at(fleet: Fleet, gateway: str, iri: str) -> str:
    """Return the status of a GET at one gateway, by its container."""
    return fleet.stack.execute(gateway, "python", "-c", _ASK, iri, fleet.front.token).strip()


def online(fleet: Fleet) -> set[str]:
    root = fleet.front.root
    rows = fleet.front.graph(root).subjects(URIRef(LF + "presence"), URIRef(LF + "online"))
    return {str(robot).removeprefix(root).rstrip("/") for robot in rows}


def ready(fleet: Fleet) -> int:
    """Return the number of gateways that report ready."""
    gateways = fleet.stack.containers("gateway")
    return sum(status_at(fleet, each, fleet.front.root + "health/ready") == "200" for each in gateways)


def _rotate(fleet: Fleet, degrees: float) -> str:
    """Turn a joint, wait for the end, and return the IRI of the successful invocation."""
    answer = fleet.front.request(
        f"{fleet.front.root}baxter/right_s1/actions/rotate", "POST", ANGLE % degrees, timeout_s=40,
        Content_Type="text/turtle", Prefer="wait=30, return=representation",
    )  # fmt: skip
    assert answer.status == 201, f"rotate answered {answer.status}: {answer.body[:300]!r}"
    iri = answer.fields["location"]
    states = {str(state) for state in answer.graph(iri).objects(URIRef(iri), URIRef(LF + "state"))}
    assert states == {LF + "succeeded"}, f"{iri} ended as {states}"
    return iri


def more_callbacks(fleet: Fleet) -> bool:
    """Wait for three more deliveries; AssertionError if they do not arrive."""
    before = len(read_deliveries(fleet.receiver_port))
    return wait_for(lambda: len(read_deliveries(fleet.receiver_port)) >= before + 3, "three more callbacks")
