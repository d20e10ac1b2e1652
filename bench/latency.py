"""Latency of a state to a subscriber, and of an action to the agent, beside plain Zenoh and Starlette."""

import contextlib
import http.client
import time
from collections.abc import Callable, Sequence
from urllib.parse import urlsplit

from bench.beside import BARE, bare, fsync_ms, wire
from bench.scene import Readers, browsing, cpu_s, scene
from bench.table import Row, at_most, known, percentile
from browser import HYBRIT, Browser
from commanding import PREFIXES
from running import free_port, process
from small_fleet import live

RATE_HZ = 100
_TURTLE = {"content-type": "text/turtle"}


def rows(seconds: float) -> list[Row]:
    alone = wire(f"tcp/127.0.0.1:{free_port()}", RATE_HZ, seconds)
    return [*states(alone.states_ms, seconds), *actions(alone.answers_ms, seconds)]


def states(raw_ms: Sequence[float], seconds: float) -> list[Row]:
    """Measure from sending a frame to its WebSocket message, for one robot and one subscriber."""
    with (
        scene() as place,
        place.robot("mover", RATE_HZ) as mover,
        contextlib.closing(Readers(place.place.port, "ws", 1, "/mover/elbow/rotation")) as reader,
    ):
        reader.counted()
        time.sleep(seconds)
        sent_ms = mover.latencies_ms(reader.counted()["seen"])
    name, beside = "from a robot's frame to its subscriber", "Zenoh from process to process"
    return [
        known(f"{beside}, p50", "ms", percentile(raw_ms, 0.5)),
        known(f"{beside}, p99", "ms", percentile(raw_ms, 0.99)),
        at_most(f"{name}, p50", percentile(sent_ms, 0.5), beside, percentile(raw_ms, 0.5), 1.0),
        at_most(f"{name}, p99", percentile(sent_ms, 0.99), beside, percentile(raw_ms, 0.99), 5.0),
    ]


def actions(asked_ms: Sequence[float], seconds: float) -> list[Row]:
    """Measure from a POST that rotates a joint to the response after the agent's acceptance, one after another."""
    with bare(1) as (url, _):
        posted_ms = timed_ms(url, seconds, _body)
    with (
        scene("--requests-per-client", "0") as place,
        process("-m", "linked_fleet_agent", "--robot=ur5", "--connect", place.place.zenoh),
        browsing(place.place) as browser,
    ):
        live(browser, "ur5")
        spent_s = cpu_s(place.pid)
        took = timed_ms(_rotate(browser), seconds, _body)
        spent_s = cpu_s(place.pid) - spent_s
    on_disk = percentile(fsync_ms(), 0.5)
    least = percentile(asked_ms, 0.5) + percentile(posted_ms, 0.5)
    beside = f"a Zenoh query and a POST to {BARE}"
    return [
        known("a Zenoh query between processes, p50", "ms", percentile(asked_ms, 0.5)),
        known(f"a POST to {BARE}, p50", "ms", percentile(posted_ms, 0.5)),
        known("an fsync of this disk, p50", "ms", on_disk),
        at_most("from a POST to the agent's acceptance, p50", percentile(took, 0.5), beside, least, 1.5),
        known("from a POST to the agent's acceptance, p10", "ms", percentile(took, 0.1)),
        known("from a POST to the agent's acceptance, p99", "ms", percentile(took, 0.99)),
        known("a POST to the agent's acceptance: processor of the gateway", "ms CPU", spent_s * 1e3 / len(took)),
    ]


def timed_ms(url: str, seconds: float, body: Callable[[int], bytes]) -> list[float]:
    """Send POSTs on one connection, each after the response to the one before."""
    asked, took = urlsplit(url), list[float]()
    with contextlib.closing(http.client.HTTPConnection(asked.netloc)) as connection:
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            content = body(len(took))
            begin = time.perf_counter()
            connection.request("POST", asked.path, content, _TURTLE)
            answer = connection.getresponse()
            said = answer.read()
            took.append((time.perf_counter() - begin) * 1e3)
            assert answer.status == http.client.NO_CONTENT, said
    return took


def _body(number: int) -> bytes:
    return f"{PREFIXES}<> vom:numericalValue {number % 7} ; vom:unit maths:Degree .".encode()


def _rotate(browser: Browser) -> str:
    joint = browser.part("ur5", "wrist_3_joint")
    return next(str(each) for each in joint.graph.objects(joint.iri, HYBRIT.action) if str(each).endswith("/rotate"))
