"""Token buckets per client, and requests refused by them."""

import asyncio
import json
from types import SimpleNamespace
from typing import Any, cast

import pytest
from starlette.responses import Response
from starlette.types import Scope

from linked_fleet_base.errors import TooManyRequests
from linked_fleet_gateway.http.arrival import Authenticated, arrival_of
from linked_fleet_gateway.http.entrance import RateLimiter, await_turn
from linked_fleet_gateway.http.forwarding import send_early
from linked_fleet_gateway.http.request import Request
from linked_fleet_gateway.http.scheduling import BURST_S, MAX_CLIENTS, StopPriority, TokenBuckets, bucket_key
from linked_fleet_identity.rights import EVERYBODY, NOBODY, Identity


class Clock:
    now_s = 0.0

    def __call__(self) -> float:
        return self.now_s


def test_a_burst_and_then_the_rate() -> None:
    clock = Clock()
    rates = TokenBuckets(2.0, clock)
    for _ in range(int(2 * BURST_S)):
        assert rates.take("a") == 0.0
    assert rates.take("a") == pytest.approx(0.5)
    assert rates.take("b") == 0.0
    clock.now_s = 0.5
    assert rates.take("a") == 0.0
    assert rates.take("a") == pytest.approx(0.5)
    clock.now_s = 1e6
    for _ in range(int(2 * BURST_S)):
        assert rates.take("a") == 0.0
    assert rates.take("a") > 0.0


def test_zero_is_no_bound() -> None:
    rates = TokenBuckets(0.0, Clock())
    assert not any(rates.take("a") for _ in range(100_000))


def test_however_many_clients_come_few_are_remembered() -> None:
    """Frequent clients are not among those that are forgotten."""
    rates = TokenBuckets(0.1, Clock())
    assert rates.take("busy") == 0.0
    for number in range(3 * MAX_CLIENTS):
        rates.take(str(number))
        if number % 1000 == 0:
            assert rates.take("busy") > 0.0
    assert len(rates._left) == MAX_CLIENTS


@pytest.mark.parametrize(
    ("one", "other", "same"),
    [
        ("192.0.2.1", "192.0.2.2", False),
        ("2001:db8::1", "2001:db8::ffff:1", True),
        ("2001:db8::1", "2001:db8:0:1::1", False),
        ("::ffff:192.0.2.1", "192.0.2.1", True),
        ("fe80::1%eth0", "fe80::1%eth1", True),
        ("unix", "unix", True),
    ],
)
def test_clients_are_told_apart_by_identity_or_network(one: str, other: str, same: bool) -> None:
    assert (_counted(one) == _counted(other)) is same


def test_an_identity_is_one_client_wherever_it_is() -> None:
    alice, bob = (Identity(name=name, grants=()) for name in ("alice", "bob"))
    found = [_counted(host, who) for host in ("192.0.2.1", "192.0.2.2") for who in (alice, bob)]
    assert found[:2] == found[2:]
    assert len({*found, _counted("192.0.2.1", NOBODY)}) == 3


def _counted(host: str, who: Identity = EVERYBODY) -> str:
    scope: Scope = {"client": (host, 1), "headers": []}
    arrival_of(scope).authenticated = Authenticated(who)
    return bucket_key(scope)


def _scope(method: str, path: str, kind: str = "http") -> dict[str, Any]:
    scope = {"type": kind, "method": method, "path": path, "headers": [], "client": ("192.0.2.1", 1)}
    return {**scope, "extensions": {"websocket.http.response": {}}}


def _ask(pace: RateLimiter, method: str, path: str, kind: str = "http") -> tuple[int, dict[str, str], bytes]:
    sent: list[dict[str, Any]] = []

    async def send(message: Any) -> None:
        sent.append(message)

    async def receive() -> Any:
        raise AssertionError("nothing is read")

    async def answer(scope: Scope) -> None:
        refusal = pace.refusal(scope)
        if refusal is None:
            await Response(b"served")(scope, receive, send)
        else:
            await send_early(refusal.status, refusal.fields, refusal.content, scope, send)

    asyncio.run(answer(_scope(method, path, kind)))
    assert sent[0]["type"].endswith("http.response.start")
    return sent[0]["status"], {name.decode(): value.decode() for name, value in sent[0]["headers"]}, sent[1]["body"]


def test_a_client_above_its_rate_gets_retry_after_and_can_still_stop() -> None:
    clock = Clock()
    pace = RateLimiter(TokenBuckets(0.1, clock))
    assert _ask(pace, "GET", "/")[0] == 200
    for kind in ("http", "websocket"):
        status, fields, body = _ask(pace, "GET", "/", kind)
        assert (status, fields["retry-after"], fields["content-type"]) == (429, "10", "application/problem+json")
        assert json.loads(body)["type"].endswith("#too-many-requests")
    for segment in ("stop", "stopAll", "hold", "cancel", "stop/"):
        for _ in range(20):
            assert _ask(pace, "POST", f"/ur5/actions/{segment}")[0] == 200
    assert _ask(pace, "GET", "/ur5/actions/stop")[0] == 429
    clock.now_s = 10.0
    assert _ask(pace, "GET", "/")[0] == 200


def test_a_request_is_counted_once() -> None:
    """It may be looked at twice: for an answer without waiting, and by the application."""
    pace = RateLimiter(TokenBuckets(0.1, Clock()))
    scope, next_one = _scope("GET", "/"), _scope("GET", "/")
    assert pace.wait_s(scope) == pace.wait_s(scope) == 0.0
    assert pace.wait_s(next_one) == pace.wait_s(next_one) == pytest.approx(10.0)


def test_requests_to_carriers_are_counted_when_their_bodies_have_been_read() -> None:
    clock = Clock()
    rates = TokenBuckets(0.1, clock)
    pace = RateLimiter(rates, ["/calls"])
    for _ in range(20):
        assert _ask(pace, "POST", "/calls")[0] == 200
    request = cast(
        Request,
        SimpleNamespace(
            services=SimpleNamespace(rates=rates, stop_priority=StopPriority()), scope=_scope("POST", "/calls")
        ),
    )
    asyncio.run(await_turn(request))
    with pytest.raises(TooManyRequests) as refused:
        asyncio.run(await_turn(request))
    assert refused.value.headers == {"Retry-After": "10"}
    assert _ask(pace, "GET", "/calls/1")[0] == 429
