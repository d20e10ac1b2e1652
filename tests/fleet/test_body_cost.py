"""No body and no header field of a permitted size blocks the event loop: measured on the loop itself, in this process.

The limit applies to processor time of the loop's thread. Other work on the machine still slows the thread through
caches and shared cores: the time is divided by the present slowness of a fixed computation. The limit here is twice the
25 ms of ``make fuzz``, since the defects to be found took 100 ms to 10 s. Times above it are measured again, and the
lowest counts.
"""

import asyncio
import contextlib
import json
import time
from asyncio.events import Handle
from collections.abc import Iterator
from itertools import cycle
from pathlib import Path

import httpx
import numpy as np
import pytest

from fake_robots import FakeRobot, open_session
from floor_maps import yaml
from fuzzing.fields import families
from fuzzing.good import able_arm
from fuzzing.hostile import (
    ACCEPTED,
    ENDPOINTS,
    JSON_LD,
    LOGIN,
    QUERIES,
    SUBSCRIPTION,
    TURTLE,
    Attack,
    Endpoint,
    attacks,
)
from fuzzing.living import obey
from fuzzing.watched import MOST_S as FUZZ_MOST_S
from fuzzing.watched import timed_callbacks
from linked_fleet_agent.wire.codec import encode
from linked_fleet_gateway.app.application import create_app
from linked_fleet_gateway.app.settings import GatewaySettings
from linked_fleet_gateway.http.field_bounds import MAX_MEMBERS
from linked_fleet_gateway.http.scheduling import SHORT_BYTES
from running import eventually, free_port

pytestmark = [pytest.mark.processes, pytest.mark.test_all]

MOST_S = 2 * FUZZ_MOST_S
_REPETITIONS = 4
_REFERENCE_S = 0.004
"""Thread time of ``_reference`` on an idle machine of the kind for which the limit was chosen."""
_AFTER_S = 0.02
"""Time for work that a request leaves behind, such as fanning out a change."""


def _slowness() -> float:
    """Return how many times slower this thread is now than on an idle machine, at least 1."""
    begun_s = time.thread_time()
    _reference()
    return max(1.0, (time.thread_time() - begun_s) / _REFERENCE_S)


def _reference() -> int:
    return sum(number * number for number in range(100_000))


class Gateway:
    """The application on a loop with timed callbacks. ``used_s``: the longest since it was reset."""

    def __init__(self, runner: asyncio.Runner, client: httpx.AsyncClient) -> None:
        self.used_s = 0.0
        self.subscription = ""
        self._runner, self._client = runner, client

    def note(self, used_s: float, callback: Handle) -> None:
        self.used_s = max(self.used_s, used_s)

    def ask(self, method: str, path: str, body: bytes = b"", **fields: str) -> httpx.Response:
        return self._runner.run(self._ask(method, path, body, fields))

    async def _ask(self, method: str, path: str, body: bytes, fields: dict[str, str]) -> httpx.Response:
        headers = {name.replace("_", "-"): value for name, value in fields.items()}
        path = path.replace(SUBSCRIPTION, self.subscription)
        answer = await self._client.request(method, path, content=body, headers=headers)
        await asyncio.sleep(_AFTER_S)
        return answer

    def cost_s(self, method: str, path: str, body: bytes = b"", **fields: str) -> tuple[float, httpx.Response]:
        """Return the thread time of the longest callback, and the response; the best of several requests."""
        least_s = float("inf")
        for _ in range(_REPETITIONS):
            self.used_s = 0.0
            answer = self.ask(method, path, body, **fields)
            if self.used_s >= MOST_S:
                self.used_s /= _slowness()
            least_s = min(least_s, self.used_s)
            if least_s < MOST_S:
                break
        return least_s, answer


@pytest.fixture(scope="module")
def gateway(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Gateway]:
    """Run a gateway with an obedient robot that has all kinds of actions."""
    port, endpoint = free_port(), f"tcp/127.0.0.1:{free_port()}"
    state: Path = tmp_path_factory.mktemp("state")
    flags = {"port": port, "zenoh-listen": endpoint, "state-dir": state}
    flags |= {"requests-per-client": 0, "subscriptions-per-client": 20, "callback-allow": "127.0.0.0/8"}
    app = create_app(GatewaySettings.read({}, [f"--{name}={value}" for name, value in flags.items()]))
    with contextlib.ExitStack() as stack:
        runner = stack.enter_context(asyncio.Runner())
        life = app.router.lifespan_context(app)
        runner.run(life.__aenter__())
        stack.callback(lambda: runner.run(life.__aexit__(None, None, None)))
        arm = FakeRobot(stack.enter_context(open_session(endpoint)), "arm")
        obey(arm)
        arm.appear(encode(able_arm(arm.incarnation))).stand(0.1, 0.1, 0.1, 0.1)
        base = f"http://127.0.0.1:{port}"
        client = httpx.AsyncClient(transport=httpx.ASGITransport(app), base_url=base, timeout=60)
        made = Gateway(runner, client)
        stack.callback(lambda: runner.run(client.aclose()))
        eventually(lambda: made.ask("GET", "/arm/", accept=TURTLE).status_code == 200, "the arm")
        upgrade = {"connection": "upgrade", "upgrade": "callback", "callback": "http://127.0.0.1:9/"}
        subscribe = lambda: made.ask("GET", "/arm/pan/rotation", **upgrade).headers.get("location")  # noqa: E731
        made.subscription = eventually(subscribe, "a subscription, once the store is there").rpartition("/")[2]
        for accept in ACCEPTED:  # loads what is loaded or compiled only once
            made.ask("GET", "/arm/", accept=accept)
        with timed_callbacks(made.note):
            for each in (*ENDPOINTS, QUERIES, LOGIN):
                made.ask(each.method, each.path, b"x", content_type="text/turtle")
            yield made


def _too_long(gateway: Gateway, attack: Attack, accept: str) -> str:
    """Return a description if a callback was too long or the response is not permitted, else an empty string."""
    end = attack.endpoint
    fields = {"content_type": attack.media_type, "accept": accept, "prefer": "return=representation"}
    used_s, answer = gateway.cost_s(end.method, end.path, attack.body, **fields)
    what = f"{attack.family} ({attack.media_type}, {len(attack.body)} bytes): {answer.status_code}"
    if answer.status_code >= 500 and answer.status_code != 503:
        return f"{what} {answer.text[:300]}"
    return f"{what} took {used_s * 1000:.1f} ms" if used_s >= MOST_S else ""


_AT = [each for each in ENDPOINTS if each.families in ("rotate", "annotations", "objects")]


@pytest.mark.parametrize("endpoint", _AT, ids=lambda each: each.path)
def test_no_syntax_keeps_the_loop_busy(gateway: Gateway, endpoint: Endpoint) -> None:
    """Whatever fills a body of permitted size in any syntax, no callback takes more than 25 ms."""
    assert [wrong for each in attacks(endpoint) if (wrong := _too_long(gateway, each, "*/*"))] == []


@pytest.mark.parametrize("endpoint", (*ENDPOINTS, QUERIES, LOGIN), ids=lambda each: each.path)
def test_no_content_keeps_the_loop_busy(gateway: Gateway, endpoint: Endpoint) -> None:
    """Bodies of maximum content, valid or not, with the response in another media type each."""
    accepted = cycle(ACCEPTED if endpoint in ENDPOINTS else ("*/*",))
    found = [_too_long(gateway, *each) for each in zip(attacks(endpoint, syntaxes=False), accepted, strict=False)]
    assert list(filter(None, found)) == []


def test_a_body_that_is_short_enough_to_be_read_on_the_loop_keeps_within_the_time(gateway: Gateway) -> None:
    """Every two bytes of a list are two triples, all of which are validated."""
    end = " ) <u:p> 1 ."
    body = ("(" + " 1" * SHORT_BYTES)[: SHORT_BYTES - len(end)].encode() + end.encode()
    for each in ENDPOINTS:
        used_s, _ = gateway.cost_s(each.method, each.path, body, content_type=TURTLE, accept=TURTLE)
        assert used_s / _slowness() < FUZZ_MOST_S, f"{each.path}: {used_s * 1000:.1f} ms"


@pytest.mark.parametrize("accept", [each for each in ACCEPTED if "problem" not in each])
def test_large_annotations_delay_no_reader(gateway: Gateway, accept: str) -> None:
    """The robot with as many annotations as permitted, and they themselves, in any media type."""
    (put,) = [each for each in ENDPOINTS if each.families == "annotations"]
    for attack in attacks(put, syntaxes=False):
        status = gateway.ask("PUT", put.path, attack.body, content_type=TURTLE).status_code
        assert status in (204, 400, 422), attack.family
        for path in ("/arm/", put.path):
            used_s, answer = gateway.cost_s("GET", path, accept=accept)
            assert answer.status_code in (200, 406)
            assert used_s < MOST_S, f"{path} with {attack.family} as {accept}: {used_s * 1000:.1f} ms"


def test_the_context_that_froze_a_gateway_is_refused(gateway: Gateway) -> None:
    """6.4 kB that blocked the loop, and a stop, for ten seconds."""
    context = {"a": {"@id": "http://a/", "@context": ["/context"] * 200}}
    body = json.dumps({"@context": context, "x": [{"a": {"a": 1}}] * 300}).encode()
    used_s, answer = gateway.cost_s("POST", "/arm/pan/subscriptions", body, content_type=JSON_LD)
    assert (answer.status_code, "scoped @context" in answer.json()["detail"]) == (400, True), answer.text
    assert used_s < MOST_S


def test_a_mesh_of_as_many_triangles_as_there_may_be_is_taken(gateway: Gateway) -> None:
    """10,000 triangles in Base64, which a parser reads as one literal of 667 kB."""
    (post,) = [each for each in ENDPOINTS if each.path == "/world/objects"]
    (mesh,) = [each for each in attacks(post, syntaxes=False) if each.family == "mesh"]
    used_s, answer = gateway.cost_s(post.method, post.path, mesh.body, content_type=TURTLE)
    assert answer.status_code == 201, answer.text
    assert used_s < MOST_S


def test_the_largest_map_of_the_floor_is_taken_and_given(gateway: Gateway) -> None:
    """16 million pixels, of so much noise that they take nearly all of the room in Redis."""
    shades = np.full(4000 * 4000, 205, dtype=np.uint8)
    settings = yaml(0.05).replace(b"0.65", b"1.0").replace(b"0.196", b"0.0")  # all of it unknown: no obstacles
    for noisy in (100_000, 3_900_000):
        shades[:noisy] = np.random.default_rng(1).integers(1, 255, noisy, dtype=np.uint8)
        image = b"P5 4000 4000 255\n" + shades.tobytes()
        files = {"yaml": settings, "image": ("floor.pgm", image)}
        request = httpx.Request("PUT", "http://fleet.test/", files=files)
        used_s, answer = gateway.cost_s(
            "PUT", "/world/map", request.read(), content_type=request.headers["content-type"]
        )
        assert answer.status_code == 204, answer.text
        assert used_s < MOST_S, f"{used_s * 1000:.1f} ms"
        used_s, answer = gateway.cost_s("GET", "/world/map/map.pgm")
        assert answer.content == image and used_s < MOST_S, f"{used_s * 1000:.1f} ms"


@pytest.mark.parametrize("path", ["/arm/title", "/arm/pan/actions/rotate", "/arm/pan/targetRotation"])
@pytest.mark.parametrize("body", [b'{"value": "\\ud800"}', b'{"\\ud800": "x"}'])
@pytest.mark.parametrize("media_type", ["application/json", JSON_LD])
def test_half_a_surrogate_pair_is_malformed(gateway: Gateway, path: str, body: bytes, media_type: str) -> None:
    """A lone surrogate is 400 as a value and as a member name, in plain JSON and in JSON-LD."""
    answer = gateway.ask("PUT", path, body, content_type=media_type)
    assert (answer.status_code, "half of a surrogate pair" in answer.json()["detail"]) == (400, True), answer.text


@pytest.mark.parametrize("name", ["if_match", "if_none_match"])
def test_preconditions_take_a_turn_for_each_representation(gateway: Gateway, name: str) -> None:
    """An invalid entity tag is compared with that of every representation, all of which are rendered for it."""
    (put,) = [each for each in ENDPOINTS if each.families == "annotations"]
    for attack in attacks(put, syntaxes=False):
        gateway.ask("PUT", put.path, attack.body, content_type=TURTLE)
        for path in ("/arm/", put.path, "/arm/pan/actions/rotate"):
            fields = {name: '"x"', "content_type": TURTLE}
            used_s, answer = gateway.cost_s("GET" if path == "/arm/" else "PUT", path, b"x", **fields)
            assert answer.status_code in (200, 400, 412)
            assert used_s < MOST_S, f"{path} with {attack.family}: {used_s * 1000:.1f} ms"


@pytest.mark.parametrize(
    ("method", "path"), [("GET", "/arm/"), ("GET", "/nowhere"), ("PUT", "/arm/title"), ("POST", "/arm/actions/stop")]
)
def test_no_header_field_keeps_the_loop_busy(gateway: Gateway, method: str, path: str) -> None:
    """A field of any length, which may be refused, but not for a stop."""
    found = []
    for name, value in families():
        if name == "Origin":
            continue  # it prevents stops
        used_s, answer = gateway.cost_s(method, path, **{name: value})
        if used_s >= MOST_S or (answer.status_code >= 500 and answer.status_code != 503):
            found.append(f"{name}: {value[:40]}… of {len(value)}: {answer.status_code}, {used_s * 1000:.1f} ms")
        if path.endswith("stop") and name != "Host":
            rehearsed = name == "Prefer" and value.startswith("dry-run") and value.count(";") < MAX_MEMBERS
            assert answer.status_code in ((200,) if rehearsed else (202, 204)), (name, value[:40], answer.text)
    assert found == []
