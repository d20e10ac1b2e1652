"""Deliveries to well-behaved and hostile receivers."""

import asyncio
import ssl
from collections.abc import Awaitable, Callable, Iterator
from contextlib import closing
from ipaddress import IPv4Network, IPv6Network
from typing import TypeVar

import pytest

from linked_fleet_webhooks.network import ForbiddenHost, Lookup, Network, system_lookup
from linked_fleet_webhooks.receiver import ConsentResponse, DeliveryOutcome, NoConsent, Receiver, Verdict
from receivers import Answer, consents, receiving, redirect, retry_after
from receivers import Receiver as CallbackReceiver
from running import free_port
from virtual.loop import current

pytestmark = pytest.mark.virtual
T = TypeVar("T")
LOOPBACK = (IPv4Network("127.0.0.0/8"), IPv6Network("::1/128"))
PLAIN = ssl.create_default_context()
ORIGIN = "fleet.example"


def using(
    url: str,
    use: Callable[[Receiver], Awaitable[T]],
    *,
    allowed: tuple[IPv4Network | IPv6Network, ...] = LOOPBACK,
    lookup: Lookup = system_lookup,
    timeout_s: float = 10.0,
    connect_timeout_s: float = 3.0,
) -> T:
    async def run() -> T:
        with closing(Network(allowed, lookup=lookup, ports=(range(1, 65536),))) as network:
            timeouts = {"timeout_s": timeout_s, "connect_timeout_s": connect_timeout_s}
            receiver = Receiver(network, url, ssl_context=PLAIN, **timeouts)
            try:
                return await use(receiver)
            finally:
                await receiver.aclose()

    return asyncio.run(run())


async def deliver(receiver: Receiver) -> DeliveryOutcome:
    return await receiver.deliver(b"<> a <#x> .", "text/turtle", {"webhook-id": "7"}, allowed_only=False)


async def deliver_allowed(receiver: Receiver) -> DeliveryOutcome:
    return await receiver.deliver(b"<> a <#x> .", "text/turtle", {"webhook-id": "7"}, allowed_only=True)


def times(count: int) -> Callable[[Receiver], Awaitable[list[DeliveryOutcome]]]:
    async def repeat(receiver: Receiver) -> list[DeliveryOutcome]:
        return [await deliver(receiver) for _ in range(count)]

    return repeat


async def ask(receiver: Receiver) -> ConsentResponse:
    return await receiver.request_consent(ORIGIN)


@pytest.fixture
def there() -> Iterator[CallbackReceiver]:
    with receiving() as receiver:
        yield receiver


def test_a_delivery_arrives_as_it_was_sent(there: CallbackReceiver) -> None:
    outcome = using(there.url("/a%20b/../c?d=%2F&e"), deliver)
    assert outcome == DeliveryOutcome(Verdict.DELIVERED, 204, None, "")
    (seen,) = there.log()
    assert (seen.method, seen.body) == ("POST", b"<> a <#x> .")
    assert seen.path == "/c?d=%2F&e"
    assert seen.headers.pop("user-agent").startswith("linked-fleet/")
    assert seen.headers == {
        "host": f"127.0.0.1:{there.port}",
        "content-type": "text/turtle",
        "content-length": "11",
        "webhook-id": "7",
    }


@pytest.mark.parametrize("status", [200, 201, 202, 204])
def test_every_2xx_is_a_delivery(there: CallbackReceiver, status: int) -> None:
    there.default = Answer(status)
    assert using(there.url(), deliver).verdict is Verdict.DELIVERED


def test_410_means_no_more(there: CallbackReceiver) -> None:
    there.default = Answer(410)
    outcome = using(there.url(), deliver)
    assert (outcome.verdict, outcome.status) == (Verdict.GONE, 410)


@pytest.mark.parametrize("status", [400, 404, 429, 500, 503])
def test_every_other_status_is_tried_again(there: CallbackReceiver, status: int) -> None:
    there.default = Answer(status, body=b"secret of the receiver")
    outcome = using(there.url(), deliver)
    assert outcome == DeliveryOutcome(Verdict.RETRY, status, None, f"The receiver answered with status {status}.")


def test_retry_after_is_passed_on(there: CallbackReceiver) -> None:
    there.script(retry_after(17), retry_after(3, 429), Answer(503, {"Retry-After": "soon"}))
    assert [outcome.retry_after_s for outcome in using(there.url(), times(3))] == [17.0, 3.0, None]


def test_redirects_are_not_followed(there: CallbackReceiver) -> None:
    there.script(redirect(there.url("/elsewhere")), redirect("http://169.254.169.254/", 302))
    outcomes = using(there.url(), times(2))
    assert [outcome.status for outcome in outcomes] == [307, 302]
    assert all(outcome.verdict is Verdict.RETRY and "not followed" in outcome.reason for outcome in outcomes)
    assert [seen.path for seen in there.log()] == ["/callback", "/callback"]


def test_no_cookie_comes_back(there: CallbackReceiver) -> None:
    there.default = Answer(204, {"Set-Cookie": "track=1; Path=/"})
    using(there.url(), times(2))
    assert not any("cookie" in seen.headers for seen in there.log())


def test_proxies_in_the_environment_are_not_used(there: CallbackReceiver, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("http_proxy", "HTTP_PROXY", "all_proxy", "ALL_PROXY"):
        monkeypatch.setenv(name, f"http://127.0.0.1:{free_port()}")
    assert using(there.url(), deliver).verdict is Verdict.DELIVERED


def test_deliveries_share_a_connection(there: CallbackReceiver) -> None:
    using(there.url(), times(5))
    assert there.connections == 1


def test_a_connection_that_the_receiver_closed_is_replaced(there: CallbackReceiver) -> None:
    there.default = Answer(204, {"Connection": "close"})
    assert [outcome.verdict for outcome in using(there.url(), times(3))] == [Verdict.DELIVERED] * 3
    assert there.connections == 3


def test_an_endless_body_is_not_read_and_costs_only_the_connection(there: CallbackReceiver) -> None:
    there.default = Answer(200, endless=True)
    assert [outcome.verdict for outcome in using(there.url(), times(5))] == [Verdict.DELIVERED] * 5
    assert there.connections == 5
    assert there.endless_bytes < 5 * 2**20  # what buffers of both sides hold; a reader would get gigabytes


def test_a_body_of_a_few_kilobytes_keeps_the_connection(there: CallbackReceiver) -> None:
    there.default = Answer(200, body=b"x" * 4096)
    using(there.url(), times(2))
    assert there.connections == 1


def test_a_receiver_that_stalls_is_tried_again(there: CallbackReceiver) -> None:
    there.default = Answer(stalls=True)
    outcome = using(there.url(), deliver, timeout_s=0.05)
    assert outcome == DeliveryOutcome(Verdict.RETRY, None, None, "The receiver did not answer in time.")


def test_a_status_stands_although_the_body_stalls(there: CallbackReceiver) -> None:
    there.default = Answer(200, stalls_in_body=True)
    assert using(there.url(), deliver, timeout_s=1.0).verdict is Verdict.DELIVERED


def test_deliveries_that_were_cancelled_leave_room_for_the_next(there: CallbackReceiver) -> None:
    there.script(*[Answer(stalls=True)] * 3, *[Answer(200, stalls_in_body=True)] * 3)

    async def run(receiver: Receiver) -> DeliveryOutcome:
        for count in range(1, 7):
            stuck = asyncio.create_task(deliver(receiver))
            while len(there.log()) < count:  # noqa: ASYNC110 - the receiver runs beside the loop
                await asyncio.sleep(0.01)
            stuck.cancel()
            await asyncio.wait([stuck])
        return await deliver(receiver)

    assert using(there.url(), run).verdict is Verdict.DELIVERED


@pytest.mark.parametrize(
    "raw",
    [
        b"",
        b"\x00\xff\r\n\r\n",
        b"SSH-2.0-OpenSSH_9.6\r\n",
        b"HTTP/1.1 99999 No\r\n\r\n",
        b"HTTP/1.1 200 OK\r\nX: " + b"x" * 200_000,
        b"HTTP/1.1 101 Switching Protocols\r\nUpgrade: x\r\nConnection: upgrade\r\n\r\n",
        b"HTTP/1.1 100 Continue\r\n\r\n" * 100,
        b"HTTP/1.1 200 OK\r\nContent-Length: -1\r\n\r\n",
    ],
)
def test_an_answer_that_is_no_http_is_tried_again(there: CallbackReceiver, raw: bytes) -> None:
    there.script(Answer(raw=raw))
    outcome = using(there.url(), deliver)
    assert outcome == DeliveryOutcome(
        Verdict.RETRY, None, None, "The connection broke before there was a valid answer."
    )


def test_a_receiver_that_hangs_up_is_tried_again(there: CallbackReceiver) -> None:
    there.script(Answer(hangs_up=True))
    assert [outcome.verdict for outcome in using(there.url(), times(2))] == [Verdict.RETRY, Verdict.DELIVERED]


def test_a_body_cut_short_does_not_undo_a_delivery(there: CallbackReceiver) -> None:
    there.script(Answer(raw=b"HTTP/1.1 200 OK\r\nContent-Length: 100\r\n\r\nonly this"))
    assert using(there.url(), deliver).verdict is Verdict.DELIVERED


def test_an_absent_receiver_is_retried_without_naming_ports() -> None:
    port = free_port()
    outcome = using(f"http://127.0.0.1:{port}/", deliver)
    assert outcome == DeliveryOutcome(Verdict.RETRY, None, None, "No connection: nobody listens there.")


def test_a_connection_that_is_never_accepted_ends_in_time() -> None:
    loop, port = current(), free_port()
    assert loop is not None
    loop.internet.unreachable.add(("127.0.0.1", port))
    outcome = using(f"http://127.0.0.1:{port}/", deliver)
    assert outcome.reason == "The receiver did not answer in time."


# Which address is connected to


@pytest.mark.parametrize("host", ["127.0.0.1", "localhost", "2130706433", "0x7f.1", "127.1"])
def test_loopback_is_out_of_reach_unless_allowed(there: CallbackReceiver, host: str) -> None:
    outcome = using(there.url(host=host), deliver, allowed=())
    assert (outcome.verdict, outcome.status) == (Verdict.RETRY, None)
    assert "special addresses" in outcome.reason
    assert there.connections == 0


@pytest.mark.parametrize("host", ["127.0.0.1", "localhost", "2130706433", "[::ffff:127.0.0.1]"])
def test_every_spelling_of_an_allowed_address_is_reached(there: CallbackReceiver, host: str) -> None:
    assert using(there.url(host=host), deliver).verdict is Verdict.DELIVERED
    assert there.log()[0].headers["host"] == f"{host}:{there.port}"


def test_a_name_is_resolved_once_for_each_delivery_and_never_behind_our_back(there: CallbackReceiver) -> None:
    asked: list[str] = []

    def rebinding(host: str, port: int) -> list[str]:
        asked.append(host)
        return ["127.0.0.1"] if len(asked) == 1 else ["127.0.0.2"]  # the second is not allowed

    outcomes = using(
        there.url(host="rebinds.example"), times(3), allowed=(IPv4Network("127.0.0.1/32"),), lookup=rebinding
    )
    assert [outcome.verdict for outcome in outcomes] == [Verdict.DELIVERED, Verdict.RETRY, Verdict.RETRY]
    assert asked == ["rebinds.example"] * 3
    assert [seen.headers["host"] for seen in there.log()] == [f"rebinds.example:{there.port}"]


def test_an_open_connection_is_not_used_for_an_address_that_is_no_longer_the_names(there: CallbackReceiver) -> None:
    answers = iter([["127.0.0.1"], ["127.0.0.3"], ["127.0.0.1"]])
    with receiving("127.0.0.3", there.port) as moved:
        using(there.url(host="moves.example"), times(3), lookup=lambda host, port: next(answers))
        assert (len(there.log()), len(moved.log())) == (2, 1)


def test_an_open_connection_is_used_in_whatever_order_addresses_come(there: CallbackReceiver) -> None:
    answers = iter([["127.0.0.1", "127.0.0.3"], ["127.0.0.3", "127.0.0.1"]] * 2)
    with receiving("127.0.0.3", there.port) as other:
        using(there.url(host="robin.example"), times(4), lookup=lambda host, port: next(answers))
        assert (there.connections, other.connections) == (1, 0)


def test_the_next_address_is_tried_when_one_is_dead(there: CallbackReceiver) -> None:
    dead_first = ["127.0.0.9", "::1", "127.0.0.1"]
    assert using(there.url(host="a.example"), deliver, lookup=lambda *_: dead_first).verdict is Verdict.DELIVERED


def test_not_more_than_four_addresses_are_tried(there: CallbackReceiver) -> None:
    many = [*(f"127.0.1.{n}" for n in range(4)), "127.0.0.1"]
    assert using(there.url(host="a.example"), deliver, lookup=lambda *_: many).verdict is Verdict.RETRY
    assert there.connections == 0


def test_a_delivery_is_not_repeated_to_another_address_once_it_was_sent(there: CallbackReceiver) -> None:
    there.default = Answer(hangs_up=True)
    with receiving("127.0.0.3", there.port) as other:
        using(there.url(host="a.example"), deliver, lookup=lambda *_: ["127.0.0.1", "127.0.0.3"])
        assert (len(there.log()), len(other.log())) == (1, 0)


def test_without_consent_only_allowed_addresses_are_used(there: CallbackReceiver) -> None:
    def both(host: str, port: int) -> list[str]:
        return ["8.8.8.8", "127.0.0.1"]

    assert using(there.url(host="a.example"), deliver_allowed, lookup=both).verdict is Verdict.DELIVERED
    with pytest.raises(NoConsent):
        using(there.url(host="a.example"), deliver_allowed, lookup=lambda *_: ["8.8.8.8"])


def test_a_receiver_is_trusted_when_all_its_addresses_are_allowed() -> None:
    for addresses, trusted in [(["127.0.0.1"], True), (["127.0.0.1", "8.8.8.8"], False), (["8.8.8.8"], False)]:
        assert (
            using("http://a.example/", Receiver.needs_no_consent, lookup=lambda *_, found=addresses: found) is trusted
        )
    with pytest.raises(ForbiddenHost):
        using("http://a.example/", Receiver.needs_no_consent, lookup=lambda *_: ["10.0.0.1"])


def test_an_unusable_url_makes_no_receiver() -> None:
    with pytest.raises(ValueError, match="http://"):
        using("file:///etc/passwd", deliver)


# Consent


def test_consent_is_asked_for_by_options_with_our_origin(there: CallbackReceiver) -> None:
    there.consent = consents(rate="120")
    assert using(there.url(), ask) == ConsentResponse(granted=True, interval_s=0.5, status=200, reason="")
    (seen,) = there.log()
    assert (seen.method, seen.headers["webhook-request-origin"], seen.body) == ("OPTIONS", ORIGIN, b"")


@pytest.mark.parametrize("origin", ["*", ORIGIN, "Fleet.Example"])
def test_consent_is_for_everybody_or_for_us(there: CallbackReceiver, origin: str) -> None:
    there.consent = consents(origin)
    assert using(there.url(), ask).granted


@pytest.mark.parametrize(
    ("answer", "status"),
    [
        (Answer(200), 200),
        (consents("other.example"), 200),
        (consents(f"{ORIGIN}, *"), 200),
        (Answer(405), 405),
        (Answer(403, {"WebHook-Allowed-Origin": "*"}), 403),
        (Answer(302, {"WebHook-Allowed-Origin": "*", "Location": "/"}), 302),
        (Answer(hangs_up=True), None),
    ],
)
def test_other_responses_are_no_consent(there: CallbackReceiver, answer: Answer, status: int | None) -> None:
    there.consent = answer
    consent = using(there.url(), ask)
    assert (consent.granted, consent.status) == (False, status)
    assert consent.reason.endswith(".")


@pytest.mark.parametrize(
    ("rate", "interval_s"),
    [("1", 60.0), ("60", 1.0), ("*", 0.0), ("0", 0.0), ("-1", 0.0), ("x", 0.0), ("²", 0.0), ("9" * 99, 0.0)],
)
def test_the_rate_is_per_minute(there: CallbackReceiver, rate: str, interval_s: float) -> None:
    there.consent = consents(rate=rate)
    consent = using(there.url(), ask)
    assert (consent.granted, consent.interval_s) == (True, interval_s)


def test_consent_is_not_asked_of_forbidden_addresses(there: CallbackReceiver) -> None:
    there.consent = consents()
    assert not using(there.url(), ask, allowed=()).granted
    assert there.connections == 0
